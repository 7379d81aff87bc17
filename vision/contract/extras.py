"""Optional packages: what is not installed is told in a line."""

from importlib.util import find_spec

from vision.contract.errors import InputError


def require_extra(extra: str, modules: tuple[str, ...], purpose: str) -> None:
    """Refuse what needs an extra of roadfiber that is not installed.

    Parameters
    ----------
    extra : its name in `pip install 'roadfiber[EXTRA]'`
    modules : that it brings
    purpose : what needs them, as the subject of the message

    Raises
    ------
    InputError
        If one of the modules is not there.

    >>> require_extra("workbench", ("json",), "the page")
    >>> require_extra("workbench", ("no_such_module",), "the page")
    Traceback (most recent call last):
    vision.contract.errors.InputError: the page needs no_such_module; pip install 'roadfiber[workbench]'
    """
    missing = [name for name in modules if find_spec(name) is None]
    if missing:
        raise InputError(f"{purpose} needs {', '.join(missing)}; pip install 'roadfiber[{extra}]'")
