"""The camera's part: calibrate a view, track a video, compare tables of tracks."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from calib.control_points import AXES, ControlPoints, read_control_points
from calib.ground import MODELS, GroundFit, fit_ground
from calib.options import one_of, picture_size
from calib.report import summary, table
from calib.starts import on_road
from vision.cache import cache_folder
from vision.camera import Calibration
from vision.contract import LocalFrame
from vision.contract.notebook import framed
from vision.pipeline import track as track_video
from vision.quality import write_report
from vision.tracked import Tracked

if TYPE_CHECKING:
    import pandas as pd

Size = tuple[int, int]


@contextmanager
def as_files(tables: "Sequence[pd.DataFrame | Path | str]", name: str) -> Iterator[list[Path]]:
    """Paths of tables, of which those in memory are files for as long as the context lasts."""
    import pandas as pd

    with TemporaryDirectory() as folder:
        paths = list[Path]()
        for number, one in enumerate(tables, 1):
            if isinstance(one, pd.DataFrame):
                paths.append(Path(folder) / f"{name}{number if len(tables) > 1 else ''}.csv")
                one.to_csv(paths[-1], index=False, date_format="%Y-%m-%dT%H:%M:%S.%fZ")
            else:
                paths.append(Path(one))
        yield paths


@dataclass(frozen=True, repr=False)
class Calibrated:
    """A calibrated view.

    Parameters
    ----------
    points : control points that it was fitted to
    fit : with all that is known of its errors
    """

    points: ControlPoints
    fit: GroundFit

    @property
    def calibration(self) -> Calibration:
        """From pixels to meters on the road and back, with uncertainty."""
        return self.fit.calibration

    @property
    def facts(self) -> dict[str, Any]:
        """What `roadfiber calibrate ground --json` prints."""
        return summary(self.points, self.fit)

    @property
    def table(self) -> "pd.DataFrame":
        """A row per control point: name, used, residual and leave-one-out error, px and m."""
        import pandas as pd

        return pd.DataFrame(self.facts["points"])

    def save(self, path: Path | str) -> None:
        """Write the calibration file, whole or not at all."""
        self.calibration.write(Path(path))

    def __repr__(self) -> str:
        return table(self.points, self.fit)

    def _repr_html_(self) -> str:
        from html import escape

        return f"<pre>{escape(table(self.points, self.fit))}</pre>"


def calibrate(
    points: "pd.DataFrame | Path | str",
    *,
    video: Path | str | None = None,
    image_size: Size | None = None,
    model: str = "auto",
    frame: LocalFrame | None = None,
    crs: str | None = None,
    axes: str = AXES[0],
    threshold: float = 5.0,
    height: tuple[float, float] | None = None,
) -> Calibrated:
    """Fit the view of the road plane to control points.

    Parameters
    ----------
    points : table or file with name, px, py and x, y (m), or latitude, longitude, or easting, northing, zone; at least
        4, better 8 or more on both sides of the road
    video : video, picture or folder of stills, of which the size is taken
    image_size : (width, height), px, in its place
    model : "auto" (by leave-one-out error), "homography" or "camera"
    frame : local frame, for points on the globe
    crs : of easting, northing where there is no zone, as "EPSG:32636"
    axes : where x and y point: "ahead,right" as in the local frame, "ahead,left", "right,ahead" or "east,north"
    threshold : px; points further off are left out
    height : of the camera above the road and its sigma, m, if measured

    Raises
    ------
    InputError
        If the points are too few, on one line, or contradict one another.

    Examples
    --------
    >>> import pandas as pd
    >>> marks = pd.DataFrame({"px": [100, 1180, 900, 380, 640], "py": [700, 700, 300, 300, 420],
    ...     "x": [0, 0, 40, 40, 15], "y": [-4, 4, 4.6, -4.6, 0]}).assign(name=list("abcde"))
    >>> rf.calibrate(marks, image_size=(1280, 720), model="homography", threshold=500).calibration.image_size
    (1280, 720)
    """
    size, _ = picture_size(
        None if video is None else Path(video), None if image_size is None else f"{image_size[0]}x{image_size[1]}"
    )
    with as_files([points], "points") as (path,):
        marks = on_road(read_control_points(path, frame, crs, axes), size, None, height, threshold)
    kind = one_of(model, MODELS, "model")
    return Calibrated(marks, fit_ground(marks, size, model=kind, threshold=threshold, frame=frame, height=height))


def track(video: Path | str, *, calibration: Calibration | Path | str | None = None, **options: Any) -> Tracked:
    """Follow the vehicles of a video: metric trajectories with a sigma per fix.

    Detections are kept in the user's cache: a second look, with another calibration or score, costs nothing.

    Parameters
    ----------
    video : file, or folder of stills
    calibration : of the view, or its file; without one, tracks stay in pixels
    **options : detector, layout, names, start, frame_rate, clock_offset, min_score, classes, every, cache, appearance;
        see `vision.pipeline.track`

    Returns
    -------
    tracked : `table` [fix] of time (UTC), track_id, class, x, y, sigma_x, sigma_y (m), speed (m/s) ...; what could not
        be placed on the road, and why

    Raises
    ------
    InputError
        If the video, the detector or the calibration cannot be used, the start is unknown, or no vehicle was followed.

    Examples
    --------
    >>> rf.track(folder / "none.mp4")
    Traceback (most recent call last):
    vision.contract.errors.InputError: ...
    """
    return track_video(video, calibration=calibration, **{"cache": cache_folder()} | options)


@dataclass(frozen=True, repr=False)
class Quality:
    """How good tables of tracks are, and whether they are good enough for the fiber.

    Parameters
    ----------
    facts : the content of quality.json
    page : the report, HTML
    """

    facts: dict[str, Any]
    page: str

    @property
    def use(self) -> str:
        """Name of the table to use."""
        return str(self.facts["use"])

    @property
    def verdict(self) -> str:
        """Whether it is good enough, in a sentence."""
        return str(self.facts["verdict"])

    @property
    def table(self) -> "pd.DataFrame":
        """A row per table: vehicles, frames, jitter, scores ..."""
        import pandas as pd

        return pd.json_normalize(self.facts["settings"])

    def __repr__(self) -> str:
        return f"<Quality: use {self.use}. {self.verdict}>"

    def _repr_html_(self) -> str:
        return framed(self.page)


def quality(*tracks: "pd.DataFrame | Path | str", out: Path | str | None = None, **options: Any) -> Quality:
    """Compare the tracks of detectors or settings on one video: which to use, and is it good enough for the fiber.

    Parameters
    ----------
    tracks : tables as `track` returns them, or files
    out : folder to write the report to; by default nothing is kept
    **options : names, truth, classes, video, gauge_length, frame_rate; see `vision.quality.write_report`

    Raises
    ------
    InputError
        If no table can be used, or the truth or the video do not belong to them.

    Examples
    --------
    >>> tracks = table.assign(frame=table.groupby("time").ngroup())
    >>> rf.quality(tracks, tracks.assign(y=tracks["y"] + 0.1), names=["one", "other"]).table["name"].tolist()
    ['one', 'other']
    """
    with TemporaryDirectory() as scratch, as_files(tracks, "tracks") as paths:
        folder = Path(out) if out is not None else Path(scratch) / "quality"
        facts = write_report(paths, folder, **options)
        return Quality(facts, (folder / "report.html").read_text(encoding="utf-8"))
