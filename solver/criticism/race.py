"""Full fits with each candidate in the model, side by side: those that fall behind stop early."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import torch
from torch import Tensor

from solver.criticism.directions import Directions
from solver.criticism.policy import POLICY
from solver.criticism.refit import Refit, counted, loss, with_effect
from solver.criticism.score import Score
from solver.criticism.scorer import Scorer, score_all
from solver.criticism.slow_errors import slow_evidence
from solver.effect import Effect, Fitted, Start
from solver.fit.least_squares import Solution, solve
from solver.fit.map_fit import MapFit
from solver.fit.side_by_side import side_by_side
from solver.fit.state import State, Weights
from solver.fit.windowed import Windowed
from solver.signal_path.traffic import Vehicles

#: Steps of each round of the race, of the first one from far away, and rounds; of the first round each step is looked
#: at by itself.
PACE, FAR_PACE, ROUNDS = 2, 3, 12
#: What is raised where steps led to where the model has no numbers: who gets there stops, and the rest goes on.
UNSOLVED = (ValueError, np.linalg.LinAlgError, torch.linalg.LinAlgError)


@dataclass(frozen=True)
class Course:
    """What fits with each candidate in the model are judged by.

    Parameters
    ----------
    scorer : at the converged fit without them
    counts : how far each whitened residual [sample, channel] counts, in all of them alike
    before : misfit without them
    """

    scorer: Scorer
    counts: Tensor
    before: float

    @classmethod
    def of(cls, scorer: Scorer) -> "Course":
        """Of the candidates of a fit."""
        counts = counted(scorer.fit, scorer.at)
        return cls(scorer, counts, loss(scorer.fit, scorer.state, counts))

    @property
    def weights(self) -> Weights:
        """Of the samples."""
        return Weights((self.counts > 0).double(), self.counts**2)

    def run(self, fit: MapFit, start: State | Solution, pace: int) -> tuple[Solution, float] | None:
        """Where so many steps lead, and how far the misfit falls; None where that is nowhere."""
        try:
            end = solve(fit, start, iterations=pace)
        except UNSOLVED:
            return None
        return end, self.before - loss(fit, end.state, self.counts, end.at.models[0])


def started(fit: MapFit, scorer: Scorer, score: Score, weights: Weights) -> State:
    """The state without the candidate, moved with all that was fitted toward the score's estimate, if the misfit falls.

    Parameters
    ----------
    fit : with the candidate
    scorer : without it
    score : of the candidate
    weights : of the samples
    """
    state = scorer.state
    extension = fit.extension
    slots = [slot for slot in extension.slots if slot.effect is score.effect]
    base = extension.numbers({score.effect.name: score.shape})
    base[: len(state.numbers)] = state.numbers
    change = torch.zeros_like(base)
    estimate = torch.from_numpy(score.estimate)
    first = 0
    for slot in slots:
        if slot.parameter.is_shape:
            continue
        count = slot.where.stop - slot.where.start
        change[slot.where] = estimate[first : first + count]
        first += count
    change = torch.nan_to_num(change).clamp(-1e6, 1e6)
    moved = torch.zeros_like(scorer.fit.mean)
    moved[scorer.fit.free] = scorer.following(score)
    best, cost = replace(state, numbers=base), np.inf
    # What is told and not predicted may raise the misfit until all else has followed.
    for step in (1.0, 0.5, 0.2, 0.05) if score.fall > 0 else (1.0,):
        there = state.moved(state.vector() + step * moved)
        numbers = base + step * change
        numbers[: len(there.numbers)] = there.numbers
        trial = fit.bounded(replace(there, numbers=numbers))
        if not fit.buried(trial):
            continue
        trial, new = fit.settled_at(trial, weights)
        if new < cost:
            best, cost = trial, new
    return best


def unshifted(scorer: Scorer, effects: Sequence[Effect]) -> list[tuple[Scorer, Score]]:
    """What effects common to all passes would explain if no track were shifted; empty unless tracks were.

    An effect that delays the record looks like a shift of all vehicles; once they are shifted it no longer shows.
    All else about the vehicles is as it was before the fit, too.
    """
    few = [one for one in effects if not one.generic and all(p.scope == "one" for p in one.amplitudes)]
    along = scorer.state.vehicles.along
    if along.square().mean().sqrt() < POLICY.shifted * scorer.fit.problem.prior.along:
        return []
    fit, state = scorer.fit, scorer.state
    # Vehicles half a wavelength off would get no amplitude at all, so they keep that of the fit.
    fresh = replace(Vehicles.of(fit.problem.passes), amplitude=state.vehicles.amplitude)
    start = replace(fit.start_at(state.coefficients, state.poisson_ratio), vehicles=fresh)
    alone = Scorer(fit, start, alone=True, variance=scorer.variance)
    found = score_all(alone, few)
    most = max((one.evidence for one in found), default=0.0)
    return [(alone, score) for score in found if score.evidence > POLICY.late * most]


def elsewhere(scorer: Scorer, effects: Sequence[Effect]) -> list[tuple[Scorer, Score]]:
    """Candidates that start elsewhere than the fit: where they say themselves, or with unshifted tracks."""
    return started_elsewhere(scorer, effects) + unshifted(scorer, effects)


def started_elsewhere(scorer: Scorer, effects: Sequence[Effect]) -> list[tuple[Scorer, Score]]:
    """Candidates, with scores, at each place where they say that a fit with them may start; see `Effect.starts`."""
    problem, state = scorer.fit.problem, scorer.state
    classes = tuple(one.vehicle_class for one in problem.passes)
    route = scorer.fit.basis.along(state.coefficients.numpy(), problem.distance)
    known = Fitted(problem.distance, classes, np.abs(state.vehicles.amplitude.numpy()), route, problem.coil)
    return [begun_at(scorer, one, start) for one in effects if one.starts is not None for start in one.starts(known)]


def begun_at(scorer: Scorer, effect: Effect, start: Start) -> tuple[Scorer, Score]:
    """A candidate at one of its starts, where all that was fitted is as the start says, and a score in form only."""
    fit, state = scorer.fit, scorer.state
    problem = fit.problem
    nu = torch.tensor(problem.prior.poisson_ratio[0]).double()
    if start.route is None:
        begun = replace(fit.start_at(state.coefficients, nu, state.numbers), vehicles=state.vehicles)
    else:
        distance = problem.distance_of(problem.route_channel)
        begun = fit.start_at(torch.from_numpy(fit.basis.interpolate(distance, start.route(distance))), nu)
    counts, numbers = tuple(len(one) for one in start.numbers), np.concatenate(start.numbers)
    # Nothing is predicted.
    at = Scorer(fit, begun, alone=True, variance=scorer.variance)
    signal, sigma = Windowed((), len(at.residual), 1), np.ones(len(numbers))
    nothing = torch.zeros(at.fitted, dtype=torch.float64)
    spectrum = at.spectrum(effect, dict(start.shape))
    spectrum = replace(spectrum, along=0 * spectrum.along)
    told = counts, numbers, sigma, 1.0, signal, nothing, spectrum, at.variance
    return at, Score(effect, dict(start.shape), False, 0.0, len(numbers), 1, *told)


def race(
    scorer: Scorer,
    scores: Sequence[Score],
    advance: Callable[[int], None] = lambda n: None,
    others: Sequence[tuple[Scorer, Score]] = (),
    lead: float = 0.0,
) -> dict[str, Refit]:
    """Fit everything again with each candidate in the model; those that fall behind stop early.

    The score test says how the misfit falls at first; where an effect is large, or the route has absorbed it, only full
    fits tell. A candidate that can no longer come near the leader stops; the favorite of the score test, which with
    many numbers starts slowly, runs to the end. Known effects of one number that end near the leader are fitted once
    more from farther off: where the ground's and the route's numbers have absorbed a part, a fit may end short of it.

    Parameters
    ----------
    scorer : at the converged fit without the candidates
    scores : of the candidates
    advance : called with 1 after the first steps from each start
    others : candidates that start elsewhere too, see `elsewhere`
    lead : evidence of a fit that is known already, which they must come near, the favorite of the score test, too
    """
    course = Course.of(scorer)
    weights, run = course.weights, course.run
    starts = [*((scorer, one) for one in scores), *others]
    with_it = {one.effect.name: one.effect for _, one in starts}
    fits = {name: MapFit(with_effect(scorer.fit.problem, effect)) for name, effect in with_it.items()}

    def begin(start: tuple[Scorer, Score]) -> tuple[Solution, float] | None:
        at, score = start
        fit = fits[score.effect.name]
        return run(fit, started(fit, at, score, weights), 0 if at is scorer else FAR_PACE)

    begun = [(*start, end) for start, end in zip(starts, side_by_side(begin, starts, advance), strict=True) if end]
    running = [Refit(score, fits[score.effect.name], *end, scorer.sharpness) for _, score, end in begun]
    near = [at is scorer for at, _, _ in begun]
    # Falls of each fit in its last two rounds, as one may go on damping alone; not known at first.
    gained = [(np.inf, np.inf)] * len(running)
    for pace, left in [(1, ROUNDS)] * PACE + [(PACE, left) for left in range(ROUNDS - 1, 0, -1)]:
        running = leaders_told(scorer, running)
        most = max((lead, *(one.evidence for one in running)))
        unended = [n for n, one in enumerate(running) if not one.solution.converged and (near[n] or pace == PACE)]
        favorite = 0 if lead == 0 else None
        going = [n for n in unended if n == favorite or goes_on(running[n], most, left * max(gained[n]), pace < PACE)]
        led = side_by_side(partial(onward, course, pace), [running[n] for n in going])
        for n, (end, fall) in zip(going, led, strict=True):
            if pace == PACE:
                gained[n] = gained[n][1], fall - running[n].fall
            running[n] = running[n].at(end, fall)
    least = POLICY.stay * max((one.evidence for one in running), default=0.0)
    again = [one for one in running if one.single and one.evidence > max(least, POLICY.found)]
    ends = side_by_side(lambda one: run(one.fit, one.farther(weights), PACE * ROUNDS), again)
    running += [one.at(*end) for one, end in zip(again, ends, strict=True) if end]
    best: dict[str, Refit] = {}
    for one in running:
        name = one.effect.name
        if name not in best or one.fall > best[name].fall:
            best[name] = one
    return best


def goes_on(one: Refit, most: float, more: float, early: bool) -> bool:
    """Whether a fit goes on that may come near the leader, whose evidence is `most`; `more` is as of `may_reach`.

    Early on a start that is worse than nothing tells nothing yet, and where evidence is small odds that count are near.
    """
    least = POLICY.stay * most
    return (early and one.fall < 0) or one.may_reach(min(least, most - POLICY.far) if early else least, more)


def onward(course: Course, pace: int, one: Refit) -> tuple[Solution, float]:
    """Where so many steps lead from where a fit is, and how far its misfit falls; where that is nowhere it ends."""
    return course.run(one.fit, one.solution, pace) or (replace(one.solution, converged=True), one.fall)


def leaders_told(scorer: Scorer, running: Sequence[Refit]) -> list[Refit]:
    """Fits on their way, the best one told from slow errors of the tracks where it has ended.

    Wandering tracks explain much that such errors explain as well: what they lead by is no reason for others to stop.
    """
    running = list(running)
    while not all(one.solution.converged for one in running):
        first = max(range(len(running)), key=lambda n: running[n].evidence)
        if running[first].slow is not None or not running[first].solution.converged:
            break
        running[first] = told_from_slow_errors(scorer, running[first])
    return running


def with_slow_errors(scorer: Scorer, tried: Mapping[str, Refit]) -> dict[str, Refit]:
    """Full fits that are told from slow errors of the tracks: what these explain as well is no evidence of an effect.

    Those that cannot come near the best are as they are.
    """
    best, found = 0.0, dict[str, Refit]()
    for one in sorted(tried.values(), key=lambda one: -one.evidence):
        if one.evidence > best - POLICY.far:
            one = told_from_slow_errors(scorer, one)
        found[one.effect.name] = one
        best = max(best, one.evidence)
    return found


def told_from_slow_errors(scorer: Scorer, one: Refit, there: Directions | None = None) -> Refit:
    """A full fit, as of `with_slow_errors`; `there` is what was fitted, where it ended, if it is made already."""
    if one.slow is not None:
        return one
    there = there or Directions(one.fit, one.solution.state, variance=scorer.variance)
    before, after = (slow_evidence(at, scorer.variance) for at in (scorer, there))
    return replace(one, slow=min(after - before, 0.0))
