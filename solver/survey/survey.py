"""One survey, read: the record, the tracks, the anchors, and what is known about the ground."""

import time as clock
from collections.abc import Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from solver.survey.anchors import Anchor, anchors_of, stated_anchors
from solver.survey.das.block import checksum
from solver.survey.das.in_memory import block_of
from solver.survey.das.lowpass import FIT_RATE
from solver.survey.das.opened import opened
from solver.survey.das.reader import record_of
from solver.survey.das.record import DASRecord
from solver.survey.selection import wanted
from solver.survey.site import Site, read_site
from solver.survey.site_sections import CameraSection, GroundSection
from vision.contract import InputError, LocalFrame, trajectories_of
from vision.contract.statements import Statements, caution_lines
from vision.contract.table import checked_tracks, read_tracks

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Source:
    """What a survey was made from.

    Parameters
    ----------
    role : das, trajectories, video, calibration, detector or anchors
    path : of the file; the argument's name if it was in memory
    sha256 : of the file or the numbers
    """

    role: str
    path: str
    sha256: str


@dataclass(frozen=True, init=False, eq=False, repr=False)
class Survey:
    """One survey, ready to be located.

    Parameters
    ----------
    das : `dascore.Patch`, `xarray.DataArray`, or array [time, channel] with `time` and `distance`; see
        `solver.survey.das.in_memory.block_of`
    tracks : trajectory table, as `vision.contract.read_trajectories` describes it; None with a `camera` to be tracked
    anchors : table of known points of the fiber, as `solver.survey.anchors.read_anchors` describes it
    frame : the local frame, or (latitude, longitude, azimuth of +x), degrees
    name : of the survey
    time, distance, first_channel : of a plain array: datetime64 UTC [time], m [channel], number of the first channel
    gauge_length, channel_spacing, quantity, scale, channels, exclude : of the record, if it does not give them; as in
        `[das]` of site.toml
    poisson_ratio, depth : what is known beforehand about the ground and the depth (mean, standard deviation; m)

    Attributes
    ----------
    name, frame : likewise
    record : strain rate at the sampling rate of the fit
    tracks : trajectory table; None where a video is to be tracked first
    anchors : sorted by channel
    ground : what is known about it beforehand
    camera : of a survey from a site.toml with one, else None
    sources : files and arrays that it was made from
    seconds : how long reading took
    cautions : what the user should know about tracks and anchors, a line each
    statements : what each track file states, and what is taken of it; of anchors what must be told

    Raises
    ------
    InputError
        If the record, a table or the frame cannot be used.

    Examples
    --------
    >>> import numpy as np, pandas as pd
    >>> times = np.datetime64("2025-08-11T06:00:00", "ns") + np.arange(200) * np.timedelta64(100, "ms")
    >>> rate = np.random.default_rng(1).normal(0, 1e-9, (200, 30))
    >>> tracks = pd.DataFrame({"time": pd.to_datetime(times, utc=True), "track_id": "a", "class": "car",
    ...     "x": np.arange(200) * 1.0 - 80, "y": 0.0, "sigma_x": 0.1, "sigma_y": 0.1})
    >>> survey = Survey(rate, tracks, frame=(32.1, 34.8, 78.0), time=times, distance=np.arange(30) * 1.02,
    ...     gauge_length=10.0, quantity="strain_rate", scale=1.0)
    >>> survey.record.strain_rate.shape, survey.record.sampling_rate
    ((200, 30), 10.0)
    """

    name: str
    frame: LocalFrame
    record: DASRecord
    tracks: "pd.DataFrame | None"
    anchors: list[Anchor]
    ground: GroundSection
    camera: CameraSection | None
    sources: tuple[Source, ...]
    seconds: float
    cautions: tuple[str, ...]
    statements: tuple[Statements, ...] = ()

    def __init__(
        self,
        das: Any,
        tracks: "pd.DataFrame",
        *,
        frame: LocalFrame | tuple[float, float, float],
        anchors: "pd.DataFrame | None" = None,
        name: str = "survey",
        time: ArrayLike | None = None,
        distance: ArrayLike | None = None,
        first_channel: int | None = None,
        gauge_length: float | None = None,
        channel_spacing: float | None = None,
        quantity: str | None = None,
        scale: float | None = None,
        channels: tuple[int, int] | None = None,
        exclude: Sequence[int] = (),
        poisson_ratio: float = GroundSection().poisson_ratio,
        depth: tuple[float, float] = GroundSection().depth,
    ) -> None:
        begun = clock.perf_counter()
        where = frame if isinstance(frame, LocalFrame) else LocalFrame((frame[0], frame[1]), frame[2])
        checked, stated = checked_tracks(tracks, where)
        tables = {"trajectories": tracks} | ({} if anchors is None else {"anchors": anchors})
        record = record_of(
            [block_of(das, time, distance, first_channel)],
            gauge_length=gauge_length,
            channel_spacing=channel_spacing,
            quantity=quantity,
            scale=scale,
            channels=channels,
            exclude=exclude,
            rate=FIT_RATE,
        )
        self._hold(
            name=name,
            frame=where,
            record=record,
            tracks=checked,
            anchors=[] if anchors is None else anchors_of(anchors, where),
            ground=ground_of(poisson_ratio, depth),
            camera=None,
            sources=(*das_sources(record), *(table_source(role, table) for role, table in tables.items())),
            seconds=clock.perf_counter() - begun,
            cautions=tuple(caution_lines([stated])),
            statements=(stated,),
        )

    def _hold(self, **values: Any) -> None:
        """Set the fields, once."""
        for name, value in values.items():
            object.__setattr__(self, name, value)

    @classmethod
    def read(cls, path: Path | str) -> "Survey":
        """Read a survey: its site.toml, or the folder that holds one, and all files that it names.

        Raises
        ------
        InputError
            If a file is missing, or cannot be used, or it is a drive's (`[route]`), which `roadfiber.read` reads.
        """
        path = Path(path)
        site = read_site(path / "site.toml" if path.is_dir() else path)
        if site.route is not None:
            raise InputError(f"{path}: [route] makes it a drive; read it with roadfiber.read or Drive.read")
        return cls.of_site(site)

    @classmethod
    def of_site(cls, site: Site) -> "Survey":
        """Read the files that a checked site.toml names; see `read`."""
        begun = clock.perf_counter()
        tracks, stated = None, tuple[Statements, ...]()
        if site.trajectories is not None:
            tracks, stated = read_tracks(site.trajectories.files, site.frame)
        anchors, told = stated_anchors(site.anchors.file, site.frame) if site.anchors else ([], ())
        stated += told
        source = opened(site.das.files, site.das.said, site.das.store)
        return cls.of(
            name=site.name,
            frame=site.frame,
            tracks=tracks,
            anchors=anchors,
            ground=site.ground,
            camera=site.camera,
            sources=file_sources(site),
            seconds=clock.perf_counter() - begun,
            cautions=tuple(caution_lines(stated)),
            statements=stated,
            _source=source,
        )._read()

    @classmethod
    def of(cls, **fields: Any) -> "Survey":
        """A survey with exactly these attributes."""
        survey = object.__new__(cls)
        survey._hold(**fields)
        return survey

    def with_tracks(self, tracks: "pd.DataFrame", cautions: Sequence[str] = ()) -> "Survey":
        """The survey with another trajectory table, and its cautions beside those that there are."""
        changes = {"tracks": trajectories_of(tracks, self.frame), "cautions": (*self.cautions, *cautions)}
        return Survey.of(**vars(self) | changes)._read()

    def _read(self) -> "Survey":
        """The survey with the part of its record read that its tracks need; nothing is read until there are tracks."""
        held = vars(self)
        source = held.get("_source")
        if source is None or self.tracks is None:
            return self
        part = wanted(source, self.tracks, self.anchors)
        return self if held.get("_part") == part else self._with_record(part)

    def at_all_times(self) -> "Survey":
        """The survey with its record read at all times, on the channels that its tracks need; memory grows with it."""
        part = vars(self).get("_part")
        return self if not part else self._with_record({"channels": part["channels"]})

    def _with_record(self, part: dict[str, Any]) -> "Survey":
        """The survey with a part of its record read."""
        begun = clock.perf_counter()
        record = vars(self)["_source"].record(**part)
        others = [one for one in self.sources if one.role != "das"]
        taken = self.seconds + clock.perf_counter() - begun
        changes = {"record": record, "sources": (*das_sources(record), *others), "seconds": taken, "_part": part}
        return Survey.of(**vars(self) | changes)

    def __getattr__(self, name: str) -> Any:
        # Before the video is tracked, nobody knows which part of the record is needed: return all of it.
        if name == "record" and "_source" in vars(self):
            self._hold(**vars(self._with_record({})))
            return vars(self)["record"]
        raise AttributeError(f"'Survey' object has no attribute {name!r}")

    def plot(self) -> "Figure":
        """Draw the survey: the record in noise sigmas, tracks, anchors, and what is left out and why."""
        from solver.survey.survey_figure import survey_figure

        return survey_figure(self)

    def __repr__(self) -> str:
        record, tracks = self.record, self.tracks
        vehicles = "a video" if tracks is None else f"{tracks['track_id'].nunique()} vehicles"
        return (
            f"<Survey {self.name}: {len(record.channel)} channels of {record.channel_spacing:.3g} m, gauges of "
            f"{record.gauge_length:.3g} m, {record.time[-1]:.0f} s at {record.sampling_rate:.3g} Hz; {vehicles}; "
            f"{len(self.anchors)} anchors>"
        )

    def _repr_html_(self) -> str:
        from solver.survey.survey_figure import survey_html

        return survey_html(self)


