"""A survey of one drive: the record, the GPS car, the operator's map."""

import time as clock
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from solver.drive.coarse import WINDOW
from solver.drive.operator_map import check_order, read_operator_map, without_repeats
from solver.drive.quiet import Quiet, slow_record, whitened
from solver.survey.anchors import Anchor, anchors_of, stated_anchors
from solver.survey.das.block import checksum
from solver.survey.das.description import description_of
from solver.survey.das.grid import part_of
from solver.survey.das.in_memory import block_of
from solver.survey.das.opened import Raw, opened
from solver.survey.das.store import Store
from solver.survey.site import Site, read_site
from solver.survey.site_sections import GroundSection
from solver.survey.survey import Source, table_source
from vision.contract import InputError, LocalFrame
from vision.contract.statements import Statements, caution_lines
from vision.contract.table import checked_tracks, read_tracks

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]

#: s of record before and after the drive; the clock may be off by as much.
AROUND = WINDOW + 20.0
#: m; a map whose nearest point is farther from the drive is of another place.
NEAREST = 200.0


@dataclass(frozen=True, eq=False, repr=False)
class Drive:
    """A survey of one drive, ready to be located.

    Parameters
    ----------
    name : of the survey
    frame : the local frame
    source : the record, to be read in part
    tracks : trajectory table of the GPS car
    vertices : of the operator's map [vertex, 2], m
    sigma : of the map, m
    length_factor : meters of cable per meter of map, loops left out, and its standard deviation
    anchors : known points of the fiber
    ground : what is known about it beforehand
    sources : files and tables that it was made from
    cautions : what the user should know about the tracks, a line each
    statements : what each track file states, and what is taken of it; of anchors what must be told
    effects : names of what the model takes for stated wrongly, out of `solver.drive.misstated.TOLD`
    """

    name: str
    frame: LocalFrame
    source: Raw | Store
    tracks: "pd.DataFrame"
    vertices: Array
    sigma: float
    length_factor: tuple[float, float]
    anchors: list[Anchor] = field(default_factory=list)
    ground: GroundSection = field(default_factory=GroundSection)
    sources: tuple[Source, ...] = ()
    seconds: float = 0.0
    cautions: tuple[str, ...] = ()
    statements: tuple[Statements, ...] = ()
    effects: tuple[str, ...] = ()

    @classmethod
    def read(cls, path: Path | str) -> "Drive":
        """Read a drive: its site.toml, or the folder that holds one, and the files that it names.

        Raises
        ------
        InputError
            If a file is missing, or cannot be used.
        """
        path = Path(path)
        return cls.of_site(read_site(path / "site.toml" if path.is_dir() else path))

    @classmethod
    def of_site(cls, site: Site) -> "Drive":
        """Read the files that a checked site.toml with `[route]` names."""
        begun = clock.perf_counter()
        route = site.route
        assert route is not None and site.trajectories is not None, "a drive has [route] and [trajectories]"
        files = [("trajectories", one) for one in site.trajectories.files] + [("route", route.file)]
        tracks, stated = read_tracks(site.trajectories.files, site.frame)
        anchors, told = stated_anchors(site.anchors.file, site.frame) if site.anchors else ([], ())
        stated += told
        return cls(
            name=site.name,
            frame=site.frame,
            source=opened(site.das.files, site.das.said, site.das.store),
            tracks=tracks,
            vertices=read_operator_map(route.file, site.frame),
            sigma=route.sigma,
            length_factor=route.length_factor,
            anchors=anchors,
            ground=site.ground,
            sources=tuple(Source(role, str(one), checksum(one)) for role, one in files),
            seconds=clock.perf_counter() - begun,
            cautions=tuple(caution_lines(stated)),
            statements=stated,
        )

    @classmethod
    def of(
        cls,
        das: Any,
        tracks: "pd.DataFrame",
        route: ArrayLike,
        *,
        frame: LocalFrame | tuple[float, float, float],
        anchors: "pd.DataFrame | None" = None,
        name: str = "drive",
        sigma: float = 8.0,
        length_factor: tuple[float, float] = (1.0, 0.02),
        time: ArrayLike | None = None,
        distance: ArrayLike | None = None,
        first_channel: int | None = None,
        **stated: Any,
    ) -> "Drive":
        """A drive in memory.

        Parameters
        ----------
        das, tracks, frame, anchors, name, time, distance, first_channel : as of `solver.survey.survey.Survey`
        route : the operator's map [vertex, 2], m in the frame
        sigma, length_factor : as `[route]` of site.toml has them
        **stated : gauge_length, channel_spacing, quantity, scale, channels, exclude

        Raises
        ------
        InputError
            If one of them cannot be used.
        """
        where = frame if isinstance(frame, LocalFrame) else LocalFrame((frame[0], frame[1]), frame[2])
        line = without_repeats(np.asarray(route, float))
        if line.ndim != 2 or line.shape[1:] != (2,) or len(line) < 2 or not np.isfinite(line).all():
            raise InputError("route: give points [vertex, 2], m, two at least")
        check_order(line, Path("route"))
        checked, told = checked_tracks(tracks, where)
        known = description_of([part_of(block_of(das, time, distance, first_channel))], **stated)
        return cls(
            name=name,
            frame=where,
            source=Raw(known),
            tracks=checked,
            vertices=line,
            sigma=sigma,
            length_factor=length_factor,
            anchors=[] if anchors is None else anchors_of(anchors, where),
            sources=(table_source("trajectories", tracks),),
            cautions=tuple(caution_lines([told])),
            statements=(told,),
        )

    def span(self) -> tuple[np.datetime64, np.datetime64]:
        """First and last fix, UTC."""
        times = self.tracks["time"].dt.tz_convert(None).to_numpy("datetime64[ns]")
        return times.min(), times.max()

    def check_clocks(self) -> None:
        """Raise InputError where drive and record are of different times, or clocks of different zones."""
        begin, end = self.span()
        margin = np.timedelta64(round(1e9 * WINDOW), "ns")
        first, last = self.source.start, self.source.end
        if begin <= last + margin and end >= first - margin and overlap((begin, end), (first, last)) > 0.2:
            return
        said = f"GPS from {stamp(begin)} to {stamp(end)}, record from {stamp(first)} to {stamp(last)}"
        for quarter in sorted(range(-56, 57), key=abs):
            shift = np.timedelta64(15 * quarter, "m")
            if quarter and overlap((begin + shift, end + shift), (first, last)) > 0.9:
                raise InputError(
                    f"trajectories: {said}: they are {abs(quarter) / 4:g} h apart, as where one is in local time; "
                    "write both in UTC"
                )
        raise InputError(f"trajectories: {said}; give a record of the drive")

    def check_near(self) -> None:
        """Raise InputError where the map never comes near the drive, or would all along if it were not mistaken."""
        from scipy.spatial import KDTree

        from solver.drive.path import BESIDE, MISTAKES, path_of

        points = self.tracks[["x", "y"]].to_numpy(float)
        path = path_of(self.vertices)
        tree = KDTree(path.points[path.first : path.first + max(2, round(path.length))])
        away = tree.query(points)[0]
        near = float((away < BESIDE).mean())
        for right, turn in MISTAKES.items() if near < 0.5 else ():
            # All of these undo themselves: what mends the fixes mends the map.
            instead = float((tree.query(points @ np.array(turn))[0] < BESIDE).mean())
            if instead > 0.9:
                raise InputError(
                    f"route: {100 * near:.0f} % of the car's fixes are beside the map, and {100 * instead:.0f} % would "
                    f"be if {right} in one of the two; mend [route] file or the GPS, whichever is wrong"
                )
        if (nearest := float(away.min())) > NEAREST:
            raise InputError(
                f"route: the drive never comes within {nearest:.0f} m of the map; check [route] file, and that map and "
                "GPS are in one coordinate system"
            )

    def quiet(self) -> Quiet:
        """The whitened record of the time of the drive."""
        begin, end = self.span()
        around = np.timedelta64(round(1e9 * AROUND), "ns")
        return whitened(slow_record(self.source, [(begin - around, end + around)]))

    def __repr__(self) -> str:
        begin, end = self.span()
        way = float(np.hypot(*np.diff(self.vertices, axis=0).T).sum())
        first, last = self.source.channels
        return (
            f"<Drive {self.name}: {last - first + 1} channels of {self.source.channel_spacing:.3g} m, a map of "
            f"{way / 1e3:.2f} km, {(end - begin) / np.timedelta64(60, 's'):.0f} minutes of GPS; "
            f"{len(self.anchors)} anchors>"
        )


def overlap(one: tuple[np.datetime64, np.datetime64], other: tuple[np.datetime64, np.datetime64]) -> float:
    """Share of the first span that lies in the second."""
    inside = min(one[1], other[1]) - max(one[0], other[0])
    return max(0.0, float(inside / max(one[1] - one[0], np.timedelta64(1, "ns"))))


def stamp(time: np.datetime64) -> str:
    """A time, to the second."""
    return f"{np.datetime_as_string(time, unit='s')}Z"
