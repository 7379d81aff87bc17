"""Distance of a located route from the true one."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np


@dataclass(frozen=True)
class RouteError:
    """Distance between located and true positions of the same channels, m.

    Attributes
    ----------
    largest, mean : in space
    largest_lateral, largest_depth : of the horizontal distance and of the difference in depth
    channels : how many were compared
    """

    largest: float
    mean: float
    largest_lateral: float
    largest_depth: float
    channels: int


def route_error(route_csv: str | Path, truth_json: str | Path) -> RouteError:
    """Compare `route.csv` of a run with the `truth.json` of a simulated survey over the channels in view.

    Channels that the route lacks are neither compared nor counted in `channels`.
    """
    import pandas as pd

    known = json.loads(Path(truth_json).read_text(encoding="utf-8"))
    first, last = known["active_channels"]
    located = pd.read_csv(route_csv, usecols=["channel", "x", "y", "z"])
    located = located[located["channel"].between(first, last)]
    true = np.array(known["route_xyz"])[located["channel"].to_numpy(int)]
    error = located[["x", "y", "z"]].to_numpy(float) - true
    distance = np.linalg.norm(error, axis=1)
    return RouteError(
        float(distance.max()),
        float(distance.mean()),
        float(np.linalg.norm(error[:, :2], axis=1).max()),
        float(np.abs(error[:, 2]).max()),
        len(error),
    )
