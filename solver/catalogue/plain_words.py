"""An effect in plain words: its title, what is the case, and sizes in a unit that people know."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from solver.catalogue.catalogue import FaultKind
from solver.effect import Effect, Plain, Setting

#: Significant digits of a size at most, also where it is told beside what it should be, and of a sigma.
DIGITS, BESIDE, SIGMA_DIGITS = 3, 4, 2


@dataclass(frozen=True)
class Told:
    """What is told of an effect of some size.

    Parameters
    ----------
    title : two or three words
    sentence : what is the case, with its size
    size, sigma : its size and the standard deviation of that, in `unit`
    detectable : smallest size that the survey would have shown, as a difference from none, in `unit`
    unit : that people know; "" for a pure number
    """

    title: str
    sentence: str
    size: float
    sigma: float
    detectable: float
    unit: str


def rounded(value: float, sigma: float = math.nan, most: int = DIGITS) -> str:
    """A number with the digits that its standard deviation leaves, `most` at most.

    >>> rounded(11.4983, 0.021), rounded(11.4983, 0.021, most=4), rounded(1234.5), rounded(25.0)
    ('11.5', '11.50', '1234', '25')
    """
    if not math.isfinite(value):
        return "-"
    size = int(f"{value:.{most - 1}e}".partition("e")[2])
    if not (math.isfinite(sigma) and sigma > 0):
        return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"
    decimals = min(SIGMA_DIGITS - 1 - math.floor(math.log10(sigma)), most - 1 - size)
    return f"{value:.{max(decimals, 0)}f}"


def with_unit(number: str, unit: str) -> str:
    """A number with its unit; "1" and "" are those of pure numbers.

    >>> with_unit("0.3", "m^2"), with_unit("0.25", "1")
    ('0.3 m²', '0.25')
    """
    return number if unit in ("", "1") else f"{number} {unit.replace('^2', '²')}"


def told(
    effect: Effect | FaultKind,
    setting: Setting,
    *,
    estimate: float,
    sigma: float = math.nan,
    detectable: float = math.nan,
    shape: Mapping[str, float] | None = None,
    unit: str | None = None,
) -> Told:
    """What people are told of an effect.

    Parameters
    ----------
    effect : of the catalogue, or a user's own, which may declare nothing for people
    setting : of the survey
    estimate, sigma, detectable : of its first number, see `solver.criticism.candidate.Candidate`
    shape : values of its shape parameters
    unit : of those figures; that of its first number where None

    >>> from solver.catalogue.catalogue import built_in
    >>> here = Setting(gauge_length=10.0, channel_spacing=1.0, x=50.0, along=120.0)
    >>> one = told(built_in()["gauge_length"], here, estimate=0.15, sigma=0.002, detectable=0.01)
    >>> one.title, one.sentence, round(one.detectable, 3)
    ('Gauge length', 'The interrogator averages strain over 11.50 m, not over 10 m.', 0.1)
    """
    own, null = first_number(effect)
    plain = effect.plain or Plain(effect.name)
    unit = own if unit is None else unit
    if unit != own:  # a number of another kind, which says nothing of the declared size
        plain = Plain(plain.title)

    def sized(value: float) -> float:
        return plain.size(value, setting)

    size, none = sized(estimate), sized(null)
    spread = abs(sized(estimate + sigma) - sized(estimate - sigma)) / 2 if math.isfinite(sigma) else math.inf
    seen = sized(null + detectable) if math.isfinite(detectable) else math.inf
    least = abs(seen - none) if math.isfinite(none) else seen
    shown = plain.unit or unit
    sentence = plain.opposite if plain.opposite and size < none else plain.sentence
    digits = rounded(abs(size) if plain.opposite else size, spread, BESIDE if "{told}" in sentence else DIGITS)
    values = {"size": with_unit(digits, shown)}
    values |= {"told": with_unit(f"{none:g}", shown)} | placed(shape or {}, setting) | shaped(effect, shape or {})
    words = sentence.format_map(values) if sentence else effect.physics
    return Told(plain.title, words, size, spread, least, "" if shown == "1" else shown)


def first_number(effect: Effect | FaultKind) -> tuple[str, float]:
    """Unit and null of its first number."""
    if isinstance(effect, FaultKind):
        return effect.unit, 0.0
    first = effect.amplitudes[0]
    return first.unit, first.null


def placed(shape: Mapping[str, float], setting: Setting) -> dict[str, str]:
    """Where it is, along the road and along the fiber; a place is told from the middle."""
    at = shape.get("place", 0.0)
    return {"x": f"{setting.x + at:.0f} m", "along": f"{setting.along + at:.0f} m"}


def shaped(effect: Effect | FaultKind, shape: Mapping[str, float]) -> dict[str, str]:
    """Values of all shape parameters with their units."""
    if isinstance(effect, FaultKind):
        return {}
    return {p.name: with_unit(f"{shape.get(p.name, p.grid[0]):.3g}", p.unit) for p in effect.shapes}
