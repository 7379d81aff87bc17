"""Numbers as people read them."""

from math import floor, isfinite, log10


def with_sigma(value: float, sigma: float) -> str:
    """A number and its standard deviation, rounded to two digits of the latter.

    >>> with_sigma(6368.4, 1596.0), with_sigma(-0.2712, 0.0134), with_sigma(3.8e-5, 1.1), with_sigma(1.5, 0.0)
    ('6400 ± 1600', '-0.271 ± 0.013', '0.0 ± 1.1', '1.5 ± 0')
    >>> with_sigma(1.5, float("nan")), with_sigma(float("nan"), 0.1)
    ('1.5 ± unknown', 'unknown')
    """
    if not isfinite(value):
        return "unknown"
    if not isfinite(sigma):
        return f"{value:.3g} ± unknown"
    if not sigma > 0:
        return f"{value:.6g} ± 0"
    place = 1 - floor(log10(float(f"{sigma:.1e}")))
    rounded = (round(number, place) + 0.0 for number in (value, sigma))  # no -0
    return " ± ".join(f"{number:.{max(place, 0)}f}" for number in rounded)


def at_most(length: float) -> str:
    """Largest length that something may have, m.

    >>> at_most(0.4123), at_most(0.003), at_most(float("nan"))
    ('up to 0.41 m', 'less than 0.01 m', 'an unknown length')
    """
    if not isfinite(length):
        return "an unknown length"
    return f"up to {length:.2f} m" if length >= 0.01 else "less than 0.01 m"


def fall_words(fall: float, form: str = ",.0f") -> str:
    """How chi2 changes, which falls by that much, after its name.

    >>> fall_words(1234.4), fall_words(-6945.0), fall_words(float("nan"))
    ('falls by 1,234', 'rises by 6,945', 'changes by an unknown amount')
    """
    if not isfinite(fall):
        return "changes by an unknown amount"
    return f"{'falls' if fall >= 0 else 'rises'} by {abs(fall):{form}}"
