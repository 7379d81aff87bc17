"""Fixes that were detected and could not be placed on the road: why, and the file that says so beside a table."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from vision.contract.columns import finite
from vision.contract.errors import InputError
from vision.contract.files import writing
from vision.interpolate import BOX

if TYPE_CHECKING:
    import pandas as pd

HORIZON = "above the horizon"
FAR = "so far off that a pixel is more than 1.5 m"
HIDDEN = "hidden by nearer vehicles"
BORDER = "cut by the border of the picture"
SHAPE = "not of the shape of a vehicle of its class"
SIGMA = "less certain than 1.5 m"
SHORT = "in a track with fewer than five others"
GHOST = "inside another vehicle"
COLUMNS = ("frame", "track_id", "class", "confidence", *BOX, "cause")


def causes(dropped: "pd.DataFrame") -> dict[str, int]:
    """How many fixes were dropped for each cause, the most frequent first."""
    counts = dropped["cause"].value_counts().sort_values(ascending=False, kind="stable")
    return {str(cause): int(count) for cause, count in counts.items()}


def words(counts: dict[str, int]) -> str:
    """Causes and how many fixes each had, as text.

    >>> words({SIGMA: 20, HORIZON: 3})
    '20 less certain than 1.5 m, 3 above the horizon'
    """
    return ", ".join(f"{count} {cause}" for cause, count in counts.items())


def file_beside(table: Path) -> Path:
    """Return the file that keeps what a table left out.

    >>> file_beside(Path("runs/trajectories.csv")).name
    'trajectories.csv.dropped'
    """
    return table.with_name(f"{table.name}.dropped")


def write_dropped(dropped: "pd.DataFrame | None", table: Path) -> None:
    """Write what a table leaves out beside it, as csv; None removes the file of an earlier table of that name.

    Parameters
    ----------
    dropped : [fix] of `COLUMNS`; `track_id` is empty where a detection was dropped before it was followed
    table : that was written
    """
    if dropped is None:
        file_beside(table).unlink(missing_ok=True)
        return
    with writing(file_beside(table)) as temporary:
        dropped[list(COLUMNS)].to_csv(temporary, index=False, float_format="%.10g")


def read_dropped(table: Path) -> "pd.DataFrame | None":
    """Read what a table leaves out [fix]; None where there is no such file.

    Raises
    ------
    InputError
        If the file beside it is not what `write_dropped` writes.
    """
    import pandas as pd

    path = file_beside(table)
    if not path.is_file():
        return None
    try:
        dropped = pd.read_csv(path, dtype={"track_id": str, "class": str, "cause": str}, keep_default_na=False)
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read ({_first_line(error)}); track again, or move it away") from error
    if missing := [name for name in COLUMNS if name not in dropped]:
        raise InputError(f"{path}: no column {', '.join(missing)}; track again, or move it away")
    return finite(dropped, ("frame", "confidence", *BOX), path).astype({"frame": int})


def join(parts: "Sequence[pd.DataFrame]") -> "pd.DataFrame":
    """Join tables of dropped fixes [fix] of `COLUMNS`."""
    import pandas as pd

    there = [part[list(COLUMNS)] for part in parts if len(part)]
    return pd.concat(there, ignore_index=True) if there else pd.DataFrame(columns=list(COLUMNS))


def _first_line(error: Exception) -> str:
    return str(error).splitlines()[0] if str(error) else type(error).__name__
