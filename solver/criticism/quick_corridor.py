"""The corridor of a run with what its model may lack, by the fast score of the catalogue: what `locate` ends with."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, replace

import numpy as np
from numpy.typing import NDArray

from solver.catalogue.catalogue import FAULTS
from solver.criticism.audit import NoiseAudit, audit_of
from solver.criticism.bench import Bench, scorable
from solver.criticism.candidate import fault_candidate
from solver.criticism.comparison.local_misfit import with_local_misfit
from solver.criticism.corridor import Corridor
from solver.criticism.disagreement import Disagreement
from solver.criticism.explaining import Explainer
from solver.criticism.explanations import Posterior, title_of_explanation
from solver.criticism.finding import Diagnosis
from solver.criticism.growth import Grown, regrown
from solver.criticism.law_tolerance import law_errors
from solver.criticism.policy import POLICY
from solver.criticism.quick_scores import quick_scores, with_signals
from solver.criticism.race import UNSOLVED, started
from solver.criticism.refit import Refit, counted, loss, with_effect
from solver.criticism.repairs import mended
from solver.criticism.route_change import moved_by, moves, route_of
from solver.criticism.score import Score
from solver.criticism.scorer import Scorer
from solver.criticism.verdict_words import ADVICE, MORE, TURN
from solver.criticism.wandering import Wander, explains_best, wander_of
from solver.effect import Effect
from solver.fit.carried import carried_with_vehicles
from solver.fit.held_out import held_out
from solver.fit.least_squares import solve
from solver.fit.map_fit import MapFit
from solver.fit.pose import with_slow_errors_of
from solver.fit.state import Weights
from solver.fit.stretches import is_long
from solver.fit.track_trust import strict_tracks, track_spread
from solver.run.fitted import fitted
from solver.run.run import Run
from solver.run.run_corridor import BEND, BENDS, DISAGREE, DISAGREEMENT, TOLD, corridor_facts, median_half
from solver.run.strict_json import strict
from solver.run.titles import lower
from solver.run.trust import DIAGNOSIS, Gate, with_gate
from solver.survey.memory import give_back
from vision.contract.rounding import at_most

Array = NDArray[np.float64]
Advance = Callable[[int], None]

#: Explanations that are fitted at most, and Gauss-Newton steps of each: the linear prediction of one that is large is
#: too short, and what is left after these is a part of a sigma.
FITTED, STEPS = 2, 6
#: What narrows a corridor that an effect widens which shows: by a quick look, and by a diagnosis.
MENDED, NAMED = "adding it to the model, if `roadfiber diagnose RUN` names it too,", "adding it to the model"


def widening_steps(run: Run) -> int:
    """How often `widened` advances."""
    return len(scorable(run.problem, list(run.known.values()))) + FITTED


def widened(run: Run, advance: Advance = lambda n: None) -> Run:
    """The run with the corridor of all that its model may lack; with its fit's own, and why, where that is not known.

    Parameters
    ----------
    run : located, or with effects added
    advance : called with 1 after each effect scored and each explanation fitted
    """
    if run.result.method != "spline":
        return plain(run, f"what it may lack is not looked for with --method {run.result.method}")
    if is_long(run.problem):
        why = "what it may lack is not looked at on a fiber this long; where it lacks something, that is too narrow"
        return plain(run, why)
    if not run.result.converged:
        return plain(run, "the fit has not converged, so what it may lack cannot be told")
    at, effects = np.isin(run.result.channel, run.problem.channel), list(run.known.values())
    give_back()
    scorer, check = strict_scorer(run)
    if not check.passed:
        why = f"effects cannot be weighed, as the noise is not understood: {check.faults[0]}"
        wide = Corridor.own(scorer).with_part(DISAGREEMENT, Disagreement.of(scorer).added)
        return told(run, wide, Posterior(()), effects, why)
    bench = scored(scorer, check, effects, advance)
    wander = wander_of(scorer)
    if wander is not None and explains_best(wander, bench) and (again := allowed_for(run, wander)) is not run:
        run = again
        del scorer, bench
        scorer, check = strict_scorer(run)
        bench = scored(scorer, check, effects)
    return told(run, *weighed(bench, effects, run.result.sigma[at], advance), effects)


def allowed_for(run: Run, found: Wander) -> Run:
    """The run fitted again with tracks that may wander so far; as it was where that fit does not converge."""
    before, state = fitted(run)
    fit = MapFit(with_slow_errors_of(run.problem, found.size))
    end = solve(fit, carried_with_vehicles((before, state), fit))
    if not end.converged:
        return run
    grown = Grown(fit, end, None, held_out(fit.problem, at=(fit, end.state)))
    line = f"tracks wander by about {100 * found.size:.0f} cm for some seconds at a time; the fit allows for it"
    noted = replace(run, facts=run.facts | {"notes": [*run.facts["notes"], line]})
    return regrown(noted, grown, list(run.effects), run.result.seconds)


def scored(scorer: Scorer, check: NoiseAudit, effects: Sequence[Effect], advance: Advance = lambda n: None) -> Bench:
    """The fast score of a catalogue at the end of a fit whose noise was checked."""
    return Bench(check, scorer, quick_scores(scorer, scorable(scorer.fit.problem, effects), advance), [])


def strict_scorer(run: Run) -> tuple[Scorer, NoiseAudit]:
    """Scores at the end of a run's fit, with tracks that cannot take up what shifts them all; the audit of its noise.

    The fit is not repeated with such tracks: the score test takes the step to its end as linear.
    """
    fit, state = fitted(run)
    check = audit_of(fit, state)
    spread = track_spread(fit.problem.passes, state.vehicles.along.numpy())
    problem = replace(strict_tracks(fit.problem, spread), signal_noise=check.signal_noise)
    return Scorer(MapFit(problem), state), check


def told(
    run: Run,
    corridor: Corridor,
    posterior: Posterior,
    effects: Sequence[Effect],
    why: str = "",
    mended: str = MENDED,
) -> Run:
    """The run with a corridor, and what is told of it.

    Parameters
    ----------
    run, corridor, posterior : the run, what is added to its corridor, and of which explanations
    effects : the catalogue
    why : it leaves something out, as a clause
    mended : what narrows a corridor that an effect widens which shows
    """
    titles = {name: one.title for name, one in FAULTS.items()} | {one.name: one.title for one in effects}
    titles |= {DISAGREEMENT: DISAGREE, BENDS: BEND}
    families = {one.name: one.families for one in effects}
    widest, added = corridor.widest, corridor.at(run.result.channel)
    advice = [ADVICE[kind] for kind in families.get(widest, ()) if kind in ADVICE] or [MORE]
    shows = any(widest in one.effects and one.probability >= 0.5 for one in posterior.weighed if one.kind != "unknown")
    narrower = mended if shows else f"a survey with {'; '.join(advice)}"
    inside = {one.name for one in run.problem.effects}
    title = lower(titles[widest]) if widest else ""
    title = f"the law of {title}, which may be inexact" if widest in inside else title
    listed = [
        {"title": title_of_explanation(one, titles)} | asdict(one) for one in posterior.weighed if one.probability > 0
    ]
    facts = corridor_facts(
        run.result,
        added,
        why=why,
        widest=widest,
        title=title,
        share=corridor.share,
        narrower=narrower if widest else "",
        explanations=listed,
    )
    return replace(run, added=added, facts=run.facts | {"corridor": strict(facts)})


def with_diagnosis(run: Run, found: Diagnosis) -> Run:
    """The run whose corridor, sentence of trust and explanations are those of its diagnosis."""
    if found.corridor is not None and run.result.converged:
        run = told(run, found.corridor, Posterior(found.explanations), list(run.known.values()), mended=NAMED)
    gate = diagnosis_gate(found, median_half(run.result))
    return with_local_misfit(replace(run, facts=run.facts | {"trust": with_gate(run.facts["trust"], gate)}))


def lack_words(found: Diagnosis) -> str:
    """What a diagnosis finds, as a clause without sizes."""
    if found.verdict == "adequate":
        return found.bend or "the diagnosis finds nothing missing that this survey could show"
    first = found.candidates[0] if found.candidates else None
    if found.verdict == "inconclusive" or first is None:
        return "the diagnosis cannot tell what the model may lack"
    if found.verdict == "unknown-effect":
        return f"something acts at the {first.stage} stage that the catalogue does not know"
    return f"the model lacks {lower(first.title)}"


def diagnosis_gate(found: Diagnosis, half_width: float) -> Gate:
    """The check that the model lacks nothing; what moves the route within the fit's own corridor, m, is no failure."""
    name, words = DIAGNOSIS, lack_words(found)
    first = found.candidates[0] if found.candidates else None
    if found.verdict == "adequate":
        return Gate(name, "failed", words, (TURN,)) if found.bend else Gate(name, "passed", words)
    if found.verdict == "inconclusive" or first is None:
        return Gate(name, "open", words)
    if found.verdict == "unknown-effect":
        return Gate(name, "failed", words, ("`roadfiber compare RUN` shows where it is left",))
    move = first.route_change
    if move is not None:
        words += f", which moves the route by {at_most(move)}"
    small = move is not None and move < half_width
    return Gate(name, "passed" if small else "failed", words, (f"`roadfiber add RUN {first.effect} --out RUN-2`",))


