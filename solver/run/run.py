"""One run: a located fiber, what it was made from, and how far it may be relied on."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from solver.catalogue.plugins import Catalogue, catalogue
from solver.fit.problem import Problem
from solver.fit.result import FitResult
from solver.run.scene import Scene
from solver.run.seen import Seen
from solver.survey.anchors import Anchor
from solver.trajectory.vehicle_pass import Pass
from vision.contract.errors import InputError

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from solver.fit.held_out import HeldOut
    from solver.survey.survey import Survey

#: CSS pixels of a figure in a notebook.
WIDTH = 960


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Run(Seen):
    """One located fiber: what `locate` returns, what is saved and opened, and what every other verb takes.

    Parameters
    ----------
    result : of the fit
    frame : the local frame of all x, y
    start : of the record, UTC
    time : s since `start` [sample], of the fitted samples
    passes, anchors : as fitted
    facts : the content of fit.json
    rungs : of its error ladder, itself last; none where no effect was added to it
    folder : that it was opened from; None where it was not
    added : [channel, 3, 3], m^2, by which its corridor is wider than the fit's own for what its model may lack; None
        where the corridor takes the model for granted, `facts["corridor"]` says why
    problem : what was fitted
    known : effects that its model may be given
    tracked, dropped : trajectory table, and fixes that it leaves out, where a video was tracked for this run
    scene : what a camera saw of the street; None where there was none
    """

    problem: Problem
    known: Catalogue = field(default_factory=catalogue)
    tracked: "pd.DataFrame | None" = None
    dropped: "pd.DataFrame | None" = None
    scene: Scene | None = None

    @property
    def route(self) -> "pd.DataFrame":
        """The route [channel]: channel, distance, x, y, z, their sigmas (m), latitude, longitude, constrained.

        `sigma_x` and so on hold what the model may lack; `sigma_x_fit` and so on are the fit's alone.
        """
        from solver.run.route_table import route_table

        return route_table(self.place, self.frame)

    def plot(self, width: int = WIDTH) -> "Figure":
        """Draw the route from above, its sideways place and its depth, with the 95 % corridor; width in CSS pixels."""
        from solver.run.report.route_figure import route_figure

        return route_figure(self, width)

    def save(self, folder: Path | str) -> None:
        """Write the run folder, whole or not at all; an earlier run there is replaced.

        Raises
        ------
        InputError
            If `folder` holds something else than a run, or cannot be written.
        """
        from solver.run.folder import write_run

        write_run(Path(folder), self)

    def to_geojson(self, path: Path | str) -> None:
        """Write the route as a LineString Z with its 95 % corridor and the anchors, WGS 84 (RFC 7946).

        Raises
        ------
        InputError
            If the file cannot be written.
        """
        from solver.run.geojson import route_features
        from vision.contract import require_writable, writing

        require_writable(Path(path))
        features = route_features(self.place, self.frame, self.anchors, self.name)
        with writing(Path(path)) as temporary:
            temporary.write_text(json.dumps(features, allow_nan=False), encoding="utf-8")

    def to_gis(self, *paths: Path | str, crs: str | int = "EPSG:4326", ground_height: float | None = None) -> None:
        """Write the route, its corridor and its anchors for a GIS or CAD, with accuracy classes; the suffix says how.

        Parameters
        ----------
        paths : `.gpkg`, `.geojson`, `.kml`, `.dxf`, `.csv`, or `.pdf`: one page for the file; all are written, or none
        crs : as pyproj reads it, such as "EPSG:2039", or "EPSG:2039+5773" with heights
        ground_height : of the road in a vertical CRS, m, whatever its unit: the route itself has depths below the road

        Raises
        ------
        InputError
            If the kind of file or the CRS cannot be used, a package is missing, or the file cannot be written.
        """
        from solver.run.gis.export import export
        from solver.run.gis.layers import Subject

        subject = Subject(self.place, self.frame, self.anchors, self.name, str(self.start)[:10])
        export(subject, paths, crs, ground_height)

    def to_patch(self, patch: Any) -> Any:
        """A DASCore patch of the record with the route as coordinates along its distance.

        x, y, z and their sigmas (m), latitude and longitude; NaN where neither data nor anchors decide, or the route
        does not reach. Its attributes route_trust and route_reason say how far to rely on them. InputError where the
        patch has no distance on the route.
        """
        from solver.run.gis.patch_coords import with_route

        return with_route(patch, self.route)

    def workbench(self, *, plugins: Sequence[Path | str] = (), tiles: str = "") -> Any:
        """The workbench in a notebook: what `roadfiber workbench` serves. Every effect that is added is a run folder.

        Parameters
        ----------
        plugins : files with effects of your own
        tiles : address of map tiles to draw beneath the route, such as
            "https://tile.openstreetmap.org/{z}/{x}/{y}.png"; its server learns where the survey is. "" asks nobody

        Returns
        -------
        page : a Panel object, which a notebook shows

        Raises
        ------
        InputError
            If the run was not saved, there are no such tiles, or Panel is not installed.

        Examples
        --------
        >>> rf.open(folder / "run").workbench()  # doctest: +SKIP
        """
        # The door stands above this house: who holds a run may have come through it, and knows it by name alone.
        door: Any = import_module("roadfiber.web.workbench")
        return door.in_notebook(self, plugins, tiles)

    def __repr__(self) -> str:
        return f"<Run {self.name}: {self.headline} {self.trust}>"

    def _repr_html_(self) -> str:
        from solver.run.report.report_page import render
        from vision.contract.notebook import framed

        return framed(render(self))


def require_whole(run: Run) -> None:
    """Refuse what has no one model that is criticized as a whole.

    Raises
    ------
    InputError
        If it is of a long fiber, of a drive, or several runs as one.
    """
    if not isinstance(run, Run):
        raise InputError(f"{run!r}: has no model of one street; give a run of one, such as each that was combined")
    if run.too_long:
        raise InputError(run.too_long)


def run_of(
    result: FitResult,
    survey: "Survey",
    *,
    passes: Sequence[Pass],
    anchors: Sequence[Anchor],
    problem: Problem,
    timings: Mapping[str, float],
    held_out: "HeldOut | None" = None,
    effects: Sequence[str] = (),
    warnings: Sequence[str] = (),
    disputed: Sequence[str] = (),
    known: Catalogue | None = None,
    choice: dict[str, Any] | None = None,
) -> Run:
    """The run that a fit of a survey is.

    Parameters
    ----------
    result : of the fit
    survey : that was located
    passes, anchors : as fitted
    problem : as it was fitted
    timings : s of each step, by name
    held_out : misfit of passes that the fit did not see
    effects : names of the effects in the model
    warnings : lines for the user, beside those that `solver.run.report.report_words.cautions` finds
    disputed : sentences on anchors that contradict the others
    known : effects that its model may be given; built-in and installed ones where None
    choice : what is told of the passes that were chosen, `solver.run.chosen.choice_facts`; None where all were fitted
    """
    from solver.run.facts import facts_of
    from solver.run.report.report_words import told

    record = survey.record
    facts = facts_of(result, survey, anchors, problem, timings, held_out, effects, warnings, disputed)
    facts |= {} if choice is None else {"choice": choice}
    return told(
        Run(
            result=result,
            problem=problem,
            frame=survey.frame,
            start=record.start,
            time=record.time[result.samples],
            passes=list(passes),
            anchors=list(anchors),
            facts=facts,
            known=catalogue() if known is None else known,
        )
    )
