"""What tracking a video gives: the table, what could not be placed, the speed; to be saved, drawn and shown."""

from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vision.camera import Calibration
from vision.contract.errors import InputError
from vision.contract.files import require_writable, writing
from vision.contract.table import write_trajectories
from vision.dropped import causes, words, write_dropped
from vision.frames import Video

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

SUFFIXES = (".csv", ".parquet", ".txt")


@dataclass(frozen=True)
class Speed:
    """Where the time went.

    Parameters
    ----------
    frames : looked at
    fresh : of these, detected now; detections of the others were cached
    decode, detect, track : s spent on each; for cached frames, the first two are the times when they were detected
    """

    frames: int
    fresh: int
    decode: float
    detect: float
    track: float

    def rates(self) -> dict[str, float]:
        """Frames per second of every step and of all together.

        >>> Speed(100, 50, 2.0, 3.0, 0.0625).rates()
        {'decode': 50.0, 'detect': 33.3, 'track': 1600.0, 'all': 19.8}
        """
        steps = {name: getattr(self, name) / self.frames for name in ("decode", "detect", "track")}
        steps["all"] = sum(steps.values())
        return {name: round(1 / max(seconds, 1e-9), 1) for name, seconds in steps.items()}


def check_suffix(out: Path) -> None:
    """Raise InputError, before the work rather than after it, unless `out` is a .csv, .parquet or .txt file."""
    if out.suffix.lower() not in SUFFIXES:
        raise InputError(f"{out}: tracks are written as .csv or .parquet, or MOTChallenge .txt; give such a suffix")


def write_table(table: "pd.DataFrame", out: Path) -> None:
    """Write trajectories, or tracks in pixels, whole or not at all; the suffix says how."""
    from vision.exchange import write_mot

    if out.suffix.lower() == ".txt":
        write_mot(table, out)
        return
    if "x" in table:
        write_trajectories(table, out)
        return
    with writing(out) as temporary:
        if out.suffix.lower() == ".parquet":
            table.to_parquet(temporary, index=False)
        else:
            table.to_csv(temporary, index=False, float_format="%.10g")


def placed_words(placed: int, left: dict[str, int], gone: int) -> str:
    """Say how many detected fixes were placed on the road, and why others were not.

    >>> placed_words(75, {"cut by the border of the picture": 20, "above the horizon": 5}, 1)
    '75 of 100 detected fixes placed on the road; 20 cut by the border of the picture, 5 above the horizon; 1 vehicle \
not at all'
    """
    why = f"; {words(left)}" if left else ""
    vehicles = f"; {gone} vehicle{'s' * (gone > 1)} not at all" if gone else ""
    return f"{placed} of {placed + sum(left.values())} detected fixes placed on the road{why}{vehicles}"


@dataclass(frozen=True, eq=False, repr=False)
class Tracked:
    """The tracks of a video.

    Parameters
    ----------
    table : trajectory table [fix], see `vision.pipeline.track`; in pixels where the view was not calibrated
    dropped : what was detected and not placed on the road [fix] of `vision.dropped.COLUMNS`; None in pixels
    speed : where the time went
    clip : the video
    every : one of so many frames was processed
    taken : what was taken for granted, a line each
    calibration : by which the table is in meters; None in pixels
    """

    table: "pd.DataFrame"
    dropped: "pd.DataFrame | None"
    speed: Speed
    clip: Video
    every: int = 1
    taken: tuple[str, ...] = ()
    calibration: Calibration | None = None

    @property
    def facts(self) -> dict[str, Any]:
        """Tracks by class, their median length, the speed, sigmas, and what could not be placed, by cause."""
        table, speed = self.table, self.speed
        tracks = table.groupby("track_id")
        seconds = tracks["time"].agg(lambda time: time.iloc[-1] - time.iloc[0])
        if seconds.dtype.kind == "m":
            seconds = seconds.dt.total_seconds()
        facts: dict[str, Any] = {
            "tracks": len(tracks),
            "by_class": tracks["class"].first().value_counts().to_dict(),
            "median_track_frames": float(tracks.size().median()),
            "median_track_seconds": round(float(seconds.median()), 3),
            "fixes": len(table),
            "interpolated_share": round(float(table["interpolated"].mean()), 4),
            "frames": speed.frames,
            "frames_detected_before": speed.frames - speed.fresh,
            "frames_per_second": speed.rates(),
        }
        if self.dropped is not None:
            facts["fixes_placed"] = int((~table["interpolated"]).sum())
            facts["fixes_not_placed"] = causes(self.dropped)
            gone = set(self.dropped["track_id"]) - {""} - set(table["track_id"])
            facts["tracks_not_placed"] = len(gone)
        if "sigma_x" in table:
            facts["median_sigma_x"] = round(float(table["sigma_x"].median()), 3)
            facts["median_sigma_y"] = round(float(table["sigma_y"].median()), 3)
        return facts | {"metric": self.dropped is not None, "taken": list(self.taken)}

    def lines(self) -> list[str]:
        """The same in words, a line each."""
        facts = self.facts
        by_class = ", ".join(f"{count} {name}" for name, count in facts["by_class"].items())
        frames, seconds = facts["median_track_frames"], facts["median_track_seconds"]
        lines = [f"{facts['tracks']} vehicles: {by_class}", f"median track {frames:g} frames, {seconds:g} s"]
        if facts["metric"]:
            lines += [
                f"median sigma {facts['median_sigma_x']:g} m along x, {facts['median_sigma_y']:g} m along y",
                self.placed,
            ]
        else:
            lines.append("boxes in pixels only; for meters give --calibration (roadfiber calibrate ground makes one)")
        if facts["frames_detected_before"]:
            kept = f"{facts['frames_detected_before']} of {facts['frames']}"
            lines.append(f"detections of {kept} frames were kept from before")
        rates = ", ".join(f"{step} {rate:g}" for step, rate in facts["frames_per_second"].items())
        return [*lines, f"frames per second: {rates}", *self.taken]

    @property
    def placed(self) -> str:
        """How many detected fixes were placed on the road, and why others were not; empty in pixels."""
        facts = self.facts
        if self.dropped is None:
            return ""
        return placed_words(facts["fixes_placed"], facts["fixes_not_placed"], facts["tracks_not_placed"])

    def save(self, out: Path | str) -> None:
        """Write the table as .csv, .parquet or MOTChallenge .txt, and beside it, in OUT.dropped, what it leaves out.

        Raises
        ------
        InputError
            If the suffix is none of these, or the file cannot be written.
        """
        out = Path(out)
        check_suffix(out)
        require_writable(out)
        write_table(self.table, out)
        write_dropped(self.dropped, out)

    def draw(self, out: Path | str) -> None:
        """Write the video as .mp4 with boxes, tails, ids, classes and, in meters, speeds and fixes."""
        from vision.drawn_video import draw_video, require_drawable

        require_drawable(Path(out), Path(self.clip.path))
        draw_video(self.clip, self.table, Path(out), self.every, self.calibration)

    def plot(self) -> "Figure":
        """Draw where the vehicles were: on the road from above, or in the picture."""
        from vision.tracked_figure import tracked_figure

        return tracked_figure(self.table, self.clip)

    def __repr__(self) -> str:
        return "\n".join([f"<Tracked {self.clip.path}", *(f"  {line}" for line in self.lines())]) + ">"

    def _repr_html_(self) -> str:
        from vision.contract.figures import svg

        lines = "<br>".join(map(escape, self.lines()))
        return f'<p>{lines}</p><div style="max-width:960px">{svg(self.plot())}</div>{self.table.head().to_html()}'
