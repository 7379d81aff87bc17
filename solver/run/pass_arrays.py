"""Passes as arrays of a run folder, and back."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solver.run.arrays import Arrays
from solver.trajectory.vehicle_pass import Pass

ROWS = ("rows", "position", "velocity", "sigma", "in_view")


def pass_arrays(passes: Sequence[Pass], prefix: str = "pass") -> dict[str, NDArray[Any]]:
    """Return passes as arrays, rows of all passes one after the other."""
    stacked = {f"{prefix}_{name}": np.concatenate([getattr(p, name) for p in passes]) for name in ROWS}
    return stacked | {
        f"{prefix}_count": np.array([len(p.rows) for p in passes]),
        f"{prefix}_track_id": np.array([p.track_id for p in passes]),
        f"{prefix}_class": np.array([p.vehicle_class for p in passes]),
        f"{prefix}_length": np.array([np.nan if p.length is None else p.length for p in passes]),
        f"{prefix}_offset": np.array([one.offset for one in passes]),
        f"{prefix}_wheelbase": np.array([p.wheelbase or (np.nan, np.nan) for p in passes]).reshape(-1, 2),
    }


def passes_from(arrays: Arrays, prefix: str = "pass") -> list[Pass]:
    """Undo `pass_arrays`."""
    cuts = np.cumsum(arrays[f"{prefix}_count"])[:-1]
    columns = [np.split(arrays[f"{prefix}_{name}"], cuts) for name in ROWS]
    lengths = [None if np.isnan(value) else float(value) for value in arrays[f"{prefix}_length"]]
    names, classes = arrays[f"{prefix}_track_id"].tolist(), arrays[f"{prefix}_class"].tolist()
    wheelbases = [None if np.isnan(mean) else (mean, sd) for mean, sd in arrays[f"{prefix}_wheelbase"].tolist()]
    offsets = arrays[f"{prefix}_offset"].tolist()
    return [Pass(*parts) for parts in zip(names, classes, *columns, lengths, wheelbases, offsets, strict=True)]
