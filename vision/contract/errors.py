"""The one error a user can mend."""


class InputError(ValueError):
    """Something the user gave cannot be used; the message says what, where and how to mend it, in one line.

    The command line prints it as it is and exits with status 2; nothing has been written then.

    >>> raise InputError("site.toml: no such file; give the path of a survey's site.toml")
    Traceback (most recent call last):
    vision.contract.errors.InputError: site.toml: no such file; give the path of a survey's site.toml
    """
