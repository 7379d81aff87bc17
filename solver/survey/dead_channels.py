"""Dead channels: every test that finds channels which record nothing of the traffic.

A channel that holds a single value throughout is NaN in a record, like an excluded one (`DASRecord.dead`). `repeating`
finds channels that hold one value most of the time; their estimated noise is 0, so no fit uses them. `dead_channels`
finds channels that record almost nothing where their neighbors record traffic: faded, muted, or hanging in the air. A
fit would mistake their silence for a fiber far from the road, the more so the quieter they are. `is_nearly_silent` is
the rule; criticism applies it to a model.
"""

import numpy as np
from numpy.typing import NDArray

from solver.survey.das.record import DASRecord

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

#: Share of its neighbors' signal below which a channel is dead, and by how many sigmas it must be below them.
DEAD, SURE = 0.3, 8.0
#: Most neighbors on either side; signal, in units of the noise, that counts as recorded; and samples of it required.
MOST, HEARD, ENOUGH = 5, 5.0, 10
#: Channels examined together, and how many of the loudest samples of each batch are examined.
TOGETHER, LOUDEST = 400, 1500


def repeating(record: DASRecord, channel: Integers) -> Integers:
    """Numbers of the channels [channel] that hold one value for more than half of the time, gaps aside."""
    told = record.measured[1:] & record.measured[:-1]
    columns = np.searchsorted(record.channel, channel)
    # In batches: with a long fiber, every copy takes a large part of the memory.
    lots = np.array_split(columns, max(1, len(columns) // TOGETHER))
    changing = [(np.abs(np.diff(record.strain_rate[:, lot], axis=0)[told]) > 0).mean(0) for lot in lots]
    return np.asarray(channel[~(np.concatenate(changing) > 0.5)])


def recording(record: DASRecord, channel: Integers, rows: Integers) -> Integers:
    """Numbers of the channels [channel] that are loud at least for some `rows` of the record, those with vehicles."""
    size = np.abs(np.nan_to_num(record.strain_rate[:, np.searchsorted(record.channel, channel)]))
    return np.asarray(channel[(size[rows] > HEARD * 1.4826 * np.median(size, 0)).sum(0) >= ENOUGH])


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
    """Numbers of the channels that are dead.

    Neighbors within half a gauge length record what a channel records. A channel without such neighbors is not judged;
    nor is one with a silent side, as along a coil.

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
    # Traffic is rare enough not to affect the median.
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
