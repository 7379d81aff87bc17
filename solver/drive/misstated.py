"""What files may state wrongly of a drive: the gauge length, the channel spacing, and that two clocks run alike.

Each is estimated from what was heard, as if the others were as stated. An estimate m of variance s^2 speaks for an
error of plausible size p, beside what is never exact, w, by the Bayes factor N(m; 0, s^2 + w^2 + p^2) over
N(m; 0, s^2 + w^2).
"""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from solver.catalogue.catalogue import built_in
from solver.drive.along import QUARTZ
from solver.drive.aside import COUNTED, STRETCH, ratios_of
from solver.drive.car import Car
from solver.drive.path import STEP, Path
from solver.drive.quiet import Quiet
from solver.drive.response import REACH, Legs
from solver.effect import STATED, Effect

Array = NDArray[np.float64]

#: The effects that a drive tells of, by name.
TOLD: dict[str, Effect] = {one.name: one for kind in STATED for one in built_in().values() if one.corrects == kind}
GAUGE, SPACING, DRIFT = TOLD
#: Probability of each before the data are asked.
PRIOR = 0.1
#: Probability from which on one is named.
NAMED = 0.95
#: Relative: what ground, wheels and depth that are not quite as modeled make of a gauge; 0.016 rms on training drives.
INEXACT = 0.02
#: Gauge lengths that are compared, as shares beyond what is stated, and depths, m: a deep fiber blurs as a gauge does.
GAUGES = (-0.5, -0.4, -0.3, -0.2, -0.1, 0.0, 0.1, 0.25, 0.4, 0.6, 0.8)
DEPTHS = (0.5, 0.7, 0.9, 1.15, 1.5)
#: Channels that are compared at most, and cells to either side of a channel's in which its best is sought: a fit with a
#: wrong gauge is a little off.
ASKED, SIDE = 150, 1


@dataclass(frozen=True)
class Estimate:
    """What a drive says of a quantity: how far it is from what is stated, and its standard deviation, relative."""

    value: float
    sigma: float


@dataclass(frozen=True)
class Misstated:
    """What may be stated wrongly.

    Parameters
    ----------
    effect : its name in the catalogue
    value, sigma : how far it is from what is stated, and its standard deviation, relative
    shows : size from which on it would be named
    probability : that it is wrong; nan where it is fitted
    fitted : whether it is part of the model
    """

    effect: str
    value: float
    sigma: float
    shows: float
    probability: float
    fitted: bool = False

    @property
    def named(self) -> bool:
        """Whether the drive says that it is wrong."""
        return self.probability >= NAMED

    @classmethod
    def of(cls, effect: str, found: Estimate, inexact: float) -> "Misstated":
        """Weigh an estimate; `inexact`: how far it may be from what is stated with nothing wrong.

        >>> Misstated.of("clock_drift", Estimate(0.004, 0.0005), 2e-5).named
        True
        >>> one = Misstated.of("clock_drift", Estimate(0.001, 0.0005), 2e-5)
        >>> one.named, round(one.shows, 4)
        (False, 0.0019)
        """
        plausible = TOLD[effect].parameters[0].plausible
        within, beyond = found.sigma**2 + inexact**2, found.sigma**2 + inexact**2 + plausible**2
        # ln of the Bayes factor is `gain` times the square of the estimate, less `price`.
        gain, price = (1 / within - 1 / beyond) / 2, np.log(beyond / within) / 2
        odds = np.log(PRIOR / (1 - PRIOR)) + gain * found.value**2 - price
        needed = np.log(NAMED / (1 - NAMED)) - np.log(PRIOR / (1 - PRIOR)) + price
        return cls(
            effect,
            found.value,
            float(np.sqrt(within)),
            shows=float(np.sqrt(needed / gain)),
            probability=float(1 / (1 + np.exp(-np.clip(odds, -700, 700)))),
        )


def gauge_of(quiet: Quiet, path: Path, car: Car, legs: Legs, cell: Array, polarity: int) -> Estimate:
    """By what share the gauge length is off, from the shape of what channels hear.

    Parameters
    ----------
    cell : at which each leg puts each channel; NaN where it is not heard [leg, channel]. Where the GPS is off, all else
        looks blurred, as by a longer gauge
    polarity : of the record

    For each gauge, distances from the car and depths are weighed: one distance for all channels of a stretch on a leg,
    one depth for all. All are compared on the same samples: one that looks farther explains more, be it right or not.
    """
    hear = np.flatnonzero(np.isfinite(cell).any(0))
    some = hear[np.linspace(0, len(hear) - 1, min(ASKED, len(hear))).astype(np.int64)]
    asked = np.full(cell.shape, np.nan)
    asked[:, some] = cell[:, some]
    leg, channel = np.nonzero(np.isfinite(asked))
    stretch = np.floor(cell[leg, channel] * STEP / STRETCH).astype(np.int64)
    group = np.unique(np.stack([leg, stretch]), axis=1, return_inverse=True)[1].reshape(-1)
    reach = REACH + quiet.gauge_length * (1 + GAUGES[-1]) / 2
    log = np.zeros((len(GAUGES), len(DEPTHS)))
    for (number, more), (row, depth) in product(enumerate(GAUGES), enumerate(DEPTHS)):
        other = replace(quiet, gauge_length=quiet.gauge_length * (1 + more))
        ratio = ratios_of(other, path, car, legs, asked, polarity, SIDE, depth, reach)[:, leg, channel]
        sums = np.stack([np.bincount(group, one) for one in ratio])
        log[number, row] = np.logaddexp.reduce(COUNTED * sums, axis=0).sum()
    log = np.logaddexp.reduce(log, axis=1)
    fine = np.linspace(GAUGES[0], GAUGES[-1], 2601)
    curve = CubicSpline(GAUGES, log)(fine)
    weight = np.exp(curve - curve.max())
    weight /= weight.sum()
    mean = float(weight @ fine)
    return Estimate(mean, float(np.sqrt(max(weight @ (fine - mean) ** 2, (fine[1] - fine[0]) ** 2))))


def misstated(found: dict[str, Estimate], length_sigma: float, fitted: tuple[str, ...]) -> list[Misstated]:
    """All that may be stated wrongly, the most probable first; what is part of the model last.

    Parameters
    ----------
    found : an estimate of each, by name
    length_sigma : of the length factor, relative: channels that lie farther apart are less cable per meter of map
    fitted : names of those that are part of the model
    """
    inexact = {GAUGE: INEXACT, SPACING: length_sigma, DRIFT: QUARTZ}
    weighed = [Misstated.of(name, one, inexact[name]) for name, one in found.items()]
    there = [replace(one, probability=float("nan"), fitted=True) if one.effect in fitted else one for one in weighed]
    return sorted(there, key=lambda one: (one.fitted, -one.probability))


def sized(found: list[Misstated], within: list[Misstated]) -> list[Misstated]:
    """The same with the size of what is named from a fit that has it, `within`.

    A fit without it makes its picks as if it were none, so that it finds too little of it.
    """
    size = {one.effect: (one.value, one.sigma) for one in within}
    return [replace(one, value=size[one.effect][0], sigma=size[one.effect][1]) if one.named else one for one in found]
