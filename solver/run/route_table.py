"""The route as a table: one row per channel, meters and degrees."""

from typing import TYPE_CHECKING

import numpy as np

from solver.fit.result import Placed
from vision.contract import LocalFrame

if TYPE_CHECKING:
    import pandas as pd

METERS = ("distance", "x", "y", "z", "sigma_x", "sigma_y", "sigma_z")
OF_FIT = ("sigma_x_fit", "sigma_y_fit", "sigma_z_fit")
DEGREES = ("latitude", "longitude")


def route_table(place: Placed, frame: LocalFrame) -> "pd.DataFrame":
    """The route as a DataFrame.

    Returns
    -------
    table [channel]: `channel`; `distance` along the fiber, `x, y, z` and `sigma_x, sigma_y, sigma_z`, m (NaN where the
    method gives no sigma); `sigma_x_fit` and so on, of the fit alone, which takes its model for granted, where they are
    known; `latitude, longitude`, degrees; `constrained`, false where neither data nor anchors decide; `trust`, the
    grade of the run's checks, and `reason`, why a channel is not to be relied on, or what its corridor leaves out;
    `corner`, where the fiber turns there or goes deeper or less deep, in words. Altitudes are in no column: z is the
    depth below the road.
    """
    import pandas as pd

    latitude, longitude = frame.to_geographic(place.route[:, 0], place.route[:, 1])
    meters = np.column_stack([place.distance, place.route, place.sigma])
    of_fit = {} if place.sigma_fit is None else dict(zip(OF_FIT, place.sigma_fit.T, strict=True))
    corners = {one.channel: one.words for one in place.corners}
    return pd.DataFrame(
        {"channel": place.channel}
        | dict(zip(METERS, meters.T, strict=True))
        | of_fit
        | {"latitude": latitude, "longitude": longitude, "constrained": place.constrained}
        | {"trust": place.grade, "reason": place.reason}
        | {"corner": [corners.get(channel, "") for channel in place.channel.tolist()]}
    )


def route_csv(table: "pd.DataFrame") -> str:
    """route.csv: to a tenth of a millimeter; empty where there is no number."""
    names = [*METERS, *(name for name in OF_FIT if name in table)]
    meters = {name: table[name].map(lambda value: f"{value:.4f}" if np.isfinite(value) else "") for name in names}
    degrees = {name: table[name].map("{:.9f}".format) for name in DEGREES}
    flags = table["constrained"].map(lambda flag: str(bool(flag)).lower())
    text: str = table.assign(**meters, **degrees, constrained=flags).to_csv(index=False, lineterminator="\n")
    return text
