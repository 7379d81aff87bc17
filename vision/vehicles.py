"""Dimensions and silhouettes of road vehicles by class."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

SAYS_MORE = 0.8  # a length counts as measured if its sd is at most this share of the class's
LEAST_SHARE = 0.1  # of a track's fixes; what is seen as some class in fewer is not taken for one


@dataclass(frozen=True)
class VehicleShape:
    """A class of vehicles, as the corners that bound its silhouette from any side.

    Parameters
    ----------
    size : length, width, height, m
    deviation : sd of each over the class, m
    wheelbase : m
    overhang : of the body ahead of the front axle, m
    outline : corners (along from 0 rear to 1 front, half width, height), as shares of the size; both sides are meant
    axles : how the wheelbase goes with the length: at the length of `size`, m, per m, and the sd about that, m; None
        where it does not (makers' data sheets: `benchmarks/wheelbase.py`)
    """

    size: tuple[float, float, float]
    deviation: tuple[float, float, float]
    wheelbase: float
    overhang: float
    outline: tuple[tuple[float, float, float], ...]
    axles: tuple[float, float, float] | None = None

    def corners(self, size: ArrayLike) -> Array:
        """Corners [corner, 3] of a vehicle of a size (3,), m: x ahead of the wheelbase's middle, y right, z down.

        >>> SHAPES["car"].corners((4.4, 1.8, 1.5))[:2, :2].round(3).tolist()  # where the front wheels touch the road
        [[1.325, 0.873], [1.325, -0.873]]
        """
        length = self.size[0]
        front = (self.wheelbase / 2 + self.overhang) / length
        wheels = [(1 - self.overhang / length, 0.97, 0.0), (1 - (self.overhang + self.wheelbase) / length, 0.97, 0.0)]
        along, across, up = np.repeat([*wheels, *self.outline], 2, axis=0).T
        sides = np.resize([0.5, -0.5], len(along))
        return np.stack([along - 1 + front, across * sides, -up], axis=1) * np.asarray(size, float)

    def wheelbase_of(self, length: float, sigma: float) -> tuple[float, float]:
        """Wheelbase of a vehicle whose length was measured, and its sd, m; NaN where that says no more than the class.

        >>> [round(value, 3) for value in SHAPES["car"].wheelbase_of(4.8, 0.1)]
        [2.842, 0.059]
        """
        if self.axles is None or sigma > SAYS_MORE * self.deviation[0]:
            return np.nan, np.nan
        usual, slope, spread = self.axles
        return usual + slope * (length - self.size[0]), float(np.hypot(spread, slope * sigma))

    def half_extent(self, heading: Array, direction: Array) -> Array:
        """Half of the footprint [n] along `direction` for headings [n], rad, both from +x toward +y; m."""
        turn = heading - direction
        return np.asarray(self.size[0] / 2 * np.abs(np.cos(turn)) + self.size[1] / 2 * np.abs(np.sin(turn)))


def shapes_of(name: str, seen: Sequence[str] = ()) -> list[tuple[VehicleShape, float]]:
    """Shapes that a vehicle of class `name` may have, by the classes its fixes were `seen` as, and the share of each.

    A detector that is not sure may not know vans, as those trained on COCO, which see cars, trucks and buses in them.

    >>> [(shape.size[0], share) for shape, share in shapes_of("bus", ["bus", "bus", "bus", "truck", ""])]
    [(12.0, 0.75), (8.0, 0.25), (5.6, 0.1)]
    """
    known = [one for one in seen if one in SHAPES] or [name if name in SHAPES else "vehicle"]
    shares = {one: known.count(one) / len(known) for one in dict.fromkeys(known)}
    shares = {one: share for one, share in shares.items() if share >= LEAST_SHARE}
    if len(shares) > 1:
        shares.setdefault("van", LEAST_SHARE)
    return [(SHAPES[one], share) for one, share in shares.items()]


PASSENGER_CAR = (
    (0.0, 0.97, 0.16), (0.0, 0.97, 0.60), (1.0, 0.93, 0.16), (1.0, 0.93, 0.42), (0.97, 0.93, 0.50),
    (0.74, 0.97, 0.62), (0.22, 0.80, 0.99), (0.58, 0.80, 1.0),
)  # fmt: skip
PANEL_VAN = (
    (0.0, 0.98, 0.12), (0.0, 0.92, 0.97), (0.02, 0.90, 1.0), (0.68, 0.90, 1.0), (0.84, 0.96, 0.58),
    (0.98, 0.93, 0.44), (1.0, 0.93, 0.36), (1.0, 0.93, 0.12),
)  # fmt: skip
BOX_TRUCK = (
    (0.0, 0.70, 0.14), (0.0, 1.0, 0.28), (0.0, 1.0, 1.0), (0.735, 1.0, 1.0), (0.735, 1.0, 0.28), (0.94, 0.91, 0.80),
    (1.0, 0.95, 0.42), (1.0, 0.95, 0.12),
)  # fmt: skip
CITY_BUS = (
    (0.0, 0.98, 0.10), (0.0, 0.96, 0.95), (0.02, 0.92, 0.98), (0.35, 0.55, 1.0), (0.60, 0.55, 1.0),
    (0.97, 0.92, 0.98), (0.99, 0.95, 0.93), (1.0, 0.97, 0.36), (1.0, 0.97, 0.10),
)  # fmt: skip
RIDER = (
    (0.0, 0.35, 0.40),
    (1.0, 0.15, 0.30),
    (0.72, 1.0, 0.65),
    (0.35, 0.70, 0.45),
    (0.40, 0.35, 1.0),
    (0.5, 0.3, 1.0),
)

SHAPES = {
    "car": VehicleShape((4.4, 1.8, 1.5), (0.35, 0.08, 0.12), 2.65, 0.88, PASSENGER_CAR, (2.682, 0.40, 0.044)),
    "van": VehicleShape((5.6, 2.0, 2.3), (0.63, 0.1, 0.25), 3.40, 0.95, PANEL_VAN, (3.530, 0.63, 0.19)),
    "truck": VehicleShape((8.0, 2.4, 3.2), (1.5, 0.15, 0.4), 4.60, 1.40, BOX_TRUCK),
    "bus": VehicleShape((12.0, 2.5, 3.1), (1.0, 0.06, 0.2), 5.90, 2.70, CITY_BUS),
    "motorcycle": VehicleShape((2.2, 0.8, 1.6), (0.2, 0.12, 0.15), 1.40, 0.40, RIDER),
    "bicycle": VehicleShape((1.8, 0.6, 1.7), (0.1, 0.1, 0.15), 1.05, 0.38, RIDER),
    "vehicle": VehicleShape((4.6, 1.85, 1.6), (0.8, 0.15, 0.3), 2.75, 0.90, PASSENGER_CAR),
}
