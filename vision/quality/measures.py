"""The figures of one setting: tracks, fragments, classes, jitter, effect on the route, scores, speed."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vision.boxes import area
from vision.dropped import causes
from vision.interpolate import BOX
from vision.jitter import bin_edges, jitter_by_bin, jitter_floor, parked, stride
from vision.quality.classes import tracks_by_class
from vision.quality.route_effect import route_effect
from vision.quality.scores import MATCHED, Scores, score_tracks
from vision.quality.setting import Setting

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]
WAYS = {"up the road": 1.0, "down the road": -1.0}  # along x


@dataclass(frozen=True)
class Measures:
    """What was measured of one setting; lengths in the setting's unit.

    Parameters
    ----------
    setting : that was measured
    by_class : tracks by class, after one class was given to each track
    by_detected_class : tracks by every class detected in them; a track with several classes counts for each
    frames_per_track : mean, of frames between first and last
    fragment : longest run of frames without a miss; the mean over tracks of each one's longest
    breaks : runs of missed frames inside tracks
    switches : changes of the detected class inside tracks
    switching : tracks that have any
    missed : share of fixes without a detection
    not_placed : detected fixes that could not be placed on the road, by cause; they are not misses
    before, after : jitter by bin of moving vehicles, before and after missed frames are interpolated
    floor : jitter of parked vehicles, None if there are none
    parked : count of parked vehicles
    effect : on the route, by bin; None in pixels
    scores : against the truth, where it is known
    """

    setting: Setting
    by_class: dict[str, int]
    by_detected_class: dict[str, int]
    frames_per_track: float
    fragment: int
    mean_fragment: float
    breaks: int
    switches: int
    switching: int
    missed: float
    not_placed: dict[str, int]
    before: "pd.DataFrame"
    after: "pd.DataFrame"
    floor: float | None
    parked: int
    effect: "pd.DataFrame | None"
    scores: Scores | None

    @property
    def tracks(self) -> int:
        """How many tracks there are."""
        return sum(self.by_class.values())

    @property
    def jitter(self) -> float:
        """Mean jitter after interpolation, over all fixes."""
        return mean_over(self.after)

    def as_json(self) -> dict[str, Any]:
        """Return all figures; NaN stays NaN."""
        return {
            "name": self.setting.name,
            "unit": self.setting.unit,
            "tracks": self.tracks,
            "tracks_by_class": self.by_class,
            "tracks_by_detected_class": self.by_detected_class,
            "tracks_not_compared": self.setting.others,
            "boxes_clipped": self.setting.clipped,
            "frames_per_track": self.frames_per_track,
            "longest_fragment_frames": self.fragment,
            "mean_longest_fragment_frames": self.mean_fragment,
            "breaks": self.breaks,
            "class_switches": self.switches,
            "tracks_with_class_switches": self.switching,
            "missed_share": self.missed,
            "not_placed": self.not_placed,
            "jitter": {
                "mean_before": mean_over(self.before),
                "mean_after": self.jitter,
                "before": self.before.to_dict("records"),
                "after": self.after.to_dict("records"),
                "floor": self.floor,
                "parked_vehicles": self.parked,
            },
            "route": None if self.effect is None else self.effect.to_dict("records"),
            "scores": self.scores and self.scores.rounded(),
            "frames_per_second": self.setting.speed,
        }


def mean_over(bins: "pd.DataFrame") -> float:
    """Mean jitter over the fixes of all bins; NaN where there are none."""
    known = bins[bins["fixes"] > 0]
    return float(np.average(known["mean"], weights=known["fixes"])) if len(known) else float("nan")


def shared_edges(settings: list[Setting]) -> Array:
    """Edges of ten bins along x over the moving vehicles of all settings, so that their bins are the same."""
    return bin_edges(np.concatenate([moving(setting)["x"].to_numpy() for setting in settings]))


def as_measured(tracks: "pd.DataFrame") -> "pd.DataFrame":
    """Return `tracks` with what each box alone says as x, y, where the table has it: smoothing hides jitter."""
    if "x_measured" not in tracks or "y_measured" not in tracks:
        return tracks
    return tracks.assign(x=tracks["x_measured"], y=tracks["y_measured"])


def moving(setting: Setting) -> "pd.DataFrame":
    """Return the tracks of vehicles that move, as measured; all where none does, or where there are no meters."""
    if setting.unit != "m":
        return setting.tracks
    tracks = as_measured(setting.tracks)
    rows = ~tracks["track_id"].isin(parked(tracks))
    return tracks[rows] if rows.any() else tracks


def measure(
    setting: Setting,
    edges: Array,
    gauge_length: float,
    truth: "pd.DataFrame | None" = None,
    others: "pd.DataFrame | None" = None,
) -> Measures:
    """Measure one setting.

    Parameters
    ----------
    setting : tracks
    edges : [bin + 1], of the bins along x
    gauge_length : of the DAS, m
    truth : [fix] with track_id, frame and boxes or x, y
    others : [fix] of the truth that are not compared
    """
    tracks, rolling = setting.tracks, moving(setting)
    seen = tracks[~tracks["missed"]]
    groups = tracks.groupby("track_id")
    longest, breaks = fragments(seen)
    switches = seen.groupby("track_id")["detected_class"].agg(changes)
    metric = setting.unit == "m"
    return Measures(
        setting=setting,
        by_class=tracks_by_class(tracks),
        by_detected_class=counted(seen.groupby("detected_class")["track_id"].nunique()),
        frames_per_track=float(groups.size().mean()),
        fragment=int(longest.max()),
        mean_fragment=float(longest.mean()),
        breaks=breaks,
        switches=int(switches.sum()),
        switching=int((switches > 0).sum()),
        missed=float(tracks["missed"].mean()),
        not_placed={} if setting.dropped is None else causes(setting.dropped),
        before=jitter_by_bin(rolling[~rolling["interpolated"]], edges=edges),
        after=jitter_by_bin(rolling, edges=edges),
        floor=jitter_floor(as_measured(tracks)) if metric else None,
        parked=len(parked(as_measured(tracks))) if metric else 0,
        effect=route_effect(rolling, edges, gauge_length) if metric else None,
        scores=None if truth is None else score_tracks(truth, tracks, others=others, unplaced=setting.dropped),
    )


def apart(first: Setting, second: Setting) -> dict[str, float]:
    """How far ahead, on its way, `first` puts the vehicles that both settings see, m, by the way they drive along x.

    Medians over the vehicles, of which one of the two is paired with the one whose boxes overlap its by half or more.
    Empty where there are no boxes or no meters.
    """
    if any(one.unit != "m" or not one.has_boxes for one in (first, second)):
        return {}
    a, b = (moving(one)[["frame", "track_id", "x", *BOX]] for one in (first, second))
    both = a.merge(b, on="frame", suffixes=("_a", "_b"))
    corners = [both[[f"{name}_{one}" for name in BOX]].to_numpy() for one in "ab"]
    low, high = np.maximum(*(each[:, :2] for each in corners)), np.minimum(*(each[:, 2:] for each in corners))
    common = np.maximum(high - low, 0).prod(axis=1)
    both = both[common >= MATCHED * (area(corners[0]) + area(corners[1]) - common)]
    pairs = both.groupby(["track_id_a", "track_id_b"])
    ahead = (both["x_a"] - both["x_b"]).groupby([both["track_id_a"], both["track_id_b"]]).median()
    way = np.sign(pairs["x_a"].last() - pairs["x_a"].first())
    return {name: float((ahead * way)[way == sign].median()) for name, sign in WAYS.items() if (way == sign).any()}


def counted(counts: "pd.Series") -> dict[str, int]:
    """Counts by name, the largest first."""
    return {str(name): int(count) for name, count in counts.sort_values(ascending=False, kind="stable").items()}


def fragments(seen: "pd.DataFrame") -> tuple["pd.Series", int]:
    """Longest run of frames without a miss of every track, and how many times runs break off inside tracks.

    Parameters
    ----------
    seen : [fix] that was detected, sorted by track and frame

    >>> import pandas as pd
    >>> longest, breaks = fragments(pd.DataFrame({"track_id": [1] * 6, "frame": [0, 1, 4, 5, 6, 9]}))
    >>> longest.tolist(), breaks
    ([3], 2)
    """
    step = stride(seen["frame"].to_numpy())
    name, frame = seen["track_id"].to_numpy(), seen["frame"].to_numpy()
    other = name[1:] != name[:-1]
    gap = np.diff(frame) != step
    run = np.concatenate([[0], np.cumsum(other | gap)])
    lengths = seen.groupby(["track_id", run]).size()
    return lengths.groupby(level=0).max(), int((gap & ~other).sum())


def changes(labels: "pd.Series") -> int:
    """Count how often a label differs from the one before.

    >>> import pandas as pd
    >>> changes(pd.Series(["car", "car", "van", "car"]))
    2
    """
    return int((labels.to_numpy()[1:] != labels.to_numpy()[:-1]).sum())
