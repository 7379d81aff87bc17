"""Dead channels: every test by which a channel counts as one that tells nothing of the traffic.

Channels of one number only are NaN in a record, as excluded ones are (`DASRecord.dead`). `repeating` ones hold the same
number most of the time; their noise is 0, so that no fit takes them. `dead_channels` are nearly silent where those
on either side hear: faded, muted, or hanging in the air. A fit would take their silence for a fiber far away, and the
more so the quieter they are. `is_nearly_silent` is the rule; criticism applies it to a model.
"""

import numpy as np
from numpy.typing import NDArray

from solver.survey.das.record import DASRecord

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

#: Share of what its neighbors hear below which a channel is dead, and sigmas by which it must be below all.
DEAD, SURE = 0.3, 8.0
#: Neighbors on either side at most, times the noise at which they hear something, and samples of that.
MOST, HEARD, ENOUGH = 5, 5.0, 10
#: Channels that are looked at together, and the loudest samples of each lot that are.
TOGETHER, LOUDEST = 400, 1500


def repeating(record: DASRecord, channel: Integers) -> Integers:
    """Numbers of those of some channels [channel] that repeat a number for more than half of the time, gaps aside."""
    told = record.measured[1:] & record.measured[:-1]
    columns = np.searchsorted(record.channel, channel)
    # Lot by lot: of a long fiber every copy is a large part of the memory.
    lots = np.array_split(columns, max(1, len(columns) // TOGETHER))
    changing = [(np.abs(np.diff(record.strain_rate[:, lot], axis=0)[told]) > 0).mean(0) for lot in lots]
    return np.asarray(channel[~(np.concatenate(changing) > 0.5)])


def is_nearly_silent(gain: Array, sigma: Array, usual: Array | float = 1.0) -> NDArray[np.bool_]:
    """Which channels [channel] surely record only a small share of the usual signal.

    Parameters
    ----------
    gain, sigma : [channel], share of the signal that a channel records, and its standard deviation
    usual : share that other channels record

    >>> is_nearly_silent(np.array([0.1, 0.1, 0.5]), np.array([0.01, 0.2, 0.01])).tolist()
    [True, False, False]
    """
    return np.asarray((np.abs(gain) < DEAD * usual) & (gain + SURE * sigma < usual))


def dead_channels(record: DASRecord, channel: Integers) -> Integers:
    """Numbers of those of some channels that are dead.

    Neighbors within half a gauge length hear what a channel does. Where there are none, nothing is told; nor where one
    side is silent too, as along a coil.

    Parameters
    ----------
    channel : [channel], numbers to look at, ascending
    """
    reach = min(int(record.gauge_length / 2 / record.channel_spacing), MOST)
    found = [np.empty(0, np.int64)]
    for run in np.split(channel, np.flatnonzero(np.diff(channel) != 1) + 1) if reach else ():
        for first in range(0, len(run), TOGETHER):
            lot = run[max(0, first - reach) : first + TOGETHER + reach]
            values = record.strain_rate[:, np.searchsorted(record.channel, lot)][record.measured].astype(np.float64)
            found.append(lot[dead(values, reach) & np.isin(lot, run[first : first + TOGETHER])])
    return np.concatenate(found)


def dead(values: Array, reach: int) -> NDArray[np.bool_]:
    """Which channels of [sample, channel] are nearly silent where up to `reach` channels on either side are not.

    >>> rng = np.random.default_rng(0)
    >>> passing = np.exp(-((np.arange(200)[:, None] - 4 * np.arange(30)) ** 2) / 200)
    >>> passing[:, 20] *= 0.1
    >>> np.flatnonzero(dead(passing + 0.01 * rng.normal(size=(200, 30)), 4)).tolist()
    [20]
    """
    # Traffic is rare enough for the median to bear it.
    level = 1.4826 * np.median(np.abs(np.nan_to_num(values)), 0)
    scaled = np.abs(np.nan_to_num(values)) / np.maximum(level, 1e-300)
    loudest = np.argsort(-np.minimum(scaled, 1e3).mean(1))[:LOUDEST]
    here = values[loudest]
    gains = [heard(here, level, way * np.arange(1, reach + 1)) for way in (-1, 1)]
    return np.asarray(np.all([is_nearly_silent(gain, sigma) for gain, sigma in gains], 0))


def heard(values: Array, level: Array, steps: Integers) -> tuple[Array, Array]:
    """Each channel's signal [channel] as a share of that of neighbors some steps away, and its sigma; inf: unknown."""
    channels = values.shape[1]
    at = np.arange(channels)[:, None] + steps
    inside = (at >= 0) & (at < channels)
    beside = np.where(inside, values[:, np.clip(at, 0, channels - 1)], np.nan)
    told = np.isfinite(beside).any(-1) & np.isfinite(values)
    middle = np.nanmedian(np.where(told[..., None], beside, 0.0), -1)
    noise = np.median(np.where(inside, level[np.clip(at, 0, channels - 1)], 0.0), -1)
    loud = told & (np.abs(middle) > HEARD * noise)
    power = np.where(loud, middle**2, 0.0).sum(0)
    gain = np.where(loud, middle * np.nan_to_num(values), 0.0).sum(0) / np.maximum(power, 1e-300)
    error = np.where(loud, np.nan_to_num(values) - gain * middle, 0.0)
    spread = np.sqrt((error**2).sum(0) / np.maximum(loud.sum(0) - 1, 1))
    sigma = np.maximum(spread, level) / np.sqrt(np.maximum(power, 1e-300))
    return gain, np.where(loud.sum(0) >= ENOUGH, sigma, np.inf)
