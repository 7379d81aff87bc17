"""Titles of effects within a sentence."""


def lower(title: str) -> str:
    """A title within a sentence; names and abbreviations keep their capitals.

    >>> lower("Gauge length"), lower("AC coupling"), lower("Poisson's ratio")
    ('gauge length', 'AC coupling', "Poisson's ratio")
    """
    return title if title[:2].isupper() or title.startswith("Poisson") else title[:1].lower() + title[1:]
