"""A model that grows: add an effect to a run, rung by rung, and see whether passes held out agree."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch

from solver.catalogue.catalogue import find
from solver.criticism.race import elsewhere, race
from solver.criticism.refit import Refit
from solver.criticism.repairs import SEARCHES, TAKEN_OUT, mended
from solver.criticism.scorer import Scorer
from solver.effect import Effect
from solver.fit.chain import Chain
from solver.fit.held_out import HeldOut, held_out
from solver.fit.held_out_gain import HeldOutGain, held_out_gain
from solver.fit.least_squares import Solution, solve
from solver.fit.map_fit import MapFit
from solver.fit.posterior import assemble
from solver.fit.problem import Problem
from solver.fit.result import FitResult
from solver.fit.sides import reopened
from solver.fit.state import State
from solver.fit.track_trust import strict_tracks, track_spread
from solver.run.code import with_plugins
from solver.run.facts import fitted_facts
from solver.run.ladder import climbed
from solver.run.report.report_words import told
from solver.run.route_fits import fit_bends
from solver.run.run import Run
from solver.run.strict_json import strict
from vision.contract import InputError

#: Fall of chi2 that is chance.
CHANCE = 4.0


@dataclass(frozen=True)
class Grown:
    """A run's fit with more in its model.

    Parameters
    ----------
    fit, solution : with it
    before : misfit of held-out passes per degree of freedom without it; None where it cannot be compared
    after : misfit of held-out passes with it
    gain : fall of that misfit over the folds that show what was added, where all together are no better
    """

    fit: MapFit
    solution: Solution
    before: float | None
    after: HeldOut | None
    gain: HeldOutGain | None = None

    @property
    def better(self) -> bool:
        """Whether passes held out agree that it is better, by more than an effect that does nothing gains by chance.

        Of what few passes show, as only the heaviest vehicle clips, no more is asked than that they do not object.
        """
        if self.before is None or self.after is None:
            return True
        if self.gain is not None:
            return not self.gain.refuses(self.after.chi2_per_dof)
        return self.after.chi2_per_dof < self.before - CHANCE / float(self.fit.measured.sum())

    @property
    def held_out_words(self) -> str:
        """Held-out misfit per degree of freedom before and after."""
        misfits = self.before, None if self.after is None else self.after.chi2_per_dof
        before, after = ("unknown" if one is None else f"{one:.3f}" for one in misfits)
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


def held_out_before(
    run: Run, fit: MapFit, state: State, advance: Callable[[int], None] = lambda n: None
) -> float | None:
    """Misfit of passes held out of a run's fit, which the run tells unless it was tested on passes of its own."""
    if run.facts.get("choice") is None:
        told: float | None = run.facts["held_out_chi2_per_dof"]
        return told
    found = held_out(fit.problem, advance, at=(fit, state))
    return None if found is None else found.chi2_per_dof


def grow(
    fit: MapFit,
    state: State,
    name: str,
    catalogue: Mapping[str, Effect],
    before: float | None,
    advance: Callable[[int], None] = lambda n: None,
) -> Grown:
    """Add one effect, or mend one fault, and fit everything again.

    Parameters
    ----------
    fit, state : converged, without it
    name : of the effect or fault
    catalogue : effects by name
    before : misfit of held-out passes without it, see `held_out_before`

    Raises
    ------
    InputError
        If there is no such effect, it is in the model already, or it does nothing in this survey.
    """

    def unseen(fit: MapFit, end: Solution) -> HeldOut | None:
        return held_out(fit.problem, advance, at=(fit, end.state))

    check_names([name], fit.problem, catalogue)
    if name in SEARCHES:
        fault = SEARCHES[name](fit, state)
        if fault is None:
            raise InputError(f"{name}: nothing of the kind is in this survey's residual")
        new, end = mended(fit, state, fault)
        if name in TAKEN_OUT:
            # Samples are taken out and no model changes: there is nothing that held-out passes could compare.
            return Grown(new, end, None, unseen(new, end))
        return Grown(new, end, before, unseen(new, end))
    # Tracks that may be off by anything would take up what shifts them all.
    trusted = MapFit(strict_tracks(fit.problem, track_spread(fit.problem.passes, state.vehicles.along.numpy())))
    refit = fitted_with(trusted, solve(trusted, state).state, catalogue[name], advance)
    new = MapFit(replace(refit.fit.problem, prior=fit.problem.prior))
    end = solve(new, refit.solution.state)
    grown = Grown(new, end, before, unseen(new, end))
    return grown if grown.better else replace(grown, gain=held_out_gain((fit, state), (new, end.state)))


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
    end = solve(result.fit, result.solution.state)
    return replace(result, solution=end)


def with_growth(run: Run, grown: Grown, effects: Sequence[str], seconds: float) -> Run:
    """The run as it is with more in its model, one rung up its ladder."""
    grown_run = regrown(run, grown, effects, seconds)
    return replace(with_plugins(grown_run), rungs=climbed(run, grown_run))


def regrown(run: Run, grown: Grown, effects: Sequence[str], seconds: float) -> Run:
    """The run as it is with more in its model, `effects` those of its model by name; with knots as `locate` adds."""
    result, problem, unseen = grown.result(seconds), grown.fit.problem, grown.after
    result = replace(result, ambiguous_side=reopened(run.result.ambiguous_side, result, problem))
    finer, fine = fit_bends(result, problem, "spline")
    if fine is not problem:
        result, problem, chain = finer, fine, Chain.of(fine)
        unseen = held_out(fine, at=(chain, chain.state_of(torch.from_numpy(result.vector))))
    problem = replace(problem, start=result.route[np.isin(result.channel, problem.channel)])
    facts = run.facts | {"effects": list(effects)}
    facts |= fitted_facts(result, problem, unseen, run.facts["disputed_anchors"])
    known = {one.track_id for one in run.passes}
    passes = run.passes + [one for one in problem.passes if one.track_id not in known]
    time = problem.time_of(result.samples)
    grown_run = replace(run, result=result, problem=problem, time=time, facts=strict(facts), passes=passes)
    return told(replace(grown_run, added=None, folder=None))
