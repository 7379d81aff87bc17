"""From a survey's files to a located fiber: read, smooth, match, fit."""

import logging
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch

from solver.anchors import Anchor, read_anchors
from solver.das import DASRecord, read_das
from solver.fit import METHODS, FitResult, Prior, Problem
from solver.fit.held_out import held_out_chi2
from solver.matched_filter import Initialization, initialize
from solver.model import Traffic
from solver.noise import noise_level, quiet
from solver.site import Site
from solver.trajectory import Pass, smooth_passes
from vision.contract import InputError, progress, read_trajectories

if TYPE_CHECKING:
    import pandas as pd

logger = logging.getLogger("roadfiber")

#: Effects that may be in the model; `locate --effects none` is the paper's point loads.
EFFECTS = ("wheel_layout",)
#: Anchors farther than this from the active channels, in meters of fiber, say nothing about them.
ANCHOR_REACH = 50.0
#: A vehicle farther than this from every fitted channel is not felt, m: under 1 % of its response when nearest.
FELT = 25.0
#: Chi2 by which one side of the road must beat the other before the side counts as known (3 sigma).
DECISIVE = 9.0


@dataclass
class Located:
    """A located fiber and all it was made from."""

    site: Site
    record: DASRecord
    passes: list[Pass]
    anchors: list[Anchor]
    result: FitResult
    held_out: float | None
    effects: Sequence[str]
    warnings: list[str] = field(default_factory=list)
    timings: dict[str, float] = field(default_factory=dict)

    def write(self, folder: Path) -> None:
        """Write the run folder, whole or not at all (see `solver.run.write_run`)."""
        from solver.run import write_run

        write_run(
            folder,
            self.result,
            site=self.site,
            record=self.record,
            passes=self.passes,
            anchors=self.anchors,
            timings=self.timings,
            held_out=self.held_out,
            effects=self.effects,
            warnings=self.warnings,
        )


@contextmanager
def timed(timings: dict[str, float], name: str) -> Iterator[None]:
    """Note how long a step takes, s."""
    begun = time.perf_counter()
    yield
    timings[name] = time.perf_counter() - begun


def straight_part(rough: Initialization, passes: Sequence[Pass], gauge: int) -> slice:
    """Active channels to fit: without the last gauge length where the fiber leaves the road before the view ends.

    A gauge across a sharp bend feels both legs; the end-point difference of the base model does not hold there.
    """
    x = np.concatenate([one.position[one.in_view, 0] for one in passes])
    x0, slope = rough.x_of_channel
    ends = np.sort((np.array([x.min(), x.max()]) - x0) / slope)
    leaves = (rough.active[0] - ends[0] > gauge / 2, ends[1] - rough.active[1] > gauge / 2)
    first, stop = gauge * leaves[0], len(rough.channel) - gauge * leaves[1]
    return slice(first, stop) if stop - first > 2 * gauge else slice(None)


def nearby(one: Pass, route: np.ndarray, reach: float = FELT) -> Pass | None:
    """The part of a pass within `reach` of the route [channel, 3], m; None where it never comes that near."""
    distance = np.hypot(*(one.position[:, None, :] - route[None, :, :2]).transpose(2, 0, 1)).min(1)
    near_rows = np.flatnonzero(distance <= reach)
    if len(near_rows) < 2:
        return None
    keep = slice(near_rows[0], near_rows[-1] + 1)
    return replace(
        one, **{name: getattr(one, name)[keep] for name in ("rows", "position", "velocity", "sigma", "in_view")}
    )


def start_route(rough: Initialization, lateral: np.ndarray, anchors: Sequence[Anchor]) -> np.ndarray:
    """Rough route [channel, 3] through the matched filter's line, moved onto the anchors where there are any."""
    route = np.column_stack([rough.route[:, 0], lateral, rough.route[:, 2]])
    if not anchors:
        return route
    at = [a.channel for a in anchors]
    for axis, name in enumerate("xyz"):
        miss = np.array([getattr(a, name) for a in anchors]) - np.interp(at, rough.channel, route[:, axis])
        # Lateral position and depth of the anchors are better than any start; x keeps the slope of the line.
        if axis:
            route[:, axis] = np.interp(rough.channel, at, [getattr(a, name) for a in anchors])
        else:
            route[:, axis] += miss.mean()
    return route


def pose(
    record: DASRecord,
    passes: Sequence[Pass],
    anchors: Sequence[Anchor],
    route: np.ndarray,
    channel: np.ndarray,
    prior: Prior,
) -> Problem:
    """State the fitting problem over the active `channel` numbers, starting at `route` [channel, 3]."""
    column = np.searchsorted(record.channel, channel)
    strain_rate = record.strain_rate[:, column]
    noise = noise_level(strain_rate, quiet(len(strain_rate), route, passes))
    alive = np.isfinite(noise) & (noise > 0)
    passes = [part for one in passes if (part := nearby(one, route)) is not None]
    traffic = Traffic.of(passes)
    return Problem(
        strain_rate=torch.from_numpy(strain_rate[traffic.samples][:, alive]),
        noise=torch.from_numpy(noise[alive]),
        channel=channel[alive],
        zero_distance=float(record.distance[0] - record.channel[0] * record.channel_spacing),
        channel_spacing=record.channel_spacing,
        gauge_length=record.gauge_length,
        passes=passes,
        traffic=traffic,
        anchors=anchors,
        start=route[alive],
        prior=prior,
    )


