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

    if tracks.empty:
        return tracks.assign(interpolated=np.zeros(0, bool))
    tracks = tracks.sort_values(["track_id", "frame"], kind="stable")
    name, values = tracks["track_id"].to_numpy(), tracks[[*BOX, "confidence"]].to_numpy(float)
    begins = np.flatnonzero(np.concatenate([[True], name[1:] != name[:-1]]))
    ends = np.append(begins[1:], len(name))
    place = np.searchsorted(frame, tracks["frame"].to_numpy())
    counts = place[ends - 1] - place[begins] + 1
    every = np.concatenate([np.arange(place[a], place[b - 1] + 1) for a, b in zip(begins, ends, strict=True)])
    filled = np.empty((len(every), values.shape[1]))
    row = place + np.repeat(np.cumsum(counts) - counts - place[begins], ends - begins)
    for a, b in zip(begins, ends, strict=True):
        span = slice(row[a], row[b - 1] + 1)
        for column in range(values.shape[1]):
            filled[span, column] = np.interp(time[every[span]], time[place[a:b]], values[a:b, column])
    missed, detected = np.ones(len(every), bool), np.full(len(every), "", object)
    missed[row], detected[row] = False, tracks["detected_class"].to_numpy()
    return pd.DataFrame(
        {
            "frame": frame[every],
            "time": time[every],
            "track_id": np.repeat(name[begins], counts),
            "class": np.repeat(tracks["class"].to_numpy()[begins], counts),
            **dict(zip([*BOX, "confidence"], filled.T, strict=True)),
            "detected_class": detected,
            "interpolated": missed,
        }
    )