def ground_of(poisson_ratio: float, depth: tuple[float, float]) -> GroundSection:
    """What is known about the ground, checked like `[ground]` of site.toml."""
    from pydantic import ValidationError

    try:
        return GroundSection(poisson_ratio=poisson_ratio, depth=depth)
    except ValidationError as error:
        problem = error.errors()[0]
        name, words = problem["loc"][0], problem["msg"].removeprefix("Value error, ")
        raise InputError(f"{name}: {words}") from error


def das_sources(record: DASRecord) -> list[Source]:
    """The files, or the array, that a record was read from."""
    both = zip(record.provenance["files"], record.provenance["sha256"], strict=True)
    return [Source("das", str(path), digest) for path, digest in both]


def file_sources(site: Site) -> tuple[Source, ...]:
    """The files of a site except those of its record."""
    files: list[tuple[str, Path]] = []
    if site.trajectories:
        files += [("trajectories", path) for path in site.trajectories.files]
    if site.camera:
        roles = {"video": site.camera.video, "calibration": site.camera.calibration, "detector": site.camera.detector}
        files += [(role, path) for role, path in roles.items() if isinstance(path, Path)]
    if site.anchors:
        files.append(("anchors", site.anchors.file))
    return tuple(Source(role, str(path), checksum(path)) for role, path in files)


def table_source(role: str, table: "pd.DataFrame") -> Source:
    """A table in memory."""
    return Source(role, role, sha256(table.to_csv(index=False).encode()).hexdigest())
