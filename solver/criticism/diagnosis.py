"""Diagnosis: which physical effect the model lacks, if any, or that something unknown acts, and at which stage.

The gates, in order: the noise is understood, the fit has converged, the score test ranks the catalogue and the
discrepancy models, the best few are fitted in full, a posterior weighs all explanations, passes held out confirm.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from solver.cable.fiber import SplineBasis
from solver.criticism.audit import NoiseAudit, audit_of
from solver.criticism.bench import Advance, Asked, Bench, Tell, racers, scorable
from solver.criticism.beside import Beside, akin, shown
from solver.criticism.candidate import Candidate, fault_candidate, idle_candidate, score_candidate
from solver.criticism.corridor import Corridor
from solver.criticism.explaining import Explainer
from solver.criticism.explanations import Posterior, Weighed
from solver.criticism.finding import LISTED, Diagnosis, concluded
from solver.criticism.from_far import from_far
from solver.criticism.judging import Weighing, judge, order
from solver.criticism.plain_verdict import spoken
from solver.criticism.policy import POLICY
from solver.criticism.race import elsewhere, race, with_slow_errors
from solver.criticism.refit import Refit
from solver.criticism.repairs import mended
from solver.criticism.route_change import route_of, with_moves
from solver.criticism.verdict_words import TURN, fault_words
from solver.effect import Effect, Recorded
from solver.fit.chain import Chain
from solver.fit.least_squares import solve
from solver.fit.map_fit import MapFit
from solver.fit.posterior import Posterior as FitPosterior
from solver.fit.problem import Problem
from solver.fit.refinement import on_knots, with_bends
from solver.fit.side_by_side import side_by_side
from solver.fit.state import State
from solver.fit.track_trust import strict_tracks, track_spread
from solver.noise.quiet_windows import quiet
from solver.run.route_fits import most_left, noise_level_of
from solver.run.run_corridor import BENDS


def converged(problem: Problem, state: State | None) -> tuple[MapFit, State]:
    """Fit a survey, from a state if there is one."""
    fit = MapFit(problem)
    return fit, solve(fit, fit.start() if state is None else state).state


def steps(effects: Sequence[Effect]) -> int:
    """How often a diagnosis advances at most where no fault is mended: two tables, four races, one from two places."""
    known = POLICY.racers - POLICY.unknown_racers
    many = sum(one.varies and not one.generic for one in effects)
    return 2 * len(effects) + 2 * POLICY.racers + known + 2 * POLICY.besides * known + 2 * many


def diagnose(
    problem: Problem,
    state: State | None = None,
    *,
    effects: Sequence[Effect],
    held_out: bool = True,
    advance: Advance = lambda n: None,
    tell: Tell = lambda ranking, listed: None,
) -> Diagnosis:
    """Say what a survey's model lacks.

    Parameters
    ----------
    problem : the survey, with the effects that are in its model
    state : where its fit ended; it is fitted again where None
    effects : the catalogue
    held_out : confirm the winner on passes that its fit has not seen
    advance : called with 1 after each effect scored and each candidate begun to be fitted, some `steps` times
    tell : called with "score test" or "full fits" and candidates as soon as they are ranked so

    Returns
    -------
    diagnosis
    """
    fit, state = converged(strict_tracks(problem), state)
    problem = strict_tracks(problem, track_spread(problem.passes, state.vehicles.along.numpy()))
    fit, state = converged(problem, state)
    check = audit_of(fit, state)
    if check.signal_noise > 0:
        problem = replace(problem, signal_noise=check.signal_noise)
        fit, state = converged(problem, state)
    if not check.passed:
        found = unranked(Bench.of(fit, state, check, effects, advance))
    else:
        asked = Asked(effects, held_out, advance, lambda how, listed: tell(how, spoken(listed, problem, effects)))
        found = examined(fit, state, check, asked)
    return replace(found, candidates=spoken(found.candidates, problem, effects))


def examined(fit: MapFit, state: State, check: NoiseAudit, asked: Asked, bent: bool = False) -> Diagnosis:
    """Rank what a converged fit may lack, race the best, and weigh the explanations.

    Where the best of them asks for knots that the route lacks, all are tried on those: what a route can explain is no
    effect, and corners that it cannot follow hide one. `bent` says that the route has such knots already.
    """
    bench = Bench.of(fit, state, check, asked.effects, asked.advance)
    variance = bench.scorer.variance
    faults = [fault_candidate(fault, variance) for fault in bench.faults]
    asked.tell("score test", by_evidence([score_candidate(s, None) for s in bench.table] + faults))
    fault = max(faults, key=lambda c: c.evidence, default=None)
    # Full fits of effects would not come near it.
    if fault is not None and fault.verdict == "present" and fault.evidence > POLICY.hope * bench.table[0].evidence:
        return beside_fault(bench, fault.effect, asked)
    first = racers(bench.table)
    shows = any(s.evidence > POLICY.found for s in first)
    late = elsewhere(bench.scorer, scorable(fit.problem, asked.effects))[: POLICY.racers] if shows else []
    tried = race(bench.scorer, first, asked.advance, late)
    tried |= stood_for(bench, tried, asked)
    tried |= from_far(bench.scorer, tried)
    tried = with_slow_errors(bench.scorer, tried)
    if not bent and (knots := knots_beside(tried)) is not None:
        return on_knots_of(bench, knots, asked)
    ranked = side_by_side(lambda s: score_candidate(s, tried.get(s.effect.name)), bench.table) + faults
    ranked = by_evidence(ranked)
    if tried:
        asked.tell("full fits", ranked)
    ranked = with_moves(bench, ranked, tried) + [idle_candidate(one) for one in bench.idle]
    if bench.scorer.stress > POLICY.converged and ranked[0].evidence < POLICY.found:
        words = f"the fit has not converged ({bench.scorer.stress:.1f} sigmas are left along what it fits)"
        return concluded(bench, "inconclusive", words, ranked)
    weighing = weighed(bench, tried, asked)
    if weighing.posterior.weighed[0].kind == "fault":
        return beside_fault(bench, weighing.posterior.weighed[0].effects[0], asked)
    found = judge(bench, ranked, tried, asked, weighing)
    corridor = Corridor.of(bench, tried, weighing.posterior)
    corridor = corridor.with_disagreement(bench, tried, weighing.posterior)
    fits = {n: (one.fit, one.solution.state) for n, one in tried.items()}
    listed = {c.effect for c in found.candidates[:LISTED]} - set(fits)
    predicted = {s.effect.name: bench.scorer.changed(s).numpy() for s in bench.table if s.effect.name in listed}
    return replace(found, corridor=corridor, fits=fits, predicted=predicted)


def knots_beside(tried: Mapping[str, Refit]) -> SplineBasis | None:
    """The knots that the best of some effects asks for once it is in the model; None where they would decide nothing.

    What lowers the misfit by less changes no odds from which on effects are looked beside of.
    """
    best = max(tried.values(), key=lambda one: one.evidence, default=None)
    if best is None or best.evidence < POLICY.found or not best.solution.converged:
        return None
    chain, at = Chain.of(best.fit.problem), best.solution.at
    left = FitPosterior(chain, at).chi2_per_dof
    freedom = at.misfit / left
    level, scatter = noise_level_of(best.fit.problem, freedom)
    most = most_left(np.array([at.misfit]), np.ones(1), level * freedom, scatter * freedom)
    found = with_bends(chain, at.state, left, freedom, most)
    if found is None or found[1].at.misfit > min(most[0], at.misfit - 2 * POLICY.far * best.score.variance):
        return None
    return found[0].basis


def on_knots_of(bench: Bench, basis: SplineBasis, asked: Asked) -> Diagnosis:
    """The verdict once the route has more knots."""
    fit, state = bench.scorer.fit, bench.scorer.state
    problem, begun = on_knots(fit.problem, state, basis)
    bent = MapFit(problem)
    end = solve(bent, begun).state
    found = examined(bent, end, bench.audit, asked, bent=True)
    if found.corridor is None:
        return found
    at = found.corridor.channel
    move = route_of(bent, end, at) - route_of(fit, state, at)
    found = replace(found, corridor=found.corridor.with_move(BENDS, move))
    if found.verdict != "adequate":
        return found
    where = int(at[np.linalg.norm(move, axis=1).argmax()])
    bend = f"the fiber bends more sharply near channel {where} than the route follows"
    return replace(found, bend=bend, words=f"{bend}; let it turn there ({TURN}). Besides, {found.words}")


def by_evidence(listed: Sequence[Candidate]) -> list[Candidate]:
    """Candidates, best evidence first."""
    return sorted(listed, key=lambda c: -c.evidence)


def weighed(bench: Bench, tried: Mapping[str, Refit], asked: Asked) -> Weighing:
    """The posterior over explanations, with pairs of known effects where the unknown is not ruled out."""
    explainer = Explainer(bench, tried, asked.effects)
    besides = looked_beside(bench, tried, asked)
    posterior = Posterior.of(explainer.all(besides))
    if posterior.of_kind("unknown") > 1 - POLICY.held:
        # Of rivals one must not have the better of the other only because more was fitted beside it.
        near = max((one.both for one in besides.values()), default=0.0) - POLICY.far
        besides = {name: one.widened(asked) if one.both > near else one for name, one in besides.items()}
        posterior = Posterior.of(explainer.all(besides))
    return Weighing(posterior, besides)


def looked_beside(bench: Bench, tried: Mapping[str, Refit], asked: Asked) -> dict[str, Beside]:
    """What shows beside the best known effects, as long as that could bring them to the best, by effect."""
    ranked = sorted((one for one in tried.values() if not one.effect.generic), key=lambda one: -one.evidence)
    variance = bench.scorer.variance
    best = max((one.evidence for one in tried.values()), default=0.0)
    fall = max((one.fall for one in tried.values()), default=0.0)
    besides: dict[str, Beside] = {}
    for one in ranked[: POLICY.besides]:
        hope = Beside.hope(one, fall, variance)
        if one.evidence + hope < POLICY.found or one.evidence + hope < best - POLICY.far:
            continue
        beside = Beside.of(bench, one, asked)
        besides[one.effect.name] = beside
        best = max(best, beside.refit.evidence + beside.tolerated)
        fall = max(fall, one.fall + max((s.fall for s in beside.table), default=0.0))
    return besides


def stood_for(bench: Bench, tried: Mapping[str, Refit], asked: Asked) -> dict[str, Refit]:
    """Full fits of known effects that the winner may stand for, which showed too little to be fitted before.

    The score test tells little of what is strong and was absorbed by everything else, as axles over 14 m are. For a
    discrepancy model they must show and be akin. For a known effect they are those of its families, which surveys often
    cannot tell from it, and have to come near it.
    """
    best = max(tried.values(), key=lambda one: one.evidence, default=None)
    if best is None or best.evidence < POLICY.found:
        return {}
    known = [s for s in bench.table if not s.effect.generic and s.effect.name not in tried]
    if best.effect.generic:
        others, lead = [s for s in shown(known) if akin(s.effect, best.effect)], 0.0
    else:
        families = set(best.effect.families)
        others, lead = [s for s in known if not families.isdisjoint(s.effect.families)], best.evidence
    return race(bench.scorer, others[: POLICY.racers - POLICY.unknown_racers], asked.advance, lead=lead)


def unranked(bench: Bench) -> Diagnosis:
    """The verdict where the noise is not understood, which a filter that it went through may explain."""
    words = "the noise is not understood, so that no effect can be ranked: " + "; ".join(bench.audit.faults)
    listed = [replace(score_candidate(s, None), verdict="inconclusive") for s in bench.table]
    listed += map(idle_candidate, bench.idle)
    survey = bench.scorer.fit.problem
    still = quiet(len(survey.record), survey.start, survey.passes, survey.gauge_length)
    recorded = Recorded(survey.record / survey.noise.numpy(), still, survey.sampling_rate, survey.channel_spacing)
    for candidate in listed:
        trace = bench.effect(candidate).trace
        if trace is not None and (shown := trace(recorded)) is not None:
            words = (
                f"{candidate.effect} is missing at the {candidate.stage} stage: {shown}; better diagnose the record as "
                "it was before it"
            )
            return concluded(bench, "missing-effect", words, order(listed, replace(candidate, verdict="present")))
    return concluded(bench, "inconclusive", words, listed)


def beside_fault(bench: Bench, name: str, asked: Asked) -> Diagnosis:
    """The verdict where a fault of the survey explains the most: it is mended, and what is left weighed by itself."""
    fault = next(fault for fault in bench.faults if fault.name == name)
    first = fault_candidate(fault, bench.scorer.variance)
    fit, solution = mended(bench.scorer.fit, bench.scorer.state, fault)
    rest = examined(fit, solution.state, bench.audit, asked)
    words = f"{fault_words(first, fault)}. Once it is mended, {rest.words}"
    if rest.corridor is not None:
        at = rest.corridor.channel
        move = route_of(fit, solution.state, at) - route_of(bench.scorer.fit, bench.scorer.state, at)
        rest = replace(rest, corridor=rest.corridor.with_move(name, move))
    explanations = tuple(with_fault(one, first.effect, first.stage) for one in rest.explanations)
    first = replace(first, probability=sum(one.probability for one in explanations if one.kind != "unknown"))
    if rest.verdict == "unknown-effect":
        candidates = (rest.candidates[0], *order(rest.candidates[1:], first))
        return replace(rest, words=words, candidates=candidates, explanations=explanations)
    left = rest.candidates[0].evidence if rest.verdict == "missing-effect" else 0.0
    candidates, fits = order(rest.candidates, first), {first.effect: (fit, solution.state)}
    return replace(
        rest,
        verdict="missing-effect",
        words=words,
        candidates=candidates,
        left=left,
        fits=fits,
        explanations=explanations,
    )


def with_fault(one: Weighed, fault: str, stage: str) -> Weighed:
    """An explanation of what is left once a fault is mended, as one of the whole."""
    if one.kind in ("unknown", "overlooked"):
        return one
    kind = "fault" if one.kind == "nothing" else "two"
    return Weighed(kind, (fault, *one.effects), stage, one.probability)
