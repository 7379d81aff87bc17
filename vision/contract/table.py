"""The trajectory table: one row per fix of one vehicle; what `vision` writes and `solver` reads."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from vision.contract.frame import LocalFrame

if TYPE_CHECKING:
    import pandas as pd

COLUMNS = ("time", "track_id", "class", "x", "y", "sigma_x", "sigma_y")


def read_trajectories(paths: Sequence[Path], frame: LocalFrame | None = None) -> "pd.DataFrame":
    """Read trajectory files into one table."""
    raise NotImplementedError


def write_trajectories(table: "pd.DataFrame", path: Path) -> None:
    """Write a trajectory table."""
    raise NotImplementedError