def plain(run: Run, why: str) -> Run:
    """The run with its fit's own corridor, and why."""
    return replace(run, added=None, facts=run.facts | {"corridor": strict(corridor_facts(run.result, why=why))})


def weighed(bench: Bench, effects: Sequence[Effect], sigma: Array, advance: Advance) -> tuple[Corridor, Posterior]:
    """The corridor of the posterior over explanations of what a fit leaves, and that posterior.

    Parameters
    ----------
    bench : as of `scored`
    effects : the catalogue
    sigma : of the run's route, [fitted channel, 3], m
    advance : as of `widened`
    """
    scorer, fit = bench.scorer, bench.scorer.fit
    route = route_of(fit, scorer.state)
    far, tried = far_moving(bench, sigma), dict[str, Refit]()
    if far:
        # Falls of the misfit compare where both fits have ended.
        base = solve(fit, scorer.state, iterations=STEPS).state
        table = with_signals(scorer, bench.table)
        bench = Bench(bench.audit, Scorer(fit, base, variance=scorer.variance), table, [])
        away = route_of(fit, base) - route
    else:
        away = moved_by(scorer, scorer.step[: scorer.fitted])
    for score in far:
        refit = stepped(bench.scorer, score)
        tried |= {} if refit is None else {score.effect.name: refit}
        advance(1)
    posterior = Posterior.of(Explainer(bench, tried, effects).all({}))
    corridor = Corridor.of(bench, tried, posterior, away)
    for one in posterior.weighed:
        if one.kind == "fault" and one.probability > 1 - POLICY.held:
            fault = next(fault for fault in bench.faults if fault.name == one.effects[0])
            new, end = mended(fit, bench.scorer.state, fault)
            move = route_of(new, end.state, corridor.channel) - route
            corridor = corridor.with_move(fault.name, move, one.probability)
    for name, part in law_errors(bench.scorer).items():
        corridor = corridor.with_part(name, part)
    shown = {name for one in posterior.weighed if one.probability >= TOLD for name in one.effects}
    bench.table = [with_signals(bench.scorer, [s])[0] if s.effect.name in shown else s for s in bench.table]
    return corridor.with_disagreement(bench, tried, posterior), posterior


