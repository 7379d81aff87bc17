"""Distance of a located route from the true one."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

#: Standard deviations to either side that hold 95 % of a normal distribution.
Z95 = 1.96


@dataclass(frozen=True)
class RouteError:
    """Distance between located and true positions of the same channels, m.

    Attributes
    ----------
    largest, mean : in space, over the channels that the run locates; NaN where it locates none
    largest_lateral, largest_depth : of the horizontal distance and of the difference in depth, likewise
    channels : how many it locates
    inside : how many of them lie within the 95 % corridor, across and in depth
    in_view : the largest in space over all channels in view, located or not; NaN where the run has none of them
    """

    largest: float
    mean: float
    largest_lateral: float
    largest_depth: float
    channels: int
    inside: int
    in_view: float

    @property
    def words(self) -> str:
        """The error in a sentence.

        >>> RouteError(0.5, 0.1, 0.4, 0.2, 93, 88, 0.12).words
        '0.10 m on average over 93 located channels, 0.50 m at most (0.40 on the map, 0.20 in depth; 0.12 in view); 88 \
of 93 lie in the 95 % corridor'
        """
        if not self.channels:
            return f"no place is located, and in view the fit is {self.in_view:.2f} m off at most"
        view = "" if np.isnan(self.in_view) else f"; {self.in_view:.2f} in view"
        return (
            f"{self.mean:.2f} m on average over {self.channels} located channels, {self.largest:.2f} m at most "
            f"({self.largest_lateral:.2f} on the map, {self.largest_depth:.2f} in depth{view}); {self.inside} of "
            f"{self.channels} lie in the 95 % corridor"
        )


def route_error(route_csv: str | Path, truth_json: str | Path) -> RouteError:
    """Compare `route.csv` of a run with the `truth.json` of a simulated survey over all channels that it locates.

    A channel that is not constrained claims no place, and counts in view alone.
    """
    import pandas as pd

    known = json.loads(Path(truth_json).read_text(encoding="utf-8"))
    located = pd.read_csv(route_csv)
    located = located[located["channel"] < len(known["route_xyz"])]
    claimed = located["constrained"].to_numpy(bool)
    true = np.array(known["route_xyz"])[located["channel"].to_numpy(int)].reshape(-1, 3)
    route = located[["x", "y", "z"]].to_numpy(float)
    error, sigma = route - true, located[["sigma_x", "sigma_y", "sigma_z"]].to_numpy(float)
    distance = np.linalg.norm(error, axis=1)
    seen = located["channel"].between(*known["active_channels"]).to_numpy()
    way = np.gradient(route[:, :2], axis=0) if len(route) > 1 else np.ones((len(route), 2))
    across = np.column_stack([-way[:, 1], way[:, 0]]) / np.linalg.norm(way, axis=1, keepdims=True)
    # Across the route by the sigmas of x and y, which the table has without their correlation.
    half = Z95 * np.sqrt(((across * sigma[:, :2]) ** 2).sum(1))
    inside = (np.abs((across * error[:, :2]).sum(1)) <= half) & (np.abs(error[:, 2]) <= Z95 * sigma[:, 2])

    def largest(values: NDArray[np.float64], of: NDArray[np.bool_]) -> float:
        return float(values[of].max()) if of.any() else float("nan")

    return RouteError(
        largest=largest(distance, claimed),
        mean=float(distance[claimed].mean()) if claimed.any() else float("nan"),
        largest_lateral=largest(np.linalg.norm(error[:, :2], axis=1), claimed),
        largest_depth=largest(np.abs(error[:, 2]), claimed),
        channels=int(claimed.sum()),
        inside=int(inside[claimed].sum()),
        in_view=largest(distance, seen),
    )
