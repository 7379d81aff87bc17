"""Jitter of trajectories: how far fixes lie from their own rolling mean, by place along the road.

The analysis of the paper's appendix: a rolling mean over 15 frames, the deviation of every fix from it in meters, its
mean and standard deviation in ten bins along x, before and after missing frames are interpolated, and a line at 35 cm.
"""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vision.contract.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]

WINDOW = 15  # frames
BINS = 10
LIMIT = 0.35  # m; jitter beyond it blurs what a vehicle says about the fiber
STANDING = 1.0  # m; a vehicle that stays as near as this to one place is parked
LONG_ENOUGH = 5.0  # s of standing that make a vehicle a parked one
INSIDE = 0.95  # share of its fixes that must be that close


def deviations(tracks: "pd.DataFrame", *, window: int = WINDOW, straight: bool = False) -> "pd.DataFrame":
    """Deviation of every fix from what its neighbors within `window` frames say.

    Parameters
    ----------
    tracks : [fix] with track_id, frame, time (s, or datetime), x, y (m)
    window : frames of the centered rolling mean, odd; those that were looked at count
    straight : take the deviation from a straight line in time through the fixes of the window, not from their mean.
        With evenly spaced frames and none missing both agree; otherwise only this one is free of the vehicle's own
        motion.

    Returns
    -------
    table [fix] of dx, dy (m), with the index of `tracks`; NaN where the track does not span the window

    Raises
    ------
    InputError
        If the window is even or shorter than three frames.

    >>> import pandas as pd
    >>> frame = np.arange(15)
    >>> x = 0.4 * frame + 0.3 * (frame == 7)
    >>> track = pd.DataFrame({"track_id": 1, "frame": frame, "time": frame / 25, "x": x, "y": 0.0})
    >>> deviations(track).loc[7].round(3).tolist()
    [0.28, 0.0]
    """
    import pandas as pd

    if window < 3 or window % 2 == 0:
        raise InputError(f"jitter: a window of {window} frames has no middle; give an odd number from 3 on")
    half = window // 2 * stride(tracks["frame"].to_numpy())
    frame, time = tracks["frame"].to_numpy(float), seconds(tracks["time"])
    place = tracks[["x", "y"]].to_numpy(float)
    result = np.full(place.shape, np.nan)
    for rows in rows_of(tracks).values():
        result[rows] = _from_neighbors(frame[rows], time[rows], place[rows], half, straight)
    return pd.DataFrame(result, columns=["dx", "dy"], index=tracks.index)


def rows_of(tracks: "pd.DataFrame") -> dict[str, NDArray[np.intp]]:
    """Rows of every track, in the order of its frames, by its name."""
    order = np.argsort(tracks["frame"].to_numpy(), kind="stable")
    names = tracks["track_id"].astype(str).to_numpy()
    _, code, counts = np.unique(names, return_inverse=True, return_counts=True)
    order = order[np.argsort(code[order], kind="stable")]
    return {str(names[rows[0]]): rows for rows in np.split(order, np.cumsum(counts)[:-1]) if len(rows)}


def _from_neighbors(frame: Array, time: Array, place: Array, half: float, straight: bool) -> Array:
    """Deviations [fix, 2] of one track; as `deviations`, with half a window in frames."""
    origin = place.mean(axis=0)
    place, time = place - origin, time - time.mean()
    first, last = np.searchsorted(frame, frame - half), np.searchsorted(frame, frame + half, side="right")

    def window_mean(values: Array) -> Array:
        total = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
        return np.asarray((total[last] - total[first]) / (last - first)[:, None])

    expected = window_mean(place)
    if straight:
        t = time[:, None]
        middle = window_mean(t)
        spread = window_mean(t * t) - middle**2
        slope = (window_mean(t * place) - middle * expected) / np.maximum(spread, 1e-9)
        expected = expected + slope * (t - middle)
    whole = (frame - half >= frame[0]) & (frame + half <= frame[-1])
    return np.where(whole[:, None], place - expected, np.nan)


def stride(frame: NDArray[np.int64]) -> int:
    """Step between the frames that were processed.

    >>> stride(np.array([0, 4, 8, 8, 14]))
    2
    """
    return int(np.gcd.reduce(np.diff(np.unique(frame)))) if len(np.unique(frame)) > 1 else 1


def seconds(time: "pd.Series") -> Array:
    """Time [fix] in s, from s or from datetimes, since the first."""
    if time.dtype.kind == "f":
        return np.asarray(time - time.min(), float)
    return np.asarray((time - time.min()).dt.total_seconds(), float)


def jitter_by_bin(tracks: "pd.DataFrame", *, edges: Array | None = None, window: int = WINDOW) -> "pd.DataFrame":
    """Mean and standard deviation of the jitter in bins along x.

    Parameters
    ----------
    tracks : as for `deviations`
    edges : [bin + 1], m; ten equal bins over all fixes by default
    window : frames of the rolling mean

    Returns
    -------
    table [bin] of low, high (m along x), fixes, mean, sd (m; NaN in an empty bin)

    >>> import pandas as pd
    >>> frame = np.arange(200)
    >>> y = 0.1 * (-1.0) ** frame
    >>> track = pd.DataFrame({"track_id": 1, "frame": frame, "time": frame / 25, "x": 0.4 * frame, "y": y})
    >>> jitter_by_bin(track)["mean"].round(2).tolist()
    [0.11, 0.11, 0.11, 0.11, 0.11, 0.11, 0.11, 0.11, 0.11, 0.11]
    """
    import pandas as pd

    edges = bin_edges(tracks["x"]) if edges is None else edges
    size = np.hypot(*deviations(tracks, window=window).to_numpy().T)
    place = np.clip(np.searchsorted(edges, tracks["x"], side="right") - 1, 0, len(edges) - 2)
    known = np.isfinite(size)
    parts = [size[known & (place == number)] for number in range(len(edges) - 1)]
    return pd.DataFrame(
        {
            "low": edges[:-1],
            "high": edges[1:],
            "fixes": [len(part) for part in parts],
            "mean": [part.mean() if len(part) else np.nan for part in parts],
            "sd": [part.std() if len(part) else np.nan for part in parts],
        }
    )


def bin_edges(x: "pd.Series | Array", bins: int = BINS) -> Array:
    """Edges [bins + 1] of equal bins over positions `x` [fix], m."""
    low, high = float(np.min(x)), float(np.max(x))
    return np.linspace(low, high if high > low else low + 1.0, bins + 1)


def parked(tracks: "pd.DataFrame") -> list[str]:
    """Name the tracks of parked vehicles, whose jitter contains no motion.

    A track counts where it lasts five seconds and 95 % of its fixes lie within one meter of their median.
    """
    time, places = seconds(tracks["time"]), tracks[["x", "y"]].to_numpy(float)
    found = []
    for name, rows in rows_of(tracks).items():
        place = places[rows]
        near = np.hypot(*(place - np.median(place, axis=0)).T) < STANDING
        if np.ptp(time[rows]) >= LONG_ENOUGH and near.mean() >= INSIDE:
            found.append(name)
    return found


def jitter_floor(tracks: "pd.DataFrame") -> float | None:
    """Root mean square jitter of parked vehicles, m, from detector and camera alone; None if none is parked."""
    standing = tracks[tracks["track_id"].astype(str).isin(parked(tracks))]
    if standing.empty:
        return None
    size = deviations(standing).to_numpy()
    return float(np.sqrt(np.nanmean((size**2).sum(axis=1)))) if np.isfinite(size).any() else None
