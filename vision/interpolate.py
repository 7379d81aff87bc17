"""One class for every track, and no missing frames inside it."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import pandas as pd

BOX = ["box_left", "box_top", "box_right", "box_bottom"]


def majority_class(tracks: "pd.DataFrame") -> "pd.DataFrame":
    """Give all fixes of a track the class with the largest sum of `confidence`; ties go to the first by name.

    What the detector said of every single fix stays in `detected_class`.

    Parameters
    ----------
    tracks : [fix] with track_id, class, confidence

    >>> import pandas as pd
    >>> seen = {"track_id": [1, 1, 1], "class": ["van", "car", "car"], "confidence": [0.9, 0.4, 0.3]}
    >>> majority_class(pd.DataFrame(seen))["class"].tolist()
    ['van', 'van', 'van']
    """
    votes = tracks.groupby(["track_id", "class"], sort=True)["confidence"].sum().unstack(fill_value=0)
    return tracks.assign(**{"class": tracks["track_id"].map(votes.idxmax(axis=1)), "detected_class": tracks["class"]})


def fill_frames(tracks: "pd.DataFrame", frame: NDArray[np.int64], time: NDArray[np.float64]) -> "pd.DataFrame":
    """Add the frames a track misses between its first and its last fix, marked `interpolated`.

    Boxes and confidence are linear in time, which at constant speed is right even where frames come unevenly.

    Parameters
    ----------
    tracks : [fix] with track_id, class, detected_class, confidence, frame, time (s) and the box
    frame, time : [frame], index and time (s) of all frames that were looked at, increasing

    Returns
    -------
    table [fix] of the same columns and `interpolated`, sorted by track and time; `detected_class` is empty where
        nothing was detected
    """
    import pandas as pd

    parts = [_fill_one(track, frame, time) for _, track in tracks.groupby("track_id", sort=True)]
    if not parts:
        return tracks.assign(interpolated=np.zeros(0, bool))
    return pd.concat(parts, ignore_index=True)


def _fill_one(track: "pd.DataFrame", frame: NDArray[np.int64], time: NDArray[np.float64]) -> "pd.DataFrame":
    import pandas as pd

    track = track.sort_values("frame")
    first, last = np.searchsorted(frame, track["frame"].iloc[[0, -1]])
    span = slice(first, last + 1)
    columns = {name: np.interp(time[span], track["time"], track[name]) for name in [*BOX, "confidence"]}
    return pd.DataFrame(
        {
            "frame": frame[span],
            "time": time[span],
            "track_id": track["track_id"].iloc[0],
            "class": track["class"].iloc[0],
            **columns,
            "detected_class": track.set_index("frame")["detected_class"].reindex(frame[span], fill_value="").to_numpy(),
            "interpolated": ~np.isin(frame[span], track["frame"]),
        }
    )
