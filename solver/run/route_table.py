"""The route as a table: one row per channel, meters and degrees."""

from typing import TYPE_CHECKING

import numpy as np

from solver.fit.result import FitResult, Placed
from vision.contract import LocalFrame

if TYPE_CHECKING:
    import pandas as pd

METERS = ("distance", "x", "y", "z", "sigma_x", "sigma_y", "sigma_z")
DEGREES = ("latitude", "longitude")


def route_table(result: FitResult | Placed, frame: LocalFrame) -> "pd.DataFrame":
    """The route as a DataFrame.

    Returns
    -------
    table [channel]: `channel`; `distance` along the fiber, `x, y, z` and `sigma_x, sigma_y, sigma_z`, m (NaN where the
    method gives no sigma); `latitude, longitude`, degrees; `constrained`, false where neither data nor anchors decide.
    Altitudes are in no column: z is the depth below the road.
    """
    import pandas as pd

    latitude, longitude = frame.to_geographic(result.route[:, 0], result.route[:, 1])
    meters = np.column_stack([result.distance, result.route, result.sigma])
    return pd.DataFrame(
        {"channel": result.channel}
        | dict(zip(METERS, meters.T, strict=True))
        | {"latitude": latitude, "longitude": longitude, "constrained": result.constrained}
    )


def route_csv(table: "pd.DataFrame") -> str:
    """route.csv: to a tenth of a millimeter; empty where there is no number."""
    meters = {name: table[name].map(lambda value: f"{value:.4f}" if np.isfinite(value) else "") for name in METERS}
    degrees = {name: table[name].map("{:.9f}".format) for name in DEGREES}
    flags = table["constrained"].map(lambda flag: str(bool(flag)).lower())
    text: str = table.assign(**meters, **degrees, constrained=flags).to_csv(index=False, lineterminator="\n")
    return text
