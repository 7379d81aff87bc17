"""Several runs of one fiber, of several days or cameras, as one route."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from solver.effect import Effect
from solver.fit.joint import joint_fit
from solver.fit.pose import shortened
from solver.fit.posterior import TAILS, Posterior, gauge_coverage, lateral_share
from solver.fit.problem import Problem
from solver.fit.result import Placed
from solver.run import arrays
from solver.run.folder import read_run, write_run
from solver.run.geojson import Z95, half_width, normals, route_features
from solver.run.read_stored import read_model
from solver.run.route_table import route_csv, route_table
from solver.run.run import Run
from solver.run.run_corridor import lacking
from solver.run.stored_types import Maybe, Positive, Stored, Text
from solver.run.strict_json import strict
from vision.contract import InputError, LocalFrame, require_writable, writing, writing_into

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

FORMAT = "roadfiber combined 2"
#: What marks a folder of combined runs, and what lies in it beside the route: its runs, by number.
FILE, RUNS = "combined.json", "runs"
#: Kind and axes of every array of data.npz: those of a run's route.
EXPECTED: arrays.Expected = {
    **{name: arrays.EXPECTED[name] for name in ("channel", "distance", "route", "covariance", "constrained")},
    "fit_covariance": arrays.EXPECTED["covariance"],
}
#: Sigmas beyond which a run disagrees with the others.
APART = 3.0
#: Share of a run's own variance that its difference from the whole has at least: fits end within a part of a sigma.
LEAST = 0.25
#: Passes of two runs that are at one place within this time, s, are one.
SAME = 0.5
#: CSS pixels of the figure.
WIDTH = 960


@dataclass(frozen=True)
class Agreement:
    """How far a run by itself is from the combined route.

    Parameters
    ----------
    run : its name
    passes : of it
    across, depth : mean difference over the channels that both have, m, toward +y and down
    across_z, depth_z : the same in the sigmas that it should have
    """

    run: Text
    passes: int
    across: float
    depth: float
    across_z: float
    depth_z: float


class PoissonFile(Stored):
    """Poisson's ratio of the ground.

    Attributes
    ----------
    value, sigma : and its standard deviation
    """

    value: float
    sigma: Maybe


class CombinedFile(Stored):
    """combined.json: one route from several runs.

    Attributes
    ----------
    format : of the file
    headline : what was combined and whether it agrees
    converged : whether the fit did
    chi2_per_dof : misfit of all
    widened : what all sigmas are times since the runs differ by more than they say; 1 where they agree
    poisson_ratio : of the ground
    channels : first and last
    runs : how far each by itself is from the whole; their run folders are `runs/1` and so on
    """

    format: Literal["roadfiber combined 2"]
    headline: Text
    converged: bool
    chi2_per_dof: Maybe
    widened: Positive
    poisson_ratio: PoissonFile
    channels: tuple[int, int]
    runs: Annotated[tuple[Agreement, ...], Field(min_length=2)]


@dataclass(frozen=True, repr=False)
class Combined:
    """A route from several runs, through their normal equations.

    Parameters
    ----------
    runs : that were combined
    frame : of all x, y
    place : the route and its covariance
    poisson_ratio : of the ground, and its sigma
    chi2_per_dof : misfit of all
    converged : whether the fit did
    widened : what all sigmas are times since the runs differ by more than they say; 1 where they agree
    agreement : of each run
    """

    runs: Sequence[Run]
    frame: LocalFrame
    place: Placed
    poisson_ratio: tuple[float, float]
    chi2_per_dof: float
    converged: bool
    widened: float
    agreement: tuple[Agreement, ...]

    @property
    def headline(self) -> str:
        """What was combined and whether it agrees, in a line."""
        apart = [one.run for one in self.agreement if max(abs(one.across_z), abs(one.depth_z)) > APART]
        passes = sum(one.passes for one in self.agreement)
        said = f"{len(self.runs)} runs with {passes} passes make one route"
        if not self.converged:
            return f"{said}, but the fit did not converge: do not rely on it"
        across = self.place.sigma[self.place.constrained, 1]
        sure = f"1 sigma {across.max():.2f} m across at most" if len(across) else "whose place no data decide"
        if apart:
            return f"{said}, {sure}; {', '.join(apart)} differ from it by more than their sigmas: check calibrations"
        return f"{said}, {sure}; all agree with it"

    @cached_property
    def facts(self) -> dict[str, Any]:
        """The content of combined.json."""
        facts = {
            "format": FORMAT,
            "headline": self.headline,
            "converged": self.converged,
            "chi2_per_dof": self.chi2_per_dof,
            "widened": self.widened,
            "poisson_ratio": {"value": self.poisson_ratio[0], "sigma": self.poisson_ratio[1]},
            "channels": [int(self.place.channel[0]), int(self.place.channel[-1])],
            "runs": [vars(one) for one in self.agreement],
        }
        checked: dict[str, Any] = strict(facts)
        return checked

    @property
    def name(self) -> str:
        """Of the surveys."""
        return ", ".join(dict.fromkeys(run.name for run in self.runs))

    @property
    def table(self) -> "pd.DataFrame":
        """How far each run by itself is from the combined route: run, passes, across, depth (m), their z."""
        import pandas as pd

        return pd.DataFrame([vars(one) for one in self.agreement])

    @property
    def route(self) -> "pd.DataFrame":
        """The route [channel]: columns as of `Run.route`."""
        return route_table(self.judged, self.frame)

    @property
    def judged(self) -> Placed:
        """The route with the worst grade of its runs, and what their corridors leave out."""
        grades = [str(run.facts["trust"]["grade"]) for run in self.runs]
        grade = "weak" if not self.converged else max(grades, key=("good", "fair", "weak", "poor").index)
        told = zip(self.agreement, self.runs, strict=True)
        left_out = " ".join(f"{one.run}: {run.place.left_out}" for one, run in told if run.place.left_out)
        return replace(self.place, grade=grade, trust=f"{self.headline}.", left_out=left_out)

    def plot(self, width: int = WIDTH) -> "Figure":
        """Draw sideways place and depth of the combined route with its 95 % corridor, and of each run by itself."""
        from solver.run.report.combined_figure import combined_figure

        return combined_figure(self, width)

    def to_geojson(self, path: Path | str) -> None:
        """Write the route with its 95 % corridor and all anchors, WGS 84; InputError where it cannot be written."""
        require_writable(Path(path))
        with writing_into(Path(path).parent) as folder:
            (folder / Path(path).name).write_text(json.dumps(self._features(), allow_nan=False), encoding="utf-8")

    def to_gis(self, *paths: Path | str, crs: str | int = "EPSG:4326", ground_height: float | None = None) -> None:
        """Write the route for a GIS or CAD; parameters and errors as of `Run.to_gis`."""
        from solver.run.gis.export import export
        from solver.run.gis.layers import Subject

        anchors = {(a.name, a.channel): a for run in self.runs for a in run.anchors}
        days = ", ".join(sorted({str(run.start)[:10] for run in self.runs}))
        export(Subject(self.judged, self.frame, list(anchors.values()), self.name, days), paths, crs, ground_height)

    def save(self, folder: Path | str) -> None:
        """Write a folder that `rf.open` reads: the route and the runs, whole or not at all; an earlier one is replaced.

        `route.csv`, `route.geojson`, `combined.json`, `combined.html` and `data.npz` go there, and each run's own
        folder into `runs`.

        Raises
        ------
        InputError
            If `folder` holds something else than combined runs, or cannot be written.
        """
        folder = Path(folder)
        check_place(folder)
        place = {name: getattr(self.place, name) for name in EXPECTED}
        with writing(folder) as into:
            into.mkdir()
            (into / "route.csv").write_text(route_csv(self.route), encoding="utf-8")
            (into / "route.geojson").write_text(json.dumps(self._features(), allow_nan=False), encoding="utf-8")
            (into / FILE).write_text(json.dumps(self.facts, allow_nan=False, indent=1), encoding="utf-8")
            (into / "combined.html").write_text(self.page(), encoding="utf-8")
            np.savez_compressed(into / "data.npz", **place)
            for number, run in enumerate(self.runs, 1):
                write_run(into / RUNS / str(number), run)

    def page(self) -> str:
        """One page that opens offline."""
        from solver.run.report.combined_page import combined_page

        return combined_page(self)

    def _features(self) -> dict[str, Any]:
        anchors = {(a.name, a.channel): a for run in self.runs for a in run.anchors}
        return route_features(self.judged, self.frame, list(anchors.values()), self.name)

    def __repr__(self) -> str:
        return f"<Combined {self.headline}>"

    def _repr_html_(self) -> str:
        from vision.contract.notebook import framed

        return framed(self.page())


def check_place(folder: Path) -> None:
    """Refuse, before any work, a folder that holds something else than combined runs, or cannot be written."""
    if folder.is_dir() and any(folder.iterdir()) and not is_combined(folder):
        raise InputError(f"{folder}: holds something else than combined runs; give the name of a new folder")
    require_writable(folder)


def is_combined(folder: Path) -> bool:
    """Whether a folder holds combined runs."""
    return (folder / FILE).is_file()


def read_combined(
    folder: Path, *, plugins: Sequence[Path] = (), effects: Iterable[Effect] = (), changed: bool = False
) -> Combined:
    """Read a folder that `Combined.save` wrote; arguments and errors as of `solver.run.folder.read_run`."""
    facts = read_model(folder / FILE, CombinedFile, "run `roadfiber combine` again")
    found: dict[str, Any] = arrays.read_arrays(folder / "data.npz", EXPECTED)
    if not all(np.isfinite(found[name]).all() for name in ("distance", "route")):
        raise InputError(f"{folder / 'data.npz'}: not the arrays of a route; run `roadfiber combine` again")
    numbers, known = range(1, 1 + len(facts.runs)), tuple(effects)
    runs = [read_run(folder / RUNS / str(n), plugins=plugins, effects=known, changed=changed) for n in numbers]
    return Combined(
        runs=runs,
        frame=runs[0].frame,
        place=Placed(**found),
        poisson_ratio=(facts.poisson_ratio.value, facts.poisson_ratio.sigma or np.nan),
        chi2_per_dof=facts.chi2_per_dof or np.nan,
        converged=facts.converged,
        widened=facts.widened,
        agreement=facts.runs,
    )


def label(run: Run) -> str:
    """What a run is called beside others: its folder, or its survey and the time of its record."""
    return run.folder.name if run.folder else f"{run.name} {str(run.start)[:16]}"


def require_one_fiber(runs: Sequence[Run]) -> None:
    """Refuse runs that are not of one fiber in one frame, or that share vehicles.

    Raises
    ------
    InputError
        Says which two, in what they differ, and how to mend it.
    """
    if len(runs) < 2:
        raise InputError("combine: give two runs at least, of one fiber")
    first = runs[0]
    for run in runs:
        both = f"combine: {label(first)} and {label(run)}"
        if run.result.method != "spline":
            raise InputError(f"combine: {label(run)}: --method {run.result.method} has no sigmas; locate with spline")
        if (run.frame.origin, run.frame.x_azimuth) != (first.frame.origin, first.frame.x_azimuth):
            raise InputError(f"{both} have different frames; give both sites the same [frame] and locate again")
        for name in ("channel_spacing", "zero_distance"):
            one, other = getattr(first.problem, name), getattr(run.problem, name)
            if abs(one - other) > 1e-6 * max(1.0, abs(one)):
                raise InputError(
                    f"{both} differ in {name.replace('_', ' ')} ({one:g} and {other:g} m), so that their channels are "
                    "not the same places of the fiber"
                )
        if {e.name for e in run.problem.effects} != {e.name for e in first.problem.effects}:
            raise InputError(f"{both} have different effects in their models; add the same to both")
    seen: list[tuple[Run, float, float]] = []
    for run in runs:
        mine = moments(run)
        for other, when, speed in seen:
            near = [one for one in mine if abs(one[0] - when) < SAME and abs(one[1] - speed) < 0.1 * abs(speed)]
            if near:
                raise InputError(
                    f"combine: {label(other)} and {label(run)} hold the same vehicle at {np.datetime64(int(when), 's')}"
                    "; a vehicle counts once: give runs of other times"
                )
        seen += [(run, *one) for one in mine]


def moments(run: Run) -> list[tuple[float, float]]:
    """When, s since 1970, and how fast, m/s, each pass of a run went by the middle of its way."""
    start = run.start.astype("datetime64[ns]").astype(np.int64) / 1e9
    return [(start + float(run.problem.time_of(one.rows[len(one.rows) // 2])), one.speed) for one in run.problem.passes]


def combine(*runs: Run) -> Combined:
    """Combine runs of one fiber; see `rf.combine`."""
    require_one_fiber(runs)
    problems = [shortened(run.problem, slice(None), run.result) for run in runs]
    chain, end = joint_fit(problems, [run.result for run in runs])
    whole: Problem = chain.problem
    channel, posterior = whole.route_channel, Posterior(chain, end.at)
    route, covariance, _, shape = posterior.route(whole.distance_of(channel))
    sure = (lateral_share(route, covariance, shape) > 0.5) & np.any(
        [gauge_coverage(one, channel) for one in problems], axis=0
    )
    covariance = covariance + (TAILS - 1) * shape
    agreement = tuple(agreed(run, channel, route, covariance) for run in runs)
    z = np.array([(one.across_z, one.depth_z) for one in agreement])
    widened = max(1.0, float(np.sqrt((z**2).mean())))
    ratio, own = chain.layout["poisson_ratio"].start, widened**2 * covariance
    return Combined(
        runs=runs,
        frame=runs[0].frame,
        place=Placed(channel, whole.distance_of(channel), route, own + lacking(runs, channel), sure, own),
        poisson_ratio=(float(end.state.poisson_ratio), widened * float(posterior.sigmas()[ratio])),
        chi2_per_dof=posterior.chi2_per_dof,
        converged=end.converged,
        widened=widened,
        agreement=agreement,
    )


def agreed(run: Run, channel: NDArray[np.int64], route: Array, covariance: Array) -> Agreement:
    """How far a run by itself is from a route [channel, 3] that it is part of.

    The difference of an estimate and of a better one that holds it has the difference of their variances; over the
    channels it is taken to be one error.
    """
    mine, theirs = np.isin(run.result.channel, run.problem.channel), np.isin(channel, run.problem.channel)
    across = normals(route[theirs])
    off = run.result.route[mine] - route[theirs]
    sides = np.einsum("ca,ca->c", across, off[:, :2]) * np.sign(across[:, 1])
    own, both = (half_width(route[theirs], one) ** 2 for one in (run.result.covariance[mine], covariance[theirs]))
    widths = float(np.maximum(own - both, LEAST * own).mean()) ** 0.5 / Z95
    deep, deeper = run.result.covariance[mine][:, 2, 2], covariance[theirs][:, 2, 2]
    heights = float(np.maximum(deep - deeper, LEAST * deep).mean()) ** 0.5
    across_m, depth_m = float(sides.mean()), float(off[:, 2].mean())
    return Agreement(label(run), len(run.problem.passes), across_m, depth_m, across_m / widths, depth_m / heights)
