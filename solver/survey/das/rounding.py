"""Numbers that were rounded before they were stored: the rounding step and its error."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from solver.survey.das.units import Unit, to_strain_rate

Array = NDArray[np.float64]

#: Values of a channel that are examined, and the share of them that must be whole multiples of a step.
LOOKED_AT, WHOLE = 4000, 0.9
#: How far a value may be from a whole multiple, in steps, and the finest step, as a share of the largest value: below
#: it the digits of single precision look like a step too.
OFF, FINEST = 0.05, 1e-5
#: Quantiles of the distances between values that are tried as a step, and multiples with which it is refined.
CANDIDATES, REACHES = (0.25, 0.1, 0.02, 0.0), (10.0, 100.0, np.inf)
#: Distinct values that a channel needs to show its own step; with fewer it takes that of the others.
ENOUGH = 8
#: Channels that are examined first.
FIRST = 64
#: Step, as a share of the noise, from which on it is reported: it makes a fiftieth of the noise variance.
COARSE = 0.5
#: Samples on either side over which the error of one sample spreads by differentiation.
SPREAD = 20


@dataclass(frozen=True)
class Rounding:
    """Error of rounded numbers (Bennett 1948), taken as uniform over a step, as it is under a signal or noise.

    Parameters
    ----------
    step : [channel], 1/s: sqrt(12) times the error's standard deviation; 0 where nothing was rounded
    law : [lag], autocorrelation of the error in time; (1,) where the stored numbers are strain rate
    whole : whether the record's numbers are still multiples of the step
    """

    step: Array
    law: Array
    whole: bool = True

    @property
    def deviation(self) -> Array:
        """Standard deviation [channel] of the error, 1/s."""
        return self.step / np.sqrt(12)

    def at(self, columns: NDArray[np.int64] | NDArray[np.bool_]) -> "Rounding":
        """The rounding of some channels."""
        return replace(self, step=self.step[columns])

    def filtered(self, taps: Array, factor: int) -> "Rounding":
        """The rounding error of a record filtered with `taps` [tap] of which every `factor`-th sample is kept.

        >>> fewer = Rounding(np.ones(1), np.ones(1)).filtered(np.full(4, 0.25), 4)
        >>> fewer.step.tolist(), fewer.law.round(3).tolist(), fewer.whole
        ([0.5], [1.0], False)
        """
        both = np.convolve(np.concatenate([self.law[:0:-1], self.law]), np.correlate(taps, taps, "full"))
        gain, law = normalized(both[len(both) // 2 :: factor])
        return Rounding(self.step * gain, law, False)


def normalized(covariance: Array) -> tuple[float, Array]:
    """Standard deviation and autocorrelation [lag] of an autocovariance [lag], without its negligible tail."""
    law = covariance / covariance[0]
    return float(np.sqrt(covariance[0])), law[: np.flatnonzero(np.abs(law) > 1e-3)[-1] + 1]


def step_of(values: ArrayLike) -> float:
    """Step of which values [sample] are whole multiples; 0 if there is none, or too few values differ.

    >>> rng = np.random.default_rng(0)
    >>> noise = rng.normal(0, 3, 1000)
    >>> round(step_of(0.1 * np.rint(noise / 0.1)), 6), step_of(noise)
    (0.1, 0.0)
    >>> round(step_of((2.0 * np.rint(noise)).astype(np.float32)), 6)  # counts that skip every second number
    2.0
    """
    values = np.asarray(values, float)
    several, often = np.unique(values, return_counts=True)
    finest = FINEST * float(np.abs(several).max(initial=0.0))
    if len(several) < ENOUGH:
        return 0.0
    # Neighboring values are a step apart; if some are corrupt, many still are a step from the most frequent one.
    for apart in (np.diff(several), np.abs(values - several[often.argmax()])):
        apart = apart[apart > finest]
        for step in np.quantile(apart, CANDIDATES, method="lower").tolist() if len(apart) else ():
            step = refined(step, several)
            whole, moved = np.abs(values / step - np.rint(values / step)) < OFF, np.rint(values / step) != 0
            # Between loud vehicles, quiet values are near zero anyway: larger values must be multiples too.
            if whole.mean() >= WHOLE and moved.sum() >= ENOUGH and whole[moved].mean() >= WHOLE:
                return step
    return 0.0


def refined(step: float, several: Array) -> float:
    """Refine a roughly known step with values [value] that are multiples of it, from small ones outward."""
    for reach in REACHES:
        count = np.rint(several / step)
        near = (np.abs(count) <= reach) & (count != 0) & (np.abs(several / step - count) < 2 * OFF)
        if near.any():
            step = float(several[near] @ count[near] / (count[near] @ count[near]))
    return step


def steps_of(values: NDArray[Any]) -> Array:
    """Rounding step [channel] of stored values [time, channel]; 0 where nothing was rounded."""
    some = values[:: max(1, len(values) // LOOKED_AT)]
    finite = np.isfinite(some).all(axis=1)
    some = some if finite.all() else some[finite]
    # All channels come from one instrument: if none of many is rounded, none is.
    first = np.unique(np.linspace(0, some.shape[1] - 1, FIRST).astype(int))
    if some.shape[1] > FIRST and not any(step_of(some[:, column]) for column in first):
        return np.zeros(some.shape[1])
    step = np.array([step_of(column) for column in some.T])
    alike = bool(np.mean(step > 0) > 0.5)
    # A quiet channel shows too few values: it takes the step of the others.
    few = np.array([len(np.unique(column)) < ENOUGH for column in some.T])
    return np.where((step == 0) & few & alike, np.median(step[step > 0]) if alike else 0.0, step)


def rounding_of(values: NDArray[Any], unit: Unit, sampling_rate: float, gauge_length: float) -> Rounding | None:
    """Rounding of a record from its stored values [time, channel]; None if no channel was rounded.

    >>> strain = 1e-9 * np.rint(np.random.default_rng(0).normal(0, 3, (500, 1)))
    >>> found = rounding_of(strain, Unit("strain"), 5.0, 10.0)
    >>> found.step.round(10), found.law[:3].round(2), found.whole
    (array([5.9e-09]), array([ 1.  , -0.27, -0.39]), False)
    """
    step = steps_of(values)
    if not step.any():
        return None
    impulse = np.zeros((2 * SPREAD + 1, 1))
    impulse[SPREAD] = 1.0
    response = to_strain_rate(impulse, unit, sampling_rate, gauge_length)[:, 0]
    gain, law = normalized(np.correlate(response, response, "full")[2 * SPREAD :])
    return Rounding(step * gain, law, len(law) == 1)


def dithered(values: Array, rounding: Rounding | None) -> Array:
    """Dither values [time, channel]: spread them evenly over their rounding step, if it is coarse.

    A median-based noise estimate takes rounded noise for silence, and a single step away from it for a vehicle.
    """
    if rounding is None:
        return values
    middle = np.array([np.median(one[np.isfinite(one)]) if np.isfinite(one).any() else 0.0 for one in np.abs(values).T])
    coarse = np.flatnonzero(rounding.step > 0.1 * middle)
    out, rng = values.copy(), np.random.default_rng(0)
    out[:, coarse] += rounding.step[coarse] * rng.uniform(-0.5, 0.5, (len(values), len(coarse)))
    return out


def told(rounding: Rounding, noise: Array) -> list[str]:
    """What to tell the user about rounding steps, given the noise [channel], 1/s; nothing if the steps are fine.

    >>> told(Rounding(np.array([2e-9, 2e-9]), np.ones(1)), np.array([2e-9, 2e-9]))
    ['the record is rounded to steps of 2e-09 1/s, 1.0 of its noise; that is counted as noise: export more digits']
    >>> told(Rounding(np.array([2e-9, 2e-9]), np.ones(1)), np.array([9e-9, 9e-9]))
    []
    """
    if (share := float(np.median(rounding.step / noise))) < COARSE:
        return []
    line = (
        f"the record is rounded to steps of {float(np.median(rounding.step)):.2g} 1/s, {share:.1f} of its noise; "
        "that is counted as noise: export more digits"
    )
    return [line]
