"""A model that grows: add an effect to a run, rung by rung, and see whether passes held out agree."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from solver.criticism.refit import Refit, elsewhere, race
from solver.criticism.repairs import SEARCHES, TAKEN_OUT, mended
from solver.criticism.scorer import Scorer
from solver.criticism.track_trust import strict_tracks, track_spread
from solver.effects.catalogue import find
from solver.effects.effect import Effect
from solver.fit.held_out import held_out_chi2
from solver.fit.least_squares import Solution, solve
from solver.fit.map_fit import MapFit
from solver.fit.posterior import assemble
from solver.fit.result import FitResult
from solver.fit.sides import reopened
from solver.fit.state import State
from solver.run.contents import Run
from solver.run.facts import strict
from solver.run.problem_arrays import problem_facts
from vision.contract import InputError

#: Fall of chi2 that is chance.
CHANCE = 4.0


@dataclass(frozen=True)
class Rung:
    """One model on the error ladder.

    Parameters
    ----------
    effects : in the model
    chi2_per_dof, held_out_chi2_per_dof, noise_floor : misfit of the fit, of passes it has not seen, and of noise alone
    route_change : largest way that the route moved from the rung before, m
    route_change_from_first : and from the first rung, m
    run : folder of the rung
    """

    effects: tuple[str, ...]
    chi2_per_dof: float
    held_out_chi2_per_dof: float | None
    noise_floor: float | None
    route_change: float
    route_change_from_first: float
    run: str


@dataclass(frozen=True)
class Grown:
    """A run's fit with more in its model.

    Parameters
    ----------
    fit, solution : with it
    held_out : chi2 per degree of freedom of held-out passes before and after; None where it cannot be compared
    """

    fit: MapFit
    solution: Solution
    held_out: tuple[float | None, float | None]

    @property
    def better(self) -> bool:
        """Whether passes held out agree that it is better, by more than what does nothing may gain by chance."""
        before, after = self.held_out
        return before is None or after is None or after < before - CHANCE / float(self.fit.measured.sum())

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
    # Tracks that may be off by anything would take up what shifts them all, held-out ones too.
    trusting = strict_tracks(fit.problem, track_spread(fit.problem.passes, state.vehicles.along.numpy()))

    def held_out(fit: MapFit, state: State) -> float | None:
        return held_out_chi2(replace(fit.problem, prior=trusting.prior), advance, at=(fit, state))

    before = held_out(fit, state)
    if name in SEARCHES:
        fault = SEARCHES[name](fit, state)
        if fault is None:
            raise InputError(f"{name}: nothing of the kind is in this survey's residual")
        new, end = mended(fit, state, fault)
        if name in TAKEN_OUT:
            # Samples are taken out and no model changes: there is nothing that held-out passes could compare.
            return Grown(new, end, (None, before))
        return Grown(new, end, (before, held_out(new, end.state)))
    effect = find(name, dict(catalogue))
    if name in {one.name for one in fit.problem.effects}:
        raise InputError(f"{name}: is in the model already; choose another effect")
    trusted = MapFit(trusting)
    refit = fitted_with(trusted, solve(trusted, state, iterations=60).state, effect, advance)
    new = MapFit(replace(refit.fit.problem, prior=fit.problem.prior))
    end = solve(new, refit.solution.state, iterations=60)
    return Grown(new, end, (before, held_out(new, end.state)))


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
    facts = run.facts | {
        "effects": list(effects),
        "parameters": {name: asdict(parameter) for name, parameter in result.parameters.items()},
        "chi2": result.chi2,
        "chi2_per_dof": result.chi2_per_dof,
        "held_out_chi2_per_dof": grown.held_out[1],
        "converged": result.converged,
        "ambiguous_side": result.ambiguous_side,
        "iterations": result.iterations,
        "seconds": seconds,
        "problem": problem_facts(problem),
    }
    checked: dict[str, Any] = strict(facts)
    known = {one.track_id for one in run.passes}
    passes = run.passes + [one for one in problem.passes if one.track_id not in known]
    return replace(run, result=result, problem=problem, facts=checked, passes=passes)


def apart(one: FitResult, other: FitResult) -> float:
    """Largest distance between two routes over the channels that both constrain, m."""
    common = np.intersect1d(one.channel[one.constrained], other.channel[other.constrained])
    if not len(common):
        return float("nan")
    first, second = (r.route[np.searchsorted(r.channel, common)] for r in (one, other))
    return float(np.linalg.norm(first - second, axis=1).max())


def first_rung(run: Run, folder: Path) -> Rung:
    """The rung that a located fiber is by itself."""
    facts = run.facts
    return Rung(
        tuple(facts["effects"]),
        run.result.chi2_per_dof,
        facts["held_out_chi2_per_dof"],
        facts["noise_floor"],
        0.0,
        0.0,
        str(folder),
    )


def next_rung(before: Run, after: Run, first: Run, folder: Path) -> Rung:
    """The rung of a run that has grown."""
    facts = after.facts
    return Rung(
        tuple(facts["effects"]),
        after.result.chi2_per_dof,
        facts["held_out_chi2_per_dof"],
        facts["noise_floor"],
        apart(before.result, after.result),
        apart(first.result, after.result),
        str(folder),
    )


def climbed(rungs: Sequence[Rung], step: Grown, rung: Rung) -> list[Rung]:
    """A ladder with the rung that a step led to; below it the held-out misfit it was compared by."""
    below = rungs[-1] if step.held_out[0] is None else replace(rungs[-1], held_out_chi2_per_dof=step.held_out[0])
    return [*rungs[:-1], below, rung]