def far_moving(bench: Bench, sigma: Array) -> list[Score]:
    """Scores of what shows most, as long as the route moves by more than its sigma [channel, 3] with it somewhere.

    None where a fault of the survey shows so much more that full fits of effects would not come near it.
    """
    fault = max((fault_candidate(one, bench.scorer.variance).evidence for one in bench.faults), default=0.0)
    least = max(POLICY.found, fault / POLICY.hope, POLICY.stay * bench.table[0].evidence)
    found = []
    for score in bench.table:
        move = moves(bench, score.effect.name, {}) if score.evidence > least else None
        if move is not None and np.isfinite(move).all() and (np.abs(move) > sigma).any():
            found.append(score)
    return found[:FITTED]


def stepped(scorer: Scorer, score: Score) -> Refit | None:
    """A fit with an effect in the model after a few steps from its score's estimate; None where they lead nowhere."""
    counts = counted(scorer.fit, scorer.at)
    weights = Weights((counts > 0).double(), counts**2)
    fit = MapFit(with_effect(scorer.fit.problem, score.effect))
    try:
        end = solve(fit, started(fit, scorer, score, weights), iterations=STEPS)
    except UNSOLVED:
        return None
    fall = loss(scorer.fit, scorer.state, counts) - loss(fit, end.state, counts, end.at.models[0])
    return Refit(score, fit, end, fall, scorer.sharpness)
