"""Titles of effects, and probabilities, within a sentence."""


def lower(title: str) -> str:
    """A title within a sentence; names and abbreviations keep their capitals.

    >>> lower("Gauge length"), lower("AC coupling"), lower("Poisson's ratio")
    ('gauge length', 'AC coupling', "Poisson's ratio")
    """
    return title if title[:2].isupper() or title.startswith("Poisson") else title[:1].lower() + title[1:]


def probability_words(share: float) -> str:
    """A probability for people.

    >>> probability_words(0.973), probability_words(0.0004), probability_words(0.9999)
    ('97 %', 'below 0.1 %', 'above 99.9 %')
    """
    if share > 0.999:
        return "above 99.9 %"
    return "below 0.1 %" if share < 0.001 else f"{100 * share:.2g} %"
