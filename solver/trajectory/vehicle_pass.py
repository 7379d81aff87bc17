"""One vehicle that goes by once."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Pass:
    """One vehicle going by once.

    Parameters
    ----------
    track_id, vehicle_class : as in the trajectory table; the later passes of one track are `7#2`, `7#3`
    rows : indices into the record's `time`, consecutive [row]
    position : x, y of the point under the middle of the wheelbase, m [row, 2]
    velocity : m/s [row, 2]
    sigma : standard deviation of `position`, m [row, 2]; errors of neighboring rows are correlated
    in_view : between the first and the last fix, not extrapolated [row]
    length : of the vehicle, m, where the table says it
    wheelbase : of the vehicle and its standard deviation, m, where the table says them; else its class's counts
    offset : how far the whole of it may be off beyond what tracks are, m, as where no camera saw the vehicle
    """

    track_id: str
    vehicle_class: str
    rows: NDArray[np.int64]
    position: Array
    velocity: Array
    sigma: Array
    in_view: NDArray[np.bool_]
    length: float | None = None
    wheelbase: tuple[float, float] | None = None
    offset: float = 0.0

    @property
    def speed(self) -> float:
        """Median speed in view, m/s; negative for a vehicle going against +x."""
        within = self.velocity[self.in_view] if self.in_view.any() else self.velocity
        return float(np.median(np.hypot(*within.T)) * np.sign(self.position[-1, 0] - self.position[0, 0]))


def track_sigma(passes: Sequence[Pass]) -> float:
    """Uncertainty of the tracks in view by their own account, m: the median over passes."""
    spread = [float(np.sqrt((one.sigma[one.in_view] ** 2).mean())) for one in passes if one.in_view.any()]
    return float(np.median(spread)) if spread else 0.0
