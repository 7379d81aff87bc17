"""Detections, frame by frame, to tracks of one class each."""

import logging
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vision.detectors.detections import Detections
from vision.detectors.look import Look
from vision.interpolate import BOX, fill_frames, majority_class
from vision.tracker import Tracker

if TYPE_CHECKING:
    import pandas as pd

log = logging.getLogger("roadfiber.follow")

STANDING = 0.5  # sizes of its box; a track that ends so close to its start is not a passing vehicle
FEWEST_FIXES = 5  # of a track; less is more often a false alarm than a vehicle
PATIENCE = 1.0  # s without a fix after which a track ends, or
PATIENT_FRAMES = 6  # looked-at frames, whichever is longer
PIXEL_COLUMNS = ("time", "track_id", "class", *BOX, "confidence", "interpolated", "frame", "detected_class")


def patience(interval: float) -> float:
    """How long a track lives without a fix, s, where frames that are looked at are `interval` s apart."""
    return max(PATIENCE, PATIENT_FRAMES * interval)


def follow(seen: Sequence[tuple[Look, NDArray[np.float64] | None]], tracker: Tracker) -> "pd.DataFrame":
    """Join detections to tracks.

    Parameters
    ----------
    seen : frames and their detections, in order of time, each with appearance vectors if there are any
    tracker : a new one

    Returns
    -------
    table [fix] of frame, time (s), track_id, class (one for each track), detected_class, confidence and the box (px);
    tracks of fewer than five fixes, and of what stands still, are left out, and it may be empty
    """
    owners = [tracker.update(now.time, now.found.box, now.found.score, vectors) for now, vectors in seen]
    table = _tabulate([now for now, _ in seen], owners)
    table = table[table.groupby("track_id")["frame"].transform("size") >= FEWEST_FIXES]
    if table.empty:
        return table
    moves = moving(table)
    if standing := table.loc[~moves, "track_id"].nunique():
        log.info("%d tracks that end where they began are left out: parked vehicles or false alarms", standing)
    return majority_class(table[moves])


def moving(table: "pd.DataFrame") -> "pd.Series":
    """Whether each fix [fix] is of a track that ends elsewhere than it began: an edge by more than half its box's size.

    Parked vehicles and similar objects would otherwise be the longest tracks of all. The ends are medians of up to five
    fixes, so that a single misplaced box is not motion; a growing box is an approaching vehicle.

    >>> import pandas as pd
    >>> frame = np.arange(9)
    >>> boxes = pd.DataFrame({"frame": frame, "box_left": 5 * frame, "box_top": 20, "box_bottom": 45})
    >>> passing = boxes.assign(track_id=1, box_right=40 + 5 * frame)
    >>> slipping = boxes.assign(track_id=2, box_left=np.where(frame == 8, 30, 0), box_right=40)
    >>> both = pd.concat([passing, slipping], ignore_index=True)
    >>> moving(both).groupby(both["track_id"]).all().to_dict()
    {1: True, 2: False}
    """
    tracks = table.groupby("track_id")
    before, after = tracks.cumcount(), tracks.cumcount(ascending=False)
    part = np.minimum(FEWEST_FIXES, tracks["frame"].transform("size") // 2)
    first, last = (table[count < part].groupby("track_id")[BOX].median() for count in (before, after))
    way = (last - first).abs().max(axis=1)
    area = (table["box_right"] - table["box_left"]) * (table["box_bottom"] - table["box_top"])
    size = np.sqrt(area.groupby(table["track_id"]).median())
    return table["track_id"].map(way > STANDING * size)


def follow_table(detections: "pd.DataFrame") -> "pd.DataFrame":
    """Join another program's detections to tracks, by boxes and time alone.

    Parameters
    ----------
    detections : [detection] with frame, time (s), class, confidence and the box (px)

    Returns
    -------
    table [fix] of `PIXEL_COLUMNS`, without gaps; it may be empty

    >>> import pandas as pd
    >>> frame = np.arange(8)
    >>> box = dict(zip(BOX, (10 + 4 * frame, 20, 50 + 4 * frame, 50), strict=True))
    >>> table = pd.DataFrame({"frame": frame, "time": frame / 25, "class": "car", "confidence": 0.9, **box})
    >>> follow_table(table.drop(3))[["track_id", "interpolated"]].value_counts().to_dict()
    {(1, False): 7, (1, True): 1}
    """
    seen = [(_look(rows), None) for _, rows in detections.groupby("frame", sort=True)]
    frames, times = np.array([now.index for now, _ in seen]), np.array([now.time for now, _ in seen])
    every = np.arange(frames[0], frames[-1] + 1)
    at = np.interp(every, frames, times)
    interval = float(np.median(np.diff(at))) if len(at) > 1 else 0.0
    return fill_frames(follow(seen, Tracker(patience=patience(interval))), every, at).reindex(columns=PIXEL_COLUMNS)


def _look(rows: "pd.DataFrame") -> Look:
    found = Detections(rows[BOX].to_numpy(float), rows["confidence"].to_numpy(float), rows["class"].to_numpy(str))
    return Look(int(rows["frame"].iloc[0]), float(rows["time"].iloc[0]), found, None, False, 0.0, 0.0)


def detection_table(frame: int, found: Detections) -> "pd.DataFrame":
    """Detections of one frame as a table [detection] of frame, class, confidence and the box."""
    import pandas as pd

    box = dict(zip(BOX, found.box.T, strict=True))
    return pd.DataFrame({"frame": frame, "class": found.label, "confidence": found.score, **box})


def _tabulate(seen: Sequence[Look], owners: Sequence[np.ndarray]) -> "pd.DataFrame":
    """Detections that belong to a track, of all frames; `owners` are the tracks of each frame's, 0 for none."""
    import pandas as pd

    count = [len(now.found) for now in seen]
    boxes = np.concatenate([now.found.box for now in seen])
    table = pd.DataFrame(
        {
            "frame": np.repeat([now.index for now in seen], count),
            "time": np.repeat([now.time for now in seen], count),
            "track_id": np.concatenate(owners),
            "class": np.concatenate([now.found.label for now in seen]),
            "confidence": np.concatenate([now.found.score for now in seen]),
            **{name: boxes[:, side] for side, name in enumerate(BOX)},
        }
    )
    return table[table["track_id"] > 0]
