"""What is compared: a person of the truth, or a parked vehicle, that no table of traffic shows is not missed."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from vision.contract.errors import InputError
from vision.detectors.names import VEHICLES, plain_name
from vision.follow import FEWEST_FIXES, moving
from vision.interpolate import BOX
from vision.jitter import parked

if TYPE_CHECKING:
    import pandas as pd


def compared_classes(tables: "Sequence[pd.DataFrame]", wanted: Sequence[str] | None = None) -> frozenset[str]:
    """Choose the classes to compare: road vehicles by any name, and other classes that all tables have.

    Parameters
    ----------
    tables : [fix] with class, the truth among them where it is known
    wanted : classes to compare in place of these

    >>> import pandas as pd
    >>> truth, found = (pd.DataFrame({"class": names}) for names in (["car", "person", "tram"], ["van", "tram"]))
    >>> sorted(compared_classes([truth, found]) - set(VEHICLES))
    ['tram']
    """
    if wanted:
        return frozenset(map(plain_name, wanted))
    shared = set(tables[0]["class"]).intersection(*(table["class"] for table in tables[1:]))
    return frozenset(VEHICLES) | shared


def of_classes(
    table: "pd.DataFrame", names: frozenset[str], where: str
) -> tuple["pd.DataFrame", "pd.DataFrame", dict[str, int]]:
    """Divide a table [fix] by class.

    Returns
    -------
    rows of the classes `names`, the others, and how many tracks of each class are among the others

    Raises
    ------
    InputError
        If nothing is of `names`.
    """
    wanted = table["class"].isin(names)
    if not wanted.any():
        raise InputError(
            f"{where}: has no {', '.join(sorted(names))}, but {listed(tracks_by_class(table))}; "
            "say with --classes what to compare"
        )
    return table[wanted], table[~wanted], tracks_by_class(table[~wanted])


def without_parked(
    tracks: "pd.DataFrame", others: "pd.DataFrame", left_out: dict[str, int]
) -> tuple["pd.DataFrame", "pd.DataFrame", dict[str, int]]:
    """Move the vehicles that `track` leaves out as parked to the others; all stay where none drives.

    Parameters and returns are those that `of_classes` returns.
    """
    import pandas as pd

    if set(BOX) <= set(tracks):
        long = tracks.groupby("track_id")["frame"].transform("size") >= FEWEST_FIXES
        stands = long & moving(tracks).eq(False)
    else:
        stands = tracks["track_id"].isin(parked(tracks))
    if stands.all() or not stands.any():
        return tracks, others, left_out
    counts = {f"parked {name}": count for name, count in tracks_by_class(tracks[stands]).items()}
    return tracks[~stands], pd.concat([others, tracks[stands]]), left_out | counts


def listed(counts: dict[str, int]) -> str:
    """Counts by class as text.

    >>> listed({"car": 3, "van": 1})
    '3 car, 1 van'
    """
    return ", ".join(f"{count} {name}" for name, count in counts.items())


def tracks_by_class(table: "pd.DataFrame") -> dict[str, int]:
    """How many tracks [fix] there are of each class, the most first."""
    counts = table.groupby("track_id")["class"].first().value_counts()
    return {str(name): int(count) for name, count in counts.sort_values(ascending=False, kind="stable").items()}
