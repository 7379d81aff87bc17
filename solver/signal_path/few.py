"""How many maps are worked on at once."""

#: Values of maps that are computed at once: of all numbers of an effect they may take gigabytes.
AT_ONCE = 1 << 19


def few_of(cells: int) -> int:
    """How many maps of so many values are computed at once.

    >>> few_of(1 << 18), few_of(1 << 30)
    (2, 1)
    """
    return max(1, AT_ONCE // max(cells, 1))
