"""The error ladder: how far the route moves from model to model, and whether it is the better for it."""

from dataclasses import replace

import numpy as np

from solver.fit.result import FitResult
from solver.run.glimpse import glimpse_of
from solver.run.run import Run
from solver.run.rung import Route, Rung

#: Checks of what a model leaves.
MISFITS = ("misfit", "held-out passes")


def known_route(result: FitResult) -> Route:
    """Channel number and place, to a tenth of a millimeter, of every channel that a result constrains."""
    rows = np.column_stack([result.channel, result.route.round(4)])[result.constrained]
    return tuple((c, x, y, z) for c, x, y, z in rows.tolist())


def apart(one: Route, other: Route) -> float:
    """Largest distance between two routes over the channels that both constrain, m; NaN where there are none.

    >>> apart(((7, 0.0, 4.0, 1.0), (8, 1.0, 4.0, 1.0)), ((8, 1.0, 4.3, 1.4), (9, 2.0, 9.0, 1.0)))
    0.5
    """
    first, second = ({row[0]: row[1:] for row in route} for route in (one, other))
    common = sorted(set(first) & set(second))
    shift = np.array([first[c] for c in common]) - np.array([second[c] for c in common])
    return float(np.linalg.norm(shift, axis=1).max().round(4)) if common else float("nan")


def moved(one: FitResult, other: FitResult) -> float:
    """Largest difference of two routes there along x, y or z, in the larger of their sigmas; NaN likewise."""
    common = np.intersect1d(one.channel[one.constrained], other.channel[other.constrained])
    (first, sigma), (second, later) = (
        (fit.route[at], fit.sigma[at]) for fit in (one, other) for at in [np.searchsorted(fit.channel, common)]
    )
    return float(np.max(np.abs(first - second) / np.fmax(sigma, later))) if len(first) else float("nan")


def first_rung(run: Run) -> Rung:
    """The rung that a run is by itself."""
    facts = run.facts
    held_out, floor = facts["held_out_chi2_per_dof"], facts["noise_floor"]
    route = known_route(run.result)
    effects, misfit = tuple(facts["effects"]), run.result.chi2_per_dof
    return Rung(effects, misfit, held_out, floor, 0.0, 0.0, run.folder, route, glimpse=glimpse_of(run))


def rungs_of(run: Run) -> tuple[Rung, ...]:
    """The ladder that a run has, or begins."""
    return run.rungs or (first_rung(run),)


def climbed(before: Run, after: Run) -> tuple[Rung, ...]:
    """The ladder of a run with a rung for the run that grew out of it, and the caveats of that rung."""
    below, rung = rungs_of(before), first_rung(after)
    change = apart(known_route(before.result), rung.route)
    since = apart(below[0].route, rung.route)
    words = tuple(doubts(before, after, change))
    # The same pass all the way up.
    glimpse = glimpse_of(after, "" if below[0].glimpse is None else below[0].glimpse.track)
    return *below, replace(rung, route_change=change, route_change_from_first=since, words=words, glimpse=glimpse)


def doubts(before: Run, after: Run, change: float) -> list[str]:
    """Why the route of a rung is not better than that of the rung before; empty where nothing speaks against it.

    Parameters
    ----------
    change : of the route, m
    """
    known = {one.name for one in before.problem.effects}
    lines = [
        f"{one.name} is a discrepancy model: it names no cause, and the route is no better founded with it"
        for one in after.problem.effects
        if one.generic and one.name not in known
    ]
    misfits = [one for one in after.facts["trust"]["gates"] if one["name"] in MISFITS and one["verdict"] == "failed"]
    sigmas = moved(before.result, after.result)
    if misfits and sigmas > 1:
        left = "; ".join(one["words"] for one in misfits)
        lines.append(
            f"the model still leaves too much ({left}), and the route moved by {change:.2f} m, {sigmas:.1f} of its "
            "sigmas: it is no better founded than before; `roadfiber diagnose` this run"
        )
    return lines
