"""Which channel lies beside which place of the road: one line through the detections of all passes."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solver.start.wavelets import Array

TOLERANCE = 2.5  # m, of a detection about the line: long vehicles and jitter of weak ones
COARSE = 0.75  # channels that it may be off as well: between coarse channels a peak is a guess
SLOPES = (0.6, 1.1)  # dx per meter of fiber: slack and a fiber askew to the road make less than 1
LARGEST_LAG = 20.0  # s
CLOCK = 2.0  # s of clock error that a survey can bear


def tolerance(channel_spacing: float) -> float:
    """How far a detection may be off the line, m.

    >>> tolerance(1.0), round(tolerance(5.1), 3)
    (2.5, 3.825)
    """
    return max(TOLERANCE, COARSE * channel_spacing)


@dataclass(frozen=True)
class FiberLine:
    """Straight relation x + speed lag = x0 + slope channel between vehicles and the channels beside them.

    Parameters
    ----------
    x0 : x of channel 0, m
    slope : m of road per channel; negative for a fiber that runs against +x
    lag : how far the clock of the trajectories is ahead of that of the DAS, s; 0 where all vehicles go one way, since
        they cannot tell it from a shift of the fiber
    """

    x0: float
    slope: float
    lag: float

    @classmethod
    def from_estimate(cls, x: Array, speed: Array, channel: Array) -> "FiberLine":
        """Least squares over detections [detection]; the smallest lag where they leave it open."""
        matrix = np.stack([np.ones_like(x), channel, -speed], axis=1)
        return cls(*np.linalg.lstsq(matrix, x, rcond=1e-9)[0].tolist())

    def residuals(self, x: Array, speed: Array, channel: Array) -> Array:
        """Return how far ahead of the line's the vehicle is [detection], m."""
        return x + speed * self.lag - self.x0 - self.slope * channel

    def channel_of(self, x: NDArray[Any], speed: NDArray[Any] | float = 0.0) -> Array:
        """Channel, with a fraction, that senses a vehicle said to be at x with a speed, m and m/s."""
        return (x + speed * self.lag - self.x0) / self.slope

    def x_of(self, channel: NDArray[Any]) -> Array:
        """Place beside a channel, m."""
        return self.x0 + self.slope * channel


def ransac_line(
    x: Array, speed: Array, channel: Array, channel_spacing: float
) -> tuple[FiberLine | None, NDArray[np.bool_]]:
    """Find the line that most detections follow (RANSAC), and which ones do [detection].

    Parameters
    ----------
    x, speed, channel : of the detections [detection], m, m/s, number
    channel_spacing : m; the slope must be near it, in either direction, and detections as near as `tolerance` says

    Returns
    -------
    line : None where there is none with a possible slope
    inliers : [detection]

    >>> channel = np.arange(0.0, 60.0)
    >>> speed = np.where(channel % 2, 12.0, -15.0)
    >>> line, _ = ransac_line(80 - channel - 0.2 * speed, speed, channel, 1.0)
    >>> round(line.x0, 3), round(line.slope, 3), round(line.lag, 3)
    (80.0, -1.0, 0.2)
    """
    import warnings

    from skimage.measure import ransac

    def possible(line: FiberLine, *_: Array) -> bool:
        return SLOPES[0] <= abs(line.slope) / channel_spacing <= SLOPES[1] and abs(line.lag) <= LARGEST_LAG

    if len(x) < 3:
        return None, np.zeros(len(x), bool)
    two_way = (speed > 0).any() and (speed < 0).any()
    told = speed if two_way else np.zeros_like(speed)
    with warnings.catch_warnings():
        # It warns where it finds nothing; the caller is told by None.
        warnings.filterwarnings("ignore", module="skimage", category=UserWarning)
        near = tolerance(channel_spacing)
        line, inliers = ransac((x, told, channel), FiberLine, 3, near, is_model_valid=possible, max_trials=1000, rng=0)
    found = line is not None and possible(line)
    return (line, inliers) if found else (None, np.zeros(len(x), bool))
