"""Whether the content of a run folder can be that of one run: numbers are finite, in order, and agree."""

import unicodedata
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from solver.run.arrays import Arrays, UnfitError
from solver.survey.anchors import Anchor

if TYPE_CHECKING:
    from solver.fit.problem import Problem

#: Largest number of a place or speed, m and m/s, and of a channel or sample.
FARTHEST, HIGHEST = 1e8, 10**9
#: Arrays that have a number everywhere, with the least and the largest it may be.
WITHIN: dict[str, tuple[float, float]] = {
    "time": (-FARTHEST, FARTHEST),
    "channel": (-HIGHEST, HIGHEST),
    "distance": (-FARTHEST, FARTHEST),
    "route": (-FARTHEST, FARTHEST),
    "vector": (-1e300, 1e300),
    "samples": (0, HIGHEST),
    "fitted_channel": (-HIGHEST, HIGHEST),
    "noise": (1e-300, 1e300),
    "weight": (0, 1),
    "start": (-FARTHEST, FARTHEST),
    "law_own": (-1e6, 1e6),
    "law_common": (-1e6, 1e6),
    "law_across": (-1e6, 1e6),
    "law_hidden": (-1e6, 1e6),
} | {
    f"{prefix}_{name}": limits
    for prefix in ("pass", "fitted_pass")
    for name, limits in {
        "rows": (0, HIGHEST),
        "position": (-FARTHEST, FARTHEST),
        "velocity": (-FARTHEST, FARTHEST),
        "sigma": (0, FARTHEST),
        "count": (1, HIGHEST),
        "offset": (0, FARTHEST),
    }.items()
}
#: Those that have numbers or NaN, which says that a number is not known.
PARTLY: dict[str, tuple[float, float]] = {
    "covariance": (-1e16, 1e16),
    "tails": (-1e16, 1e16),
    "added": (-1e16, 1e16),
    "data_share": (-1e6, 1e6),
    "model": (-1e30, 1e30),
    "record": (-1e30, 1e30),
} | {f"{prefix}_{name}": (1e-6, 1e6) for prefix in ("pass", "fitted_pass") for name in ("length", "wheelbase")}
#: Arrays whose numbers rise.
RISING = ("time", "channel", "samples", "fitted_channel")
#: By how many times the fiber's length a route may reach away from itself.
STRAYING = 10


def require(holds: object, words: str) -> None:
    """Raise `UnfitError` with these words where something does not hold."""
    if not holds:
        raise UnfitError(words)


def check_arrays(arrays: Arrays) -> None:
    """Refuse arrays that are of no run.

    Raises
    ------
    UnfitError
        Names the first array with a number that cannot be, or that contradicts another.
    """
    for name, (least, most) in (WITHIN | PARTLY).items():
        value = arrays[name]
        fits = (value >= least) & (value <= most)
        if name in PARTLY:
            fits |= np.isnan(value)
        require(fits.all(), f"{name} has a number that it cannot have")
    for name in RISING:
        require((np.diff(arrays[name]) > 0).all(), f"{name} does not rise throughout")
    channel, samples, moments = arrays["channel"], arrays["samples"], len(arrays["record"])
    require(channel[-1] - channel[0] == len(channel) - 1, "channel leaves some out")
    require(np.isin(arrays["fitted_channel"], channel).all(), "fitted_channel has one that is not in channel")
    require(samples[-1] < moments, "samples has one beyond the record")
    for name in ("covariance", "added"):
        variance = np.diagonal(arrays[name], axis1=1, axis2=2)
        require((np.isnan(variance) | (variance >= 0)).all(), f"{name} has a negative variance")
    own, across = arrays["law_own"], arrays["law_across"]
    require(
        own[0] > 0 and (np.abs(own) <= 1.001 * own[0]).all() and across[0] > 0, "law_own is not a covariance of noise"
    )
    hidden, whole = arrays["law_hidden"], own[0] + arrays["law_common"][0]
    require(len(hidden) <= moments and (np.abs(hidden) <= hidden[0]).all(), "law_hidden is not a covariance of noise")
    require(hidden[0] <= 1.001 * whole, "law_hidden is more than all noise")
    for prefix in ("pass", "fitted_pass"):
        check_passes(arrays, prefix, moments)
    require(np.isin(arrays["fitted_pass_rows"], samples).all(), "fitted_pass_rows has one that is not in samples")


def check_passes(arrays: Arrays, prefix: str, moments: int) -> None:
    """Refuse passes that do not follow each other sample by sample within a record of so many moments."""
    rows, count = arrays[f"{prefix}_rows"], arrays[f"{prefix}_count"]
    require(count.sum() == len(rows), f"{prefix}_count does not add up to the rows of {prefix}_rows")
    require(rows.max() < moments, f"{prefix}_rows has one beyond the record")
    first = np.zeros(len(rows), bool)
    first[np.cumsum(count)[:-1]] = True
    require((first[1:] | (np.diff(rows) == 1)).all(), f"{prefix}_rows leaves samples out")
    for name in ("track_id", "class"):
        text = "".join(arrays[f"{prefix}_{name}"].tolist())
        plain = not any(unicodedata.category(letter) in ("Cc", "Cs") for letter in text)
        require(plain, f"{prefix}_{name} has a character that is not text")


def check_agreement(problem: "Problem", arrays: Arrays, anchors: Sequence[Anchor], sampling_rate: float) -> None:
    """Refuse numbers of fit.json that contradict the arrays: what is computed from them could be of any size.

    Parameters
    ----------
    problem : as read
    arrays : of the run
    anchors : of the run
    sampling_rate : as the run's settings say, Hz
    """
    channel, length = arrays["channel"], len(arrays["channel"]) * problem.channel_spacing
    require(problem.gauge_length < length, "the gauge is longer than the route")
    fitted, (first, last) = arrays["fitted_channel"], problem.recorded
    require(first <= fitted[0] and fitted[-1] <= last, "a fitted channel is not in the record")
    ends = channel[0] - 1, channel[-1] + 1
    require(all(ends[0] <= one.channel <= ends[1] for one in anchors), "an anchor is at none of the channels")
    require(problem.basis.size <= 8 * len(channel) + 100, "the route has more knots than its channels can place")
    for name in ("start", "route"):
        extent = np.ptp(arrays[name], axis=0).max()
        require(extent <= STRAYING * length, f"{name} reaches farther than its fiber is long")
    require(problem.sampling_rate == sampling_rate, "the sampling rates of settings and problem differ")
    samples = arrays["samples"]
    if len(samples) > 1:
        lasted = float(np.ptp(problem.time_of(samples)))
        require(abs(np.ptp(arrays["time"]) - lasted) <= 0.01 * lasted, "time does not go with the sampling rate")
