"""Tracks against truth: MOTA (Bernardin & Stiefelhagen 2008), IDF1 (Ristani et al. 2016), HOTA (Luiten et al. 2021).

Boxes are compared by intersection over union; positions, where there are no boxes, by 1 - distance / 2 m.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from vision.boxes import overlap
from vision.contract.errors import InputError
from vision.interpolate import BOX
from vision.jitter import stride

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]
Counts = NDArray[np.int64]

MATCHED = 0.5  # similarity that makes a pair, for MOTA and IDF1
ALPHAS = np.arange(0.05, 0.96, 0.05)  # similarities over which HOTA is averaged
TOO_FAR = 2.0  # m; positions this far apart have similarity 0
KEPT = 1000.0  # bonus of a pair that was matched in the previous frame
EPSILON = 1e-9


@dataclass(frozen=True)
class Scores:
    """Scores of tracks, 1 is perfect; MOTA may fall below 0.

    Parameters
    ----------
    mota, idf1, hota : the usual three
    deta, assa : the parts of HOTA, detection and association
    switches : times that a vehicle changes its track
    misses, false_alarms, boxes : boxes of the truth that were missed, boxes found where nothing is, boxes of the truth
    not_asked : boxes found of classes that are not compared; they do not count
    unplaced : boxes of the truth that were found but could not be placed on the road; they do not count
    """

    mota: float
    idf1: float
    hota: float
    deta: float
    assa: float
    switches: int
    misses: int
    false_alarms: int
    boxes: int
    not_asked: int = 0
    unplaced: int = 0

    def rounded(self) -> dict[str, float]:
        """Return all as a dictionary, scores to four digits."""
        return {name: round(value, 4) for name, value in asdict(self).items()}


@dataclass(frozen=True)
class Pairs:
    """Truth and found tracks, frame by frame.

    Parameters
    ----------
    truth, found : numbers of the tracks in each frame, from 0
    similarity : [truth, found] of each frame, 0 to 1
    counts : how many tracks of either there are
    """

    truth: list[Counts]
    found: list[Counts]
    similarity: list[Array]
    counts: tuple[int, int]


def score_tracks(
    truth: "pd.DataFrame",
    found: "pd.DataFrame",
    *,
    others: "pd.DataFrame | None" = None,
    unplaced: "pd.DataFrame | None" = None,
) -> Scores:
    """Score tracks against the truth about the same frames.

    Parameters
    ----------
    truth, found : [fix] with track_id, frame, and the box (px) or x, y (m); where `found` saw only every n-th frame,
        the truth counts in those only
    others : [fix] of the truth that are not compared (persons, parked vehicles): detections there are no false alarms
    unplaced : [fix] that were detected but could not be placed on the road: truth there is not missed

    Raises
    ------
    InputError
        If one has boxes only and the other positions only, or they share no frame.

    >>> import pandas as pd
    >>> truth = pd.DataFrame({"track_id": 1, "frame": range(4), "x": range(4), "y": 0.0})
    >>> score_tracks(truth, truth.assign(track_id=[1, 1, 2, 2])).rounded()["idf1"]
    0.5
    """
    truth = looked_at(truth, found)
    everything, asked = len(found), len(truth)
    if others is not None:
        found = without_matches(found, others, truth)
    if unplaced is not None:
        truth = without_matches(truth, unplaced, found)
    pairs = pair_frames(truth, found)
    mota, switches, misses, false_alarms = clear_mot(pairs)
    hota, deta, assa = higher_order(pairs)
    boxes = sum(len(names) for names in pairs.truth)
    out = (everything - len(found), asked - len(truth))
    return Scores(mota, identity_f1(pairs), hota, deta, assa, switches, misses, false_alarms, boxes, *out)


def without_matches(table: "pd.DataFrame", others: "pd.DataFrame", rivals: "pd.DataFrame") -> "pd.DataFrame":
    """Leave out rows that match `others` rather than `rivals`, frame by frame (as MOTChallenge does with distractors).

    Parameters
    ----------
    table, others, rivals : [fix] with frame, and boxes (px) or x, y (m)

    >>> import pandas as pd
    >>> rivals = pd.DataFrame({"frame": [0], "x": [0.0], "y": [0.0]})
    >>> table = pd.concat([rivals, rivals.assign(x=9.5)])
    >>> without_matches(table, rivals.assign(x=9.0), rivals)["x"].tolist()
    [0.0]
    """
    columns, compare = _comparable(table, others, rivals)
    keep = np.ones(len(table), bool)
    place = others.groupby("frame").indices
    rival = rivals.groupby("frame").indices
    nothing = np.zeros(0, np.intp)
    values = [part[columns].to_numpy(float) for part in (table, others, rivals)]
    for frame, rows in table.groupby("frame").indices.items():
        if frame not in place:
            continue
        first = values[2][rival.get(frame, nothing)]
        similarity = compare(values[0][rows], np.concatenate([first, values[1][place[frame]]]))
        bonus = KEPT * (np.arange(similarity.shape[1]) < len(first))
        row, column = _assign(np.where(similarity >= MATCHED - EPSILON, similarity + bonus, 0.0))
        keep[rows[row[column >= len(first)]]] = False
    return table[keep]


def _comparable(*tables: "pd.DataFrame", name: str = "the tracks") -> tuple[list[str], Callable[[Array, Array], Array]]:
    """Columns that all tables have, and what compares them: boxes, else positions."""
    for columns, compare in ((BOX, overlap), (["x", "y"], nearness)):
        if all(name in table for name in columns for table in tables):
            return columns, compare
    raise InputError(f"--truth: shares neither boxes (px) nor positions (m) with {name}; give both or neither")


def looked_at(truth: "pd.DataFrame", found: "pd.DataFrame", name: str = "the tracks") -> "pd.DataFrame":
    """The truth [fix] in the frames that `found` looked at; `name` says in errors whose they are.

    Raises
    ------
    InputError
        If one has boxes only and the other positions only, or they share no frame.
    """
    _comparable(truth, found, name=name)
    step = stride(found["frame"].to_numpy())
    truth = truth[(truth["frame"] - found["frame"].min()) % step == 0]
    if not truth["frame"].isin(found["frame"]).any():
        raise InputError(f"--truth: shares no frame with {name}; give that of the same video")
    return truth


def pair_frames(truth: "pd.DataFrame", found: "pd.DataFrame") -> Pairs:
    """Compare truth and tracks in every frame that was looked at."""
    import pandas as pd

    columns, compare = _comparable(truth, found)
    names = [pd.factorize(table["track_id"].astype(str), sort=True) for table in (truth, found)]
    frames = np.union1d(truth["frame"], found["frame"])
    (rows_t, rows_f) = (_rows_by_frame(table["frame"].to_numpy(), frames) for table in (truth, found))
    values_t, values_f = truth[columns].to_numpy(float), found[columns].to_numpy(float)
    return Pairs(
        truth=[names[0][0][rows] for rows in rows_t],
        found=[names[1][0][rows] for rows in rows_f],
        similarity=[compare(values_t[a], values_f[b]) for a, b in zip(rows_t, rows_f, strict=True)],
        counts=(len(names[0][1]), len(names[1][1])),
    )


def _rows_by_frame(frame: Counts, frames: Counts) -> list[NDArray[np.intp]]:
    order = np.argsort(frame, kind="stable")
    return np.split(order, np.searchsorted(frame[order], frames[1:]))


def nearness(a: Array, b: Array) -> Array:
    """Similarity [n, m] of positions a [n, 2] and b [m, 2], m: 1 in one place, 0 from two meters on.

    >>> nearness(np.array([[0.0, 0.0]]), np.array([[0.0, 0.5], [9.0, 0.0]])).tolist()
    [[0.75, 0.0]]
    """
    distance = np.linalg.norm(a[:, None] - b[None], axis=2)
    return np.asarray(np.maximum(0.0, 1.0 - distance / TOO_FAR))


def clear_mot(pairs: Pairs) -> tuple[float, int, int, int]:
    """Return MOTA, switches, misses and false alarms: pairs that held in the frame before are kept first."""
    switches = matched = 0
    latest: dict[int, int] = {}  # last track of every vehicle
    before: dict[int, int] = {}
    for truth, found, similarity in zip(pairs.truth, pairs.found, pairs.similarity, strict=True):
        kept = np.array([[before.get(int(t)) == f for f in found] for t in truth]).reshape(similarity.shape)
        rows, columns = _assign(np.where(similarity >= MATCHED - EPSILON, similarity + KEPT * kept, 0.0))
        before = {int(truth[r]): int(found[c]) for r, c in zip(rows, columns, strict=True)}
        switches += sum(latest.get(vehicle, track) != track for vehicle, track in before.items())
        latest |= before
        matched += len(rows)
    boxes, found_boxes = (sum(len(names) for names in side) for side in (pairs.truth, pairs.found))
    misses, false_alarms = boxes - matched, found_boxes - matched
    return 1 - (misses + false_alarms + switches) / max(boxes, 1), switches, misses, false_alarms


def _assign(value: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Assignment of the largest sum, without pairs worth nothing."""
    rows, columns = linear_sum_assignment(-value)
    worth = value[rows, columns] > 0
    return rows[worth], columns[worth]


