"""A model that grows: add an effect to a run, rung by rung, and see whether passes held out agree."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from solver.catalogue.catalogue import find
from solver.criticism.refit import Refit, elsewhere, race
from solver.criticism.repairs import SEARCHES, TAKEN_OUT, mended
from solver.criticism.scorer import Scorer
from solver.effect import Effect
from solver.fit.held_out import HeldOut, held_out
from solver.fit.least_squares import Solution, solve
from solver.fit.map_fit import MapFit
from solver.fit.posterior import assemble
from solver.fit.problem import Problem
from solver.fit.result import FitResult
from solver.fit.sides import reopened
from solver.fit.state import State
from solver.fit.track_trust import strict_tracks, track_spread
from solver.run.facts import fitted_facts, strict
from solver.run.report import told
from solver.run.run import Run
from vision.contract import InputError

#: Rows of channel number, x, y, z (m).
Route = tuple[tuple[float, float, float, float], ...]
#: Fall of chi2 that is chance.
CHANCE = 4.0
#: Checks of what a model leaves.
MISFITS = ("misfit", "held-out passes")


@dataclass(frozen=True)
class Rung:
    """One model on the error ladder.

    Parameters
    ----------
    effects : in the model
    chi2_per_dof, held_out_chi2_per_dof, noise_floor : misfit of the fit, of passes it has not seen, and of noise alone
    route_change : largest way that the route moved from the rung before, m
    route_change_from_first : and from the first rung, m
    run : folder of the rung, seen from that of the ladder: a label, nothing is read there; None where it was not kept
    route : channel number and x, y, z, m, of every channel that is constrained
    words : what must be said of it first; nothing where the route is better founded than that of the rung before
    """

    effects: tuple[str, ...]
    chi2_per_dof: float
    held_out_chi2_per_dof: float | None
    noise_floor: float | None
    route_change: float
    route_change_from_first: float
    run: str | None
    route: Route
    words: tuple[str, ...] = ()


@dataclass(frozen=True)
class Grown:
    """A run's fit with more in its model.

    Parameters
    ----------
    fit, solution : with it
    held_out : misfit of held-out passes before and after; None where it cannot be compared
    """

    fit: MapFit
    solution: Solution
    held_out: tuple[HeldOut | None, HeldOut | None]

    @property
    def better(self) -> bool:
        """Whether passes held out agree that it is better, by more than what does nothing may gain by chance."""
        before, after = self.held_out
        if before is None or after is None:
            return True
        return after.chi2_per_dof < before.chi2_per_dof - CHANCE / float(self.fit.measured.sum())

    @property
    def held_out_words(self) -> str:
        """Held-out misfit per degree of freedom before and after."""
        before, after = ("-" if one is None else f"{one.chi2_per_dof:.3f}" for one in self.held_out)
        return f"{before} to {after}"

    def result(self, seconds: float) -> FitResult:
        """The fit as a result that took so many seconds."""
        return assemble(
            self.fit.problem,
            self.fit,
            self.solution.state,
            method="spline",
            iterations=self.solution.iterations,
            seconds=seconds,
            converged=self.solution.converged,
        )


def grow(
    fit: MapFit,
    state: State,
    name: str,
    catalogue: Mapping[str, Effect],
    advance: Callable[[int], None] = lambda n: None,
) -> Grown:
    """Add one effect, or mend one fault, and fit everything again.

    Parameters
    ----------
    fit, state : converged, without it
    name : of the effect or fault
    catalogue : effects by name

    Raises
    ------
    InputError
        If there is no such effect, it is in the model already, or it does nothing in this survey.
    """

    def unseen(fit: MapFit, end: Solution) -> HeldOut | None:
        return held_out(fit.problem, advance, at=(fit, end.state))

    check_names([name], fit.problem, catalogue)
    before = held_out(fit.problem, advance, at=(fit, state))
    if name in SEARCHES:
        fault = SEARCHES[name](fit, state)
        if fault is None:
            raise InputError(f"{name}: nothing of the kind is in this survey's residual")
        new, end = mended(fit, state, fault)
        if name in TAKEN_OUT:
            # Samples are taken out and no model changes: there is nothing that held-out passes could compare.
            return Grown(new, end, (None, unseen(new, end)))
        return Grown(new, end, (before, unseen(new, end)))
    # Tracks that may be off by anything would take up what shifts them all.
    trusted = MapFit(strict_tracks(fit.problem, track_spread(fit.problem.passes, state.vehicles.along.numpy())))
    refit = fitted_with(trusted, solve(trusted, state, iterations=60).state, catalogue[name], advance)
    new = MapFit(replace(refit.fit.problem, prior=fit.problem.prior))
    end = solve(new, refit.solution.state, iterations=60)
    return Grown(new, end, (before, unseen(new, end)))


def check_names(names: Sequence[str], problem: Problem, catalogue: Mapping[str, Effect]) -> None:
    """Refuse names of which there is no effect or fault, or whose effect is in the model already.

    Raises
    ------
    InputError
        For the first of them.
    """
    present = {one.name for one in problem.effects}
    for name in names:
        if name not in SEARCHES:
            find(name, catalogue)
        if name in present:
            raise InputError(f"{name}: is in the model already; choose another effect")
        present.add(name)


def fitted_with(fit: MapFit, state: State, effect: Effect, advance: Callable[[int], None]) -> Refit:
    """A full fit with one more effect, from its score estimate."""
    scorer = Scorer(fit, state)
    scores = sorted(scorer.scores(effect), key=lambda s: s.evidence)
    if not scores or not scores[-1].freedom:
        raise InputError(f"{effect.name}: does nothing in this survey; nothing to add")
    result = race(scorer, scores[-1:], advance, elsewhere(scorer, [effect]))[effect.name]
    end = solve(result.fit, result.solution.state, iterations=60)
    return replace(result, solution=end)


def with_growth(run: Run, grown: Grown, effects: Sequence[str], seconds: float) -> Run:
    """The run as it is with more in its model."""
    result = grown.result(seconds)
    result = replace(result, ambiguous_side=reopened(run.result.ambiguous_side, result, grown.fit.problem))
    at = np.isin(result.channel, grown.fit.problem.channel)
    problem = replace(grown.fit.problem, start=result.route[at])
    facts = run.facts | {"effects": list(effects)}
    facts |= fitted_facts(result, problem, grown.held_out[1], run.facts["disputed_anchors"])
    known = {one.track_id for one in run.passes}
    passes = run.passes + [one for one in problem.passes if one.track_id not in known]
    return told(replace(run, result=result, problem=problem, facts=strict(facts), passes=passes))


def together(one: FitResult, other: FitResult) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Routes and sigmas [channel, 3], m, of two fits at the channels that both constrain."""
    common = np.intersect1d(one.channel[one.constrained], other.channel[other.constrained])
    at = ((r, np.searchsorted(r.channel, common)) for r in (one, other))
    return [(r.route[where], r.sigma[where]) for r, where in at]


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
    """The rung that a run is by itself, in its own folder."""
    facts = run.facts
    held_out, floor = facts["held_out_chi2_per_dof"], facts["noise_floor"]
    route = known_route(run.result)
    return Rung(tuple(facts["effects"]), run.result.chi2_per_dof, held_out, floor, 0.0, 0.0, ".", route)


def climbed(rungs: Sequence[Rung], before: Run, after: Run) -> list[Rung]:
    """The ladder `rungs` of a run with that of another, which has grown out of it, and what must be said of it first.

    In the folder that the new one goes to no run below is kept.
    """
    rung = first_rung(after)
    change = apart(known_route(before.result), rung.route)
    since = apart(rungs[0].route, rung.route)
    last = replace(rung, route_change=change, route_change_from_first=since, words=tuple(doubts(before, after, change)))
    return [*(replace(one, run=None) if one.run == rung.run else one for one in rungs), last]


def doubts(before: Run, after: Run, change: float) -> list[str]:
    """Why the route of a rung is no better founded than that of the one before; none where nothing speaks against it.

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
