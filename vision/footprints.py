"""Two vehicles never stand in one place: a track inside another vehicle's footprint is a second box of that vehicle."""

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import pandas as pd

GHOST = 0.5  # share of a track's fixes inside one other vehicle that makes it a ghost


def ghosts(tracks: "pd.DataFrame") -> set[str]:
    """Name the tracks that are for the most part inside the footprint of a vehicle that was followed longer.

    Parameters
    ----------
    tracks : [fix] with track_id, frame, x, y, length, width (m), sorted by track and frame

    >>> import pandas as pd
    >>> bus = pd.DataFrame({"track_id": 1, "frame": range(9), "x": range(9), "y": 0.0, "length": 12.0, "width": 2.5})
    >>> part = bus.iloc[2:7].assign(track_id=2, x=bus["x"] + 4, length=5.0)
    >>> ghosts(pd.concat([bus, part]))
    {'2'}
    """
    parts = tracks.assign(
        name=tracks["track_id"].astype(str),
        heading=_headings(tracks),
        fixes=tracks.groupby("track_id")["frame"].transform("size"),
    )
    host = parts[["frame", "name", "x", "y", "length", "width", "heading", "fixes"]]
    pairs = parts[["frame", "name", "x", "y", "fixes"]].merge(host, on="frame", suffixes=("", "_host"))
    pairs = pairs[pairs["fixes"] < pairs["fixes_host"]]
    dx, dy = pairs["x"] - pairs["x_host"], pairs["y"] - pairs["y_host"]
    cos, sin = np.cos(pairs["heading"]), np.sin(pairs["heading"])
    along, across = dx * cos + dy * sin, dy * cos - dx * sin
    inside = pairs[(along.abs() < pairs["length"] / 2) & (across.abs() < pairs["width"] / 2)]
    counts = inside.groupby(["name", "name_host"]).agg(shared=("frame", "size"), fixes=("fixes", "first"))
    found = counts[counts["shared"] >= GHOST * counts["fixes"]]
    return set(found.index.get_level_values("name"))


def _headings(tracks: "pd.DataFrame") -> np.ndarray:
    """Heading of every fix, rad, from the way between the fixes beside it."""
    groups = tracks.groupby("track_id")
    steps = [groups[axis].shift(-1).fillna(tracks[axis]) - groups[axis].shift(1).fillna(tracks[axis]) for axis in "xy"]
    return np.arctan2(steps[1].to_numpy(), steps[0].to_numpy())
