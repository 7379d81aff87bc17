"""How long a fiber may be to be fitted as a whole."""

#: A fiber up to this length is one stretch, m: what a camera sees, where one shift and one weight do for a pass.
ONE_STRETCH = 200.0


def is_one_stretch(length: float) -> bool:
    """Whether a fiber of some length, m, is fitted as a whole.

    >>> is_one_stretch(120.0), is_one_stretch(10_000.0)
    (True, False)
    """
    return length <= ONE_STRETCH
