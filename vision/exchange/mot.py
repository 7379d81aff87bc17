"""MOTChallenge text files (Milan et al. 2016, MOT16, section 3.3): one line per box.

Results: `frame, id, left, top, width, height, confidence, -1, -1, -1`; truth: `frame, id, left, top, width, height,
counted, class, visibility`. Frames count from 1; there is neither a clock nor a class name.
"""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from vision.contract.errors import InputError
from vision.contract.files import writing
from vision.interpolate import BOX

if TYPE_CHECKING:
    import pandas as pd

# MOT16's classes, table 3; the meaning of other numbers is not defined.
CLASSES = {
    **{1: "person", 2: "rider", 3: "car", 4: "bicycle", 5: "motorcycle", 6: "push vehicle", 7: "person"},
    **{8: "distractor", 9: "occluder", 10: "occluder", 11: "occluder", 12: "reflection"},
}
FIELDS = ["frame", "track_id", "left", "top", "width", "height", "confidence", "label", "visibility"]
FEWEST = 6
MEND = "MOTChallenge lines are frame,id,left,top,width,height[,confidence[,class,visibility]], frames from 1"


def write_mot(tracks: "pd.DataFrame", path: Path | str) -> None:
    """Write the boxes of tracks as MOTChallenge results, whole or not at all.

    Parameters
    ----------
    tracks : [fix] with track_id, frame, the box (px) and, if it is there, confidence
    path : file to write; names of tracks that are not whole numbers are numbered from 1

    Raises
    ------
    InputError
        If a column is missing.
    """
    if missing := [name for name in ("track_id", "frame", *BOX) if name not in tracks]:
        raise InputError(f"{path}: no column {', '.join(missing)} to write; MOTChallenge needs boxes of a video")
    box = tracks[BOX].to_numpy(float)
    score = tracks["confidence"].to_numpy(float) if "confidence" in tracks else np.ones(len(tracks))
    frame = tracks["frame"].to_numpy(int) + 1
    number = _numbers(tracks["track_id"])
    size = box[:, 2:] - box[:, :2]
    columns = np.column_stack([frame, number, box[:, :2], size, score])[np.lexsort([number, frame])]
    form = "%d,%d,%.2f,%.2f,%.2f,%.2f,%.4f,-1,-1,-1"
    with writing(path) as temporary:
        np.savetxt(temporary, columns, fmt=form)


def _numbers(names: "pd.Series") -> "np.ndarray":
    import pandas as pd

    numbers = pd.to_numeric(names, errors="coerce").to_numpy(float)
    if np.isfinite(numbers).all() and (numbers == np.round(numbers)).all() and (numbers > 0).all():
        return numbers.astype(int)
    return pd.factorize(names, sort=True)[0] + 1


def read_mot(path: Path | str, frame_rate: float | None = None) -> "pd.DataFrame":
    r"""Read MOTChallenge results or truth.

    Parameters
    ----------
    path : file; lines of truth that are not to be counted are left out
    frame_rate : of the video, 1/s; without it `time` is NaN

    Returns
    -------
    table [fix] of time (s), track_id (text), class, the box (px), confidence, interpolated (false), frame (from 0),
        sorted by track and frame

    Raises
    ------
    InputError
        If the file is missing, empty or of another form, or a track is twice in one frame.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "det.txt"
    >>> _ = path.write_text("1,7,100,50,40,30,0.9,-1,-1,-1\n3,7,104,50,40,30,0.8,-1,-1,-1\n")
    >>> read_mot(path, 25.0)[["time", "track_id", "frame", "box_right"]].values.tolist()
    [[0.0, '7', 0, 140.0], [0.08, '7', 2, 144.0]]
    """
    import pandas as pd

    rows = _numbers_in(Path(path))
    table = pd.DataFrame(rows, columns=FIELDS[: rows.shape[1]]).reindex(columns=FIELDS)
    truth = rows.shape[1] >= len(FIELDS) and (table["label"] > 0).all()
    # Files with a single class number it 1, whatever it is.
    named = truth and (table["label"] != 1).any()
    if truth:
        table = table[table["confidence"] > 0]
    frame = table["frame"].to_numpy(int) - 1
    right, bottom = table["left"] + table["width"], table["top"] + table["height"]
    box = dict(zip(BOX, (table["left"], table["top"], right, bottom), strict=True))
    result = pd.DataFrame(
        {
            "time": frame / frame_rate if frame_rate else np.nan,
            "track_id": table["track_id"].astype(int).astype(str),
            "class": table["label"].map(CLASSES).fillna("vehicle") if named else "vehicle",
            **box,
            "confidence": 1.0 if truth else table["confidence"].fillna(1.0),
            "interpolated": False,
            "frame": frame,
        }
    )
    if (twice := result.duplicated(["track_id", "frame"])).any():
        row = result[twice].iloc[0]
        raise InputError(f"{path}: track {row['track_id']} is twice in frame {row['frame'] + 1}; keep one box")
    return result.sort_values(["track_id", "frame"], ignore_index=True)


def _numbers_in(path: Path) -> "np.ndarray":
    """Read the file's columns [line, 6 to 9]; InputError where they are not those of MOTChallenge."""
    import pandas as pd

    try:
        rows = pd.read_csv(path, header=None, dtype=float, sep=r"\s*,\s*|\s+", engine="python").to_numpy()
    except pd.errors.EmptyDataError as error:
        raise InputError(f"{path}: empty file; {MEND}") from error
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(
            f"{path}: {getattr(error, 'strerror', None) or 'not a text file'}; give a .txt file"
        ) from error
    except ValueError as error:
        raise InputError(f"{path}: not all lines are numbers of one form; {MEND}") from error
    whole = rows[:, :2]
    if rows.shape[1] < FEWEST or not np.isfinite(rows[:, :FEWEST]).all() or (whole != np.round(whole)).any():
        raise InputError(f"{path}: not of the MOTChallenge form; {MEND}")
    if rows[:, 0].min() < 1 or (rows[:, 4:6] <= 0).any():
        raise InputError(f"{path}: a frame below 1 or a box without area; {MEND}")
    if (rows[:, 1] < 0).any():
        raise InputError(f"{path}: holds detections (id -1), no tracks; give tracks")
    return rows[:, : len(FIELDS)]
