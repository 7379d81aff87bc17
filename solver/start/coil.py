"""Fiber that lies coiled in a manhole: beyond it vehicles are recorded by channels farther along than one line says."""

from dataclasses import dataclass, replace

import numpy as np

from solver.start.fiber_line import FiberLine, ransac_line, tolerance
from solver.start.wavelets import Array

#: Shortest and longest coil that is looked for, m: a shorter one is within the tolerance of one line.
LENGTHS = (6.0, 60.0)
#: Share by which a coil must raise the number of detections on a line, and by how many at least.
MORE, FEWEST = 0.2, 20


@dataclass(frozen=True)
class JumpingLine:
    """A line with a jump.

    Parameters
    ----------
    line : of the channels before the coil
    channel : middle of the channels where it may jump, as those that lie coiled sense nothing
    coiled : channels that lie coiled
    """

    line: FiberLine
    channel: int
    coiled: float

    @property
    def beyond(self) -> FiberLine:
        """Line of the channels beyond the coil."""
        return replace(self.line, x0=self.line.x0 - self.line.slope * self.coiled)


def find_coil(line: FiberLine, x: Array, speed: Array, channel: Array, channel_spacing: float) -> JumpingLine | None:
    """Find where, and by how much, the detections jump from one line to a parallel one.

    Lines are those through all detections, and through those on the lower and on the upper half of the channels; the
    jump is searched for over all places and lengths.

    Parameters
    ----------
    line : through all
    x, speed, channel : of the detections [detection], m, m/s, index

    Returns
    -------
    found : None where one line explains nearly as many

    >>> rng = np.random.default_rng(0)
    >>> channel = np.repeat(np.arange(0.0, 100.0), 4)
    >>> x = channel - 20.0 * (channel > 60) + rng.normal(0, 0.5, 400)
    >>> found = find_coil(FiberLine(0.0, 1.0, 0.0), x, np.full(400, 12.0), channel, 1.0)
    >>> found.channel, round(found.coiled)
    (60, 20)
    """
    middle = np.median(channel)
    halves = (
        ransac_line(x[half], speed[half], channel[half], channel_spacing)[0]
        for half in (channel < middle, channel > middle)
    )
    lines = [line, *(one for one in halves if one is not None and one.slope * line.slope > 0)]
    order = np.argsort(channel)
    along = channel[order]
    plain, best, found = 0, 0, None
    for one in lines:
        late = (channel - one.channel_of(x, speed))[order]
        near = tolerance(channel_spacing) / abs(one.slope)
        on = np.cumsum(np.abs(late) < near)
        plain = max(plain, int(on[-1]))
        for coiled in np.arange(*np.divide(LENGTHS, channel_spacing)):
            # The line may be that of either side.
            for sign in (1, -1):
                off = np.cumsum(np.abs(late - sign * coiled) < near)
                first, second = (on, off) if sign > 0 else (off, on)
                total = first + second[-1] - second
                cut, end = int(total.argmax()), len(total) - 1 - int(total[::-1].argmax())
                least = min(int(first[cut]), int(second[-1] - second[cut]))
                if total[cut] > best and least >= FEWEST:
                    before = one if sign > 0 else replace(one, x0=one.x0 + one.slope * coiled)
                    place = round((along[cut] + along[min(end + 1, len(along) - 1)]) / 2)
                    best, found = int(total[cut]), JumpingLine(before, place, float(coiled))
    return found if best > (1 + MORE) * plain else None
