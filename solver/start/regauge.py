"""Records of very long gauges as short ones would have made them: what the matched filter can look for.

A gauge of 50 m senses a vehicle at either end, 50 m apart, and nothing between: one vehicle looks like two. Its strain
rate is the difference of the ground's velocity along the fiber at its two ends. Summed from the fiber's start, where
nothing moves, in steps of a gauge, that gives the velocity everywhere, and so what a short gauge would see. Noise adds
up along with it: this is for the first look only, and fits take the record as it is.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from solver.survey.das.record import DASRecord

Array = NDArray[np.float64]

#: Gauges longer than this, m, are taken apart, and into gauges of this length.
LONG, SHORT = 25.0, 10.0


def shorter_gauges(record: DASRecord) -> DASRecord:
    """The record as gauges of 10 m would have made it, where its own are over 25 m; else itself."""
    spacing = record.channel_spacing
    if record.gauge_length <= LONG or record.gauge_length >= 0.5 * spacing * len(record.channel):
        return record
    gauge, short = round(record.gauge_length / spacing), max(1, round(SHORT / spacing))
    shorter = shortened_gauges(record.strain_rate.astype(np.float64), gauge, short)
    return replace(record, strain_rate=shorter, gauge_length=short * spacing)


def shortened_gauges(strain_rate: Array, gauge: int, short: int) -> Array:
    """Strain rate [sample, channel] of gauges of `short` channels, from that of gauges of `gauge` channels.

    The fiber is taken to lie still before its first channel. NaN where not measured.

    >>> velocity = np.exp(-0.5 * ((np.arange(400) - 200.0) / 4) ** 2)[None]
    >>> def measured(gauge):
    ...     half = gauge // 2
    ...     return (velocity[:, 60 + half : 340 + half] - velocity[:, 60 - half : 340 - half]) / gauge
    >>> bool(np.allclose(shortened_gauges(measured(50), 50, 10), measured(10), atol=1e-12))
    True
    """
    seen = np.isfinite(strain_rate)
    filled = np.where(seen, strain_rate, 0.0)
    rows, channels = filled.shape
    # At place c + gauge / 2, the velocity is that a gauge before plus what channel c saw.
    half, near = gauge // 2, short // 2
    velocity = np.zeros((rows, channels + gauge + near))
    for first in range(0, channels, gauge):
        here = slice(first, min(first + gauge, channels))
        count = here.stop - first
        velocity[:, gauge + first : gauge + here.stop] = velocity[:, first : first + count] + gauge * filled[:, here]
    ends = velocity[:, channels + gauge - 1 : channels + gauge]
    velocity[:, channels + gauge :] = ends
    # Column i of `velocity` is at place i - gauge + half of the channels.
    at = np.arange(channels) + gauge - half
    shorter = (velocity[:, at + near] - velocity[:, at - near]) / short
    # Constant along the fiber: what the start of each step carries on.
    return np.where(seen, shorter - np.median(shorter, axis=1, keepdims=True), np.nan)
