"""Diagnosis: which physical effect the model lacks, if any, or that something unknown acts, and at which stage.

The gates, in order: the noise is understood, the fit has converged, the score test ranks the catalogue and the generic
families, the best few are fitted in full and race each other, passes held out confirm.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from solver.catalogue.catalogue import family
from solver.criticism.audit import NoiseAudit, audit
from solver.criticism.bench import RACERS, STANDING_IN, Advance, Asked, Bench, racers, scorable
from solver.criticism.beside import BESIDE, CLOSE, FEW, MANY, Beside, akin, both_known, of_family, outdone
from solver.criticism.candidate import Candidate, fault_candidate, idle_candidate, score_candidate
from solver.criticism.placing import stage_of
from solver.criticism.plain_verdict import spoken
from solver.criticism.race import elsewhere, race
from solver.criticism.refit import HOPE, Refit, as_located
from solver.criticism.repairs import mended
from solver.criticism.route_change import with_moves
from solver.criticism.score import FOUND, Score
from solver.criticism.scorer import Scorer, similarity
from solver.criticism.side_by_side import side_by_side
from solver.criticism.verdict_words import (
    MORE,
    advice,
    as_well_words,
    fault_words,
    impossible_words,
    leveled_words,
    like,
    missing_words,
    power_words,
    unknown_words,
    untrusted_words,
)
from solver.effect import Effect, Recorded
from solver.fit.held_out import held_out as held_out_misfit
from solver.fit.least_squares import solve
from solver.fit.map_fit import MapFit
from solver.fit.problem import Problem
from solver.fit.state import State
from solver.fit.track_trust import strict_tracks, track_spread
from solver.noise.quiet_windows import quiet

#: Correlation of two effects' signals at which they are not told apart.
ALIKE = 0.95
#: Share of the winner's evidence at which one of its own family is not ruled out.
RIVAL = 0.65
#: Evidence from which on an effect is named although the noise is weaker where vehicles are loud, or a discrepancy
#: model of another kind explains as much.
PLAIN = 10 * FOUND
#: Share of the evidence of a discrepancy model of another kind, with as few numbers, that a plain effect must reach to
#: be named: its law may be off by that much.
REACHED = 0.99
#: Families of which the route hides each.
NEVER_ALONE = ("depth", "rigid")
#: Residual along fitted directions at which a fit counts as converged, sigmas.
CONVERGED = 0.5


@dataclass(frozen=True)
class Diagnosis:
    """What a survey says of its model.

    Parameters
    ----------
    verdict : adequate, missing-effect, unknown-effect or inconclusive
    words : the same in a sentence or two
    candidates : best first
    audit : of the noise
    stress : residual along what was fitted, sigmas
    separate : what survey would tell the confounded apart; "" where nothing is confounded
    left : ln of the Bayes factor of the best effect beside the first candidate
    fits : where the fit with each candidate ended that was fitted in full, by its name
    """

    verdict: str
    words: str
    candidates: tuple[Candidate, ...]
    audit: NoiseAudit
    stress: float
    separate: str = ""
    left: float = 0.0
    fits: Mapping[str, tuple[MapFit, State]] = field(default_factory=dict, repr=False, compare=False)


def concluded(bench: Bench, verdict: str, words: str, candidates: Sequence[Candidate], **more: Any) -> Diagnosis:
    """A verdict on a fit."""
    return Diagnosis(verdict, words, tuple(candidates), bench.audit, bench.scorer.stress, **more)


def converged(problem: Problem, state: State | None) -> tuple[MapFit, State]:
    """Fit a survey, from a state if there is one."""
    fit = MapFit(problem)
    return fit, solve(fit, fit.start() if state is None else state, iterations=60).state


def steps(effects: Sequence[Effect]) -> int:
    """How often a diagnosis advances at most where no fault is mended: two tables, four races, one from two places."""
    return 2 * len(effects) + 2 * RACERS + (RACERS - STANDING_IN) + 2 * BESIDE


def diagnose(
    problem: Problem,
    state: State | None = None,
    *,
    effects: Sequence[Effect],
    held_out: bool = True,
    advance: Advance = lambda n: None,
) -> Diagnosis:
    """Say what a survey's model lacks.

    Parameters
    ----------
    problem : the survey, with the effects that are in its model
    state : where its fit ended; it is fitted again where None
    effects : the catalogue
    held_out : confirm the winner on passes that its fit has not seen
    advance : called with 1 after each effect scored and each candidate begun to be fitted, some `steps` times

    Returns
    -------
    diagnosis
    """
    fit, state = converged(strict_tracks(problem), state)
    problem = strict_tracks(problem, track_spread(problem.passes, state.vehicles.along.numpy()))
    fit, state = converged(problem, state)
    at = fit.linearized(state)
    noise = fit.problem.noise
    check = audit(problem, fit.residual(state).numpy(), (at.model / noise).numpy())
    if check.signal_noise > 0:
        problem = replace(problem, signal_noise=check.signal_noise)
        fit, state = converged(problem, state)
    if not check.passed:
        found = unranked(Bench.of(fit, state, check, effects, advance))
    else:
        found = examined(fit, state, check, Asked(effects, held_out, advance))
    return replace(found, candidates=spoken(found.candidates, problem, effects))


def examined(fit: MapFit, state: State, check: NoiseAudit, asked: Asked) -> Diagnosis:
    """Rank what a converged fit may lack, race the best, and judge."""
    bench = Bench.of(fit, state, check, asked.effects, asked.advance)
    fault = max(map(fault_candidate, bench.faults), key=lambda c: c.evidence, default=None)
    # Full fits of effects would not come near it.
    if fault is not None and fault.verdict == "present" and fault.evidence > HOPE * bench.table[0].evidence:
        return beside_fault(bench, fault, asked)
    first = racers(bench.table)
    late = elsewhere(bench.scorer, scorable(fit.problem, asked.effects))[:RACERS] if first else []
    tried = race(bench.scorer, first, asked.advance, late)
    tried |= race(bench.scorer, overlooked(bench, tried), asked.advance)
    ranked = [score_candidate(s, tried.get(s.effect.name)) for s in bench.table]
    ranked += [fault_candidate(fault) for fault in bench.faults]
    ranked.sort(key=lambda c: -c.evidence)
    ranked = with_moves(bench, ranked, tried) + [idle_candidate(one) for one in bench.idle]
    if bench.scorer.stress > CONVERGED and ranked[0].evidence < FOUND:
        words = f"the fit has not converged ({bench.scorer.stress:.1f} sigmas are left along what it fits)"
        return concluded(bench, "inconclusive", words, ranked)
    found = judge(bench, ranked, tried, asked)
    return replace(found, fits={n: (one.fit, one.solution.state) for n, one in tried.items()} | dict(found.fits))


def overlooked(bench: Bench, tried: Mapping[str, Refit]) -> list[Score]:
    """Known effects that the winning discrepancy model may stand for, which showed too little to be fitted in full.

    The score test tells little of what is strong and was absorbed by everything else, as axles over 14 m are.
    """
    best = max(tried.values(), key=lambda one: one.evidence, default=None)
    if best is None or not best.effect.generic:
        return []
    known = [s for s in bench.table if not s.effect.generic and s.effect.name not in tried and s.evidence > FOUND]
    return [s for s in known if akin(score_candidate(s, None), best.effect)][: RACERS - STANDING_IN]


def unranked(bench: Bench) -> Diagnosis:
    """The verdict where the noise is not understood, which a filter that it went through may explain."""
    words = "the noise is not understood, so that no effect can be ranked: " + "; ".join(bench.audit.faults)
    listed = [replace(score_candidate(s, None), verdict="inconclusive") for s in bench.table]
    listed += map(idle_candidate, bench.idle)
    survey = bench.scorer.fit.problem
    still = quiet(len(survey.record), survey.start, survey.passes)
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


def judge(bench: Bench, listed: Sequence[Candidate], tried: Mapping[str, Refit], asked: Asked) -> Diagnosis:
    """The verdict on a ranked list."""
    present = [c for c in listed if c.verdict == "present" and (c.refitted or bench.is_fault(c))]
    physical = [c for c in present if not c.generic]
    generic = [c for c in present if c.generic]
    if bench.audit.leveled and all(c.evidence < PLAIN for c in present):
        level = next(c for c in listed if c.generic and levels(bench.effect(c)))
        words = leveled_words(bench.audit.loud)
        return concluded(bench, "unknown-effect", words, leading(listed, placed(level, bench)))
    if not present:
        words = f"nothing is missing that this survey could show. {power_words(listed)}"
        return concluded(bench, "adequate", words, listed)
    if not physical or (generic and outdone(physical[0].evidence, generic[0].evidence, generic[0].numbers)):
        if physical and (two := both_known(bench, physical[0], generic[0], tried, asked)):
            return confirmed(bench, physical[0], listed, tried, asked, two)
        first = placed(generic[0], bench)
        words = unknown_words(first, bench.effect(first).physics, physical)
        return concluded(bench, "unknown-effect", words, leading(listed, first))
    first = plainest(physical)
    if bench.is_fault(first):
        return beside_fault(bench, first, asked)
    if tried[first.effect].pushed:
        return impossible(bench, first, listed, tried)
    if (rival := unknown_as_well(first, generic, bench)) is not None:
        first = replace(first, verdict="inconclusive", confounded_with=tuple(hidden_with(first, asked.effects)))
        words = as_well_words(first, rival, bench.effect(rival).physics)
        separate = advice(first, asked.effects) or MORE
        return concluded(bench, "inconclusive", words, leading(listed, first), separate=separate)
    return confirmed(bench, first, listed, tried, asked)


def impossible(bench: Bench, first: Candidate, listed: Sequence[Candidate], tried: Mapping[str, Refit]) -> Diagnosis:
    """The verdict where the best known effect fits only at a size that cannot be: the best that can be is the clue."""
    excluded = replace(first, verdict="excluded")
    able = (c for c in listed if c.verdict == "present" and c.effect in tried and not tried[c.effect].pushed)
    clue = next(able, excluded)
    if clue is not excluded:
        clue = placed(clue, bench) if clue.generic else replace(clue, verdict="inconclusive")
    whole = [excluded if c.effect == first.effect else c for c in listed]
    return concluded(bench, "unknown-effect", impossible_words(first, clue.stage), leading(whole, clue))


def unknown_as_well(first: Candidate, generic: Sequence[Candidate], bench: Bench) -> Candidate | None:
    """A discrepancy model beside which a first candidate does not rule the unknown out.

    Beside a weak one that is one of its stage and family, looser than its law, that explains more; or one of another
    kind that explains as much. What a strong one leaves to a discrepancy model is its own law's error, unless one of
    another kind, as strict, explains more than that.
    """
    weak = first.evidence <= PLAIN

    def as_good(one: Candidate) -> bool:
        effect = bench.effect(one)
        if akin(first, effect):
            closest = effect.stage == first.stage and of_family(first, effect)
            return weak and closest and one.evidence > first.evidence
        if weak:
            return one.evidence > first.evidence - CLOSE
        return one.numbers <= FEW and REACHED * one.evidence > first.evidence

    return next(filter(as_good, generic), None)


def hidden_with(first: Candidate, effects: Sequence[Effect]) -> list[str]:
    """What the route hides, of some effects, together with a candidate, which is therefore never named alone."""
    kinds = [kind for kind in NEVER_ALONE if kind in first.families]
    return [name for kind in kinds for name in family(kind, effects) if name != first.effect]


def confirmed(
    bench: Bench,
    first: Candidate,
    listed: Sequence[Candidate],
    tried: Mapping[str, Refit],
    asked: Asked,
    beside: Beside | None = None,
) -> Diagnosis:
    """The verdict on a known effect that explains the most, by what it leaves and by passes held out."""
    winner = tried[first.effect]
    beside = beside or Beside.of(bench, first, winner, asked)
    again, left = beside.bench, beside.left
    if (best := beside.doubt(first)) is not None:
        discrepancy = placed(score_candidate(best.score, best), again)
        words = (
            f"{first.effect} explains the most of all known effects, but leaves too much: something unknown "
            f"acts at the {discrepancy.stage} stage, as if {like(best.effect.physics)} ({best.effect.name})"
        )
        return concluded(bench, "unknown-effect", words, leading(listed, discrepancy), left=left)
    first = replace(first, confounded_with=confounded(bench, first, listed, tried, asked.effects))
    gain = held_out_gain(bench.scorer, winner) if asked.held_out else None
    first, separate = replace(first, held_out_gain=gain), advice(first, asked.effects)
    if gain is not None and gain <= 0:
        named = leading(listed, replace(first, verdict="inconclusive"))
        return concluded(bench, "inconclusive", untrusted_words(first), named, separate=separate, left=left)
    faults = {fault.name: fault_candidate(fault) for fault in again.faults}
    whole = [faults.get(c.effect, c) for c in leading(listed, first)]
    words = missing_words(first, left)
    return concluded(bench, "missing-effect", words, whole, separate=separate, left=left)


def plainest(physical: Sequence[Candidate]) -> Candidate:
    """The best known effect, or one of few numbers that explains nearly as much as a best one of many."""
    best = physical[0]
    few = [c for c in physical if c.numbers <= FEW and c.refitted]
    return few[0] if best.numbers > MANY and few and not outdone(few[0].evidence, best.evidence, best.numbers) else best


def levels(discrepancy: Effect) -> bool:
    """Whether a discrepancy model changes how strongly all channels are read."""
    return discrepancy.discrepancy is not None and discrepancy.discrepancy.levels


def placed(discrepancy: Candidate, bench: Bench) -> Candidate:
    """A discrepancy model at the stage where it acts."""
    return replace(discrepancy, stage=stage_of(bench.effect(discrepancy), bench.scorer, bench.audit))


def beside_fault(bench: Bench, first: Candidate, asked: Asked) -> Diagnosis:
    """The verdict where a fault of the survey explains the most: it is mended, and what is left judged by itself."""
    fault = next(fault for fault in bench.faults if fault.name == first.effect)
    fit, solution = mended(bench.scorer.fit, bench.scorer.state, fault)
    rest = examined(fit, solution.state, bench.audit, asked)
    words = f"{fault_words(first, fault)}. Once it is mended, {rest.words}"
    if rest.verdict == "unknown-effect":
        candidates = (rest.candidates[0], *order(rest.candidates[1:], first))
        return replace(rest, words=words, candidates=candidates)
    left = rest.candidates[0].evidence if rest.verdict == "missing-effect" else 0.0
    candidates, fits = order(rest.candidates, first), {first.effect: (fit, solution.state)}
    return replace(rest, verdict="missing-effect", words=words, candidates=candidates, left=left, fits=fits)


def order(listed: Sequence[Candidate], first: Candidate) -> tuple[Candidate, ...]:
    """The list with one at its head."""
    return (first, *(c for c in listed if c.effect != first.effect))


def leading(listed: Sequence[Candidate], first: Candidate) -> tuple[Candidate, ...]:
    """The list with a verdict's candidate at its head.

    Whatever else lowers the misfit may do so in its place: that is open until it is in the model.
    """
    return order([replace(c, verdict="inconclusive") if c.verdict == "present" else c for c in listed], first)


def confounded(
    bench: Bench,
    first: Candidate,
    listed: Sequence[Candidate],
    tried: Mapping[str, Refit],
    effects: Sequence[Effect],
) -> tuple[str, ...]:
    """Names that cannot be told apart from the first candidate, one of some effects, in this survey."""
    close = [
        c.effect
        for c in listed
        if not c.generic and c.refitted and c.effect != first.effect and c.evidence > first.evidence - CLOSE
    ]
    scores = {s.effect.name: s for s in bench.table}
    kin = {name for kind in first.families for name in family(kind, effects)} - {first.effect}
    mine = scores[first.effect]
    for name in sorted(kin & set(scores)):
        # Laws of one family differ by little more than what any of them idealizes.
        rival = tried[name].evidence if name in tried else -np.inf
        alike = name not in tried and similarity(bench.scorer, mine, scores[name]) > ALIKE
        if alike or rival > RIVAL * first.evidence:
            close.append(name)
    return tuple(dict.fromkeys(close + hidden_with(first, effects)))


def held_out_gain(scorer: Scorer, winner: Refit) -> float | None:
    """Fall of the held-out chi2 per degree of freedom with the winner in the model."""
    fits = (scorer.fit, scorer.state), (winner.fit, winner.solution.state)
    without, with_it = side_by_side(lambda at: held_out_misfit(as_located(at[0].problem), at=at), fits)
    return None if without is None or with_it is None else without.chi2_per_dof - with_it.chi2_per_dof