def chi2(result: FitResult) -> float:
    """Weighted misfit of a fit."""
    return float(np.nansum(result.weight * result.residual**2))


def fit_sides(problems: Sequence[Problem], method: str) -> tuple[FitResult, Problem]:
    """Fit every start; the best is returned, marked ambiguous where another fits about as well elsewhere."""
    fit, steps = METHODS[method]
    ends = []
    for problem in problems:
        with progress("fitting the route", steps) as advance:
            ends.append((fit(problem, advance), problem))
    ends.sort(key=lambda end: chi2(end[0]))
    (best, problem), others = ends[0], ends[1:]
    # Where the model leaves more than noise, so much more must a rival be worse to be ruled out.
    least = DECISIVE * max(1.0, best.chi2_per_dof)
    rivals = [r for r, _ in others if chi2(r) - chi2(best) < least and apart(r, best)]
    return replace(best, ambiguous_side=bool(rivals)), problem


def apart(one: FitResult, other: FitResult) -> bool:
    """Whether two routes differ by more than their own uncertainty."""
    shift = np.abs(one.route[:, 1] - other.route[:, 1])
    return bool(np.median(shift) > max(0.5, 3 * float(np.nanmedian(other.sigma[:, 1]))))


def near(anchors: Sequence[Anchor], active: tuple[int, int], spacing: float, warnings: list[str]) -> list[Anchor]:
    """Anchors within reach of the active channels; the others are named in `warnings`."""
    reach = ANCHOR_REACH / spacing
    used = [a for a in anchors if active[0] - reach <= a.channel <= active[1] + reach]
    far = [a.name for a in anchors if a not in used]
    if far:
        warnings.append(f"anchors too far from the located channels to matter: {', '.join(far)}")
    return used


def locate(
    site: Site,
    table: "pd.DataFrame | None" = None,
    *,
    method: str = "spline",
    effects: Sequence[str] = EFFECTS,
) -> Located:
    """Locate the fiber of a survey.

    Parameters
    ----------
    site : the survey, see `solver.site.read_site`
    table : trajectory table; the site's trajectory files where None
    method : "spline" (default) or "network" (the paper's)
    effects : names out of `EFFECTS`; empty = the paper's point loads

    Raises
    ------
    InputError
        If files cannot be used, clocks do not overlap, or no vehicle is seen in the DAS.
    """
    if method not in METHODS:
        raise InputError(f"--method {method}: not known; choose one of {', '.join(METHODS)}")
    if unknown := set(effects) - set(EFFECTS):
        raise InputError(
            f"--effects {', '.join(sorted(unknown))}: not known; choose out of {', '.join(EFFECTS)}, or none"
        )
    timings: dict[str, float] = {}
    warnings: list[str] = []
    with timed(timings, "read"):
        if table is None:
            if site.trajectories is None:
                raise InputError(f"{site.name}: has a camera only; track its video first and give the trajectories")
            table = read_trajectories(site.trajectories.files, site.frame)
        record = read_das(
            site.das.files,
            **{
                k: getattr(site.das, k)
                for k in ("gauge_length", "channel_spacing", "quantity", "scale", "channels", "exclude")
            },
        )
        anchors = read_anchors(site.anchors.file, site.frame) if site.anchors else []
    with timed(timings, "smooth"):
        passes = smooth_passes(table, record)
        if "wheel_layout" not in effects:
            passes = [replace(one, vehicle_class="vehicle") for one in passes]
    ground = site.ground
    with timed(timings, "match"):
        rough = initialize(record, passes, depth=ground.depth[0], poisson_ratio=ground.poisson_ratio)
    anchors = near(anchors, rough.active, record.channel_spacing, warnings)
    prior = Prior(depth=ground.depth, poisson_ratio=(ground.poisson_ratio, Prior.poisson_ratio[1]))
    keep = straight_part(rough, passes, round(record.gauge_length / record.channel_spacing))
    sides = [rough.lateral] if anchors else [rough.lateral, rough.mirror]
    starts = [start_route(rough, y, anchors)[keep] for y in sides]
    problems = [pose(record, passes, anchors, start, rough.channel[keep], prior) for start in starts]
    with timed(timings, "fit"):
        result, problem = fit_sides(problems, method)
    with timed(timings, "held_out"):
        found = result.route[np.isin(result.channel, problem.channel)]
        held_out = held_out_chi2(replace(problem, start=found)) if method == "spline" else None
    return Located(site, record, passes, anchors, result, held_out, effects, warnings, timings)