def identity_f1(pairs: Pairs) -> float:
    """IDF1: the F1 score of boxes under the one assignment of tracks to vehicles that makes it largest."""
    together = np.zeros(pairs.counts)
    for truth, found, similarity in zip(pairs.truth, pairs.found, pairs.similarity, strict=True):
        together[np.ix_(truth, found)] += similarity >= MATCHED - EPSILON
    rows, columns = linear_sum_assignment(-together)
    boxes = sum(len(names) for side in (pairs.truth, pairs.found) for names in side)
    return float(2 * together[rows, columns].sum() / max(boxes, 1))


def higher_order(pairs: Pairs) -> tuple[float, float, float]:
    """HOTA and its parts, means over the similarities `ALPHAS`.

    Pairs are assigned once a frame, by how well the whole tracks go together and then by similarity.
    """
    alike, in_truth, in_found = np.zeros(pairs.counts), np.zeros(pairs.counts[0]), np.zeros(pairs.counts[1])
    for truth, found, similarity in zip(pairs.truth, pairs.found, pairs.similarity, strict=True):
        union = similarity.sum(0)[None] + similarity.sum(1)[:, None] - similarity
        alike[np.ix_(truth, found)] += similarity / np.maximum(union, EPSILON)
        in_truth[truth] += 1
        in_found[found] += 1
    either = in_truth[:, None] + in_found
    alignment = alike / np.maximum(either - alike, 1)
    matched = np.zeros((len(ALPHAS), *pairs.counts))
    for truth, found, similarity in zip(pairs.truth, pairs.found, pairs.similarity, strict=True):
        rows, columns = linear_sum_assignment(-(alignment[np.ix_(truth, found)] * similarity))
        good = similarity[rows, columns] >= ALPHAS[:, None] - EPSILON
        matched[:, truth[rows], found[columns]] += good  # no pair occurs twice in one frame
    total = matched.sum(axis=(1, 2))
    association = (matched**2 / np.maximum(either - matched, 1)).sum(axis=(1, 2)) / np.maximum(total, 1)
    detection = total / np.maximum(in_truth.sum() + in_found.sum() - total, 1)
    return float(np.sqrt(detection * association).mean()), float(detection.mean()), float(association.mean())
