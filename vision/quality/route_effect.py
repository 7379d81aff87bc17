"""What errors of vehicle positions do to the fiber route, before any fit.

In a uniform ground the strain depends only on where the fiber is relative to the vehicle. So an error common to all
fixes shifts the route by just as much, and independent errors average: a place that P vehicles pass is located to

    sigma_route = sigma / sqrt(P m),    m = max(1, T / tau),    T = (gauge length + 2 offset) / speed

where a vehicle strains a channel during T (a gauge length, and the reach of a point load on either side, about its
distance from the fiber), and tau = dt (1 + rho) / (1 - rho) is the time between independent errors (rho: correlation of
neighboring fixes; Bartlett 1946). Two figures enclose the truth. *Noise alone* takes sigma from the fixes' own scatter,
as above; errors that outlast 15 frames are not in it. *As stated* takes the table's sigma, which knows what no scatter
shows (size of the vehicle, edges that are always drawn too wide), for common to a whole pass: m = 1. An error of the
calibration is common to all passes and averages out in neither: `roadfiber calibrate` states it.
"""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vision.jitter import WINDOW, deviations, seconds

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]

GAUGE_LENGTH = 10.0  # m
OFFSET = 3.75  # m; of a lane from a fiber under the sidewalk
FEWEST = 10  # fixes in a bin that make it count
HIGHEST = 0.95  # correlation of neighbors beyond which none is told apart from 1
SLOWEST = 0.1  # m/s, of traffic that stands


def route_effect(tracks: "pd.DataFrame", edges: Array, gauge_length: float = GAUGE_LENGTH) -> "pd.DataFrame":
    """Predict the route's standard deviation from position errors, in bins along x.

    Parameters
    ----------
    tracks : [fix] of moving vehicles with track_id, frame, time (s), x, y (m), interpolated and, for the stated part,
        sigma_x, sigma_y (m)
    edges : [bin + 1], m along x
    gauge_length : of the DAS, m

    Returns
    -------
    table [bin] of low, high, passes; noise_x, noise_y: sd of the fixes' scatter; independent: m; route_x, route_y:
        what noise alone does; stated_x, stated_y: what the table's sigmas do (NaN without them, or without passes), m

    >>> import pandas as pd
    >>> rng = np.random.default_rng(0)
    >>> frame = np.arange(2000)
    >>> place = np.stack([0.4 * (frame % 250), 0 * frame], 1) + rng.normal(0, 0.1, (2000, 2))
    >>> tracks = pd.DataFrame(place, columns=["x", "y"]).assign(
    ...     frame=frame, time=frame / 25, track_id=frame // 250, interpolated=False, sigma_x=0.2, sigma_y=0.2)
    >>> effect = route_effect(tracks, np.array([0.0, 100.0]))
    >>> effect[["passes", "noise_y", "stated_y"]].round(2).values.tolist()
    [[8.0, 0.1, 0.07]]
    >>> bool(effect["route_y"][0] < 0.1 / 8**0.5 / 4)
    True
    """
    import pandas as pd

    tracks = tracks[~tracks["interpolated"].to_numpy(bool)].reset_index(drop=True)
    ids = tracks["track_id"].to_numpy()
    same = np.asarray(ids[1:] == ids[:-1])
    scatter = deviations(tracks, straight=True).to_numpy()
    rho, shown = error_model(scatter, same)
    scatter = scatter / shown
    independent = independent_fixes(tracks, same, rho, gauge_length)
    place = np.clip(np.searchsorted(edges, tracks["x"], side="right") - 1, 0, len(edges) - 2)
    rows = []
    for number in range(len(edges) - 1):
        here = place == number
        passes = tracks.loc[here, "track_id"].nunique()
        row = {"low": edges[number], "high": edges[number + 1], "passes": passes, "independent": independent}
        for axis, name in enumerate("xy"):
            known = scatter[here, axis][np.isfinite(scatter[here, axis])]
            noise = float(np.sqrt(np.mean(known**2))) if len(known) >= FEWEST else np.nan
            stated = tracks.loc[here, f"sigma_{name}"].median() if f"sigma_{name}" in tracks and passes else np.nan
            row |= {f"noise_{name}": noise, f"route_{name}": noise / np.sqrt(max(passes, 1) * independent)}
            row |= {f"stated_{name}": stated / np.sqrt(max(passes, 1))}
        rows.append(row)
    return pd.DataFrame(rows)


def independent_fixes(tracks: "pd.DataFrame", same: NDArray[np.bool_], rho: float, gauge_length: float) -> float:
    """Return m: how many independent fixes of one pass locate one channel."""
    time = seconds(tracks["time"])
    step = np.diff(time)[same]
    if not len(step):
        return 1.0
    ends = tracks.groupby("track_id")[["x", "y"]].agg(["first", "last"])
    went = np.hypot(*(ends.xs("last", axis=1, level=1) - ends.xs("first", axis=1, level=1)).to_numpy().T)
    speed = max(float(went.sum()) / float(step.sum()), SLOWEST)
    tau = float(np.median(step)) * (1 + rho) / (1 - rho)
    return float(max(1.0, (gauge_length + 2 * OFFSET) / speed / tau))


def error_model(scatter: Array, same: NDArray[np.bool_]) -> tuple[float, float]:
    """Correlation of the errors of neighboring fixes, 0 to 0.95, and the share of their sd that the scatter shows.

    The errors are taken for a first-order autoregression: the correlation is the one whose deviations from the mean
    of a window are correlated as those seen are (`seen_of`).

    Parameters
    ----------
    scatter : [fix, 2], deviations from the window, m
    same : [fix - 1], whether the next fix is of the same track
    """
    pair = scatter[1:][same] * scatter[:-1][same]
    square = (scatter[1:][same] ** 2 + scatter[:-1][same] ** 2) / 2
    known = np.isfinite(pair)
    if not known.any() or square[known].sum() == 0:
        return 0.0, float(np.sqrt(seen_of(0.0)[0]))
    candidates = np.linspace(0.0, HIGHEST, 96)
    variances, products = np.array([seen_of(rho) for rho in candidates]).T
    rho = float(np.interp(pair[known].sum() / square[known].sum(), products / variances, candidates))
    return rho, float(np.sqrt(seen_of(rho)[0]))


def seen_of(rho: float, window: int = WINDOW) -> tuple[float, float]:
    """Variance, and covariance of neighbors, of deviations from a rolling mean for errors of variance 1.

    Parameters
    ----------
    rho : correlation of neighboring errors; those k frames apart are correlated by rho^k
    window : of the rolling mean, frames

    >>> tuple(round(value, 3) for value in seen_of(0.0))
    (0.933, -0.071)
    """
    lag = np.arange(window + 1)
    covariance = rho ** np.abs(lag[:, None] - lag).astype(float)
    first, second = np.zeros(window + 1), np.zeros(window + 1)
    first[:-1], second[1:] = -1 / window, -1 / window
    first[window // 2] += 1
    second[window // 2 + 1] += 1
    return float(first @ covariance @ first), float(first @ covariance @ second)
