"""The verdict that a posterior over explanations leads to: what is named, with what it is not told from, and words."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from solver.catalogue.catalogue import family
from solver.criticism.candidate import Candidate
from solver.criticism.explanations import Posterior
from solver.criticism.finding import Diagnosis, concluded
from solver.criticism.placing import levels
from solver.criticism.refit import Refit, as_located
from solver.criticism.scorer import Scorer
from solver.criticism.verdict_words import (
    MORE,
    advice,
    beside_unknown_words,
    impossible_words,
    leveled_words,
    missing_words,
    negligible_words,
    open_words,
    power_words,
    unknown_words,
    untrusted_words,
)
from solver.effect import Effect
from solver.fit.held_out_gain import HeldOutGain, held_out_gain
from solver.fit.map_fit import MapFit

if TYPE_CHECKING:
    from solver.criticism.bench import Asked, Bench
    from solver.criticism.beside import Beside

#: Families of which the route hides each.
NEVER_ALONE = ("depth", "rigid")


@dataclass(frozen=True)
class Weighing:
    """The posterior of a fit.

    Parameters
    ----------
    posterior : over explanations
    besides : what shows beside the best known effects, by effect
    """

    posterior: Posterior
    besides: Mapping[str, "Beside"]


def judge(
    bench: "Bench", listed: Sequence[Candidate], tried: Mapping[str, Refit], asked: "Asked", weighing: Weighing
) -> Diagnosis:
    """The verdict on ranked candidates."""
    posterior = weighing.posterior
    listed = with_probabilities(listed, posterior)
    first = leading_candidate(listed, posterior)
    if posterior.verdict == "unknown-effect" and first is not None:
        found = unknown(bench, first, listed, tried, posterior)
    elif posterior.verdict == "adequate" or first is None:
        words = f"nothing is missing that this survey could show. {power_words(listed)}"
        found = concluded(bench, "adequate", words, [absent(c) for c in listed])
    elif posterior.verdict == "inconclusive" or first.effect not in tried:
        found = undecided(bench, first, listed, posterior, asked)
    elif first.verdict == "negligible" and second_of(first.effect, posterior) is None:
        # Of two effects one may be small until both are there.
        named = order([absent(c) for c in listed], first)
        found = concluded(bench, "adequate", negligible_words(first, power_words(listed)), named)
    else:
        found = confirmed(bench, first, listed, tried, asked, weighing)
    return replace(found, explanations=posterior.weighed)


def with_probabilities(listed: Sequence[Candidate], posterior: Posterior) -> list[Candidate]:
    """Candidates with the probability that they are missing; discrepancy models with that of what they imitate best."""
    told: dict[str, float] = {}
    for one in posterior.weighed:
        if one.effects:
            told[one.effects[0]] = told.get(one.effects[0], 0.0) + one.probability
    return [replace(c, probability=told.get(c.effect, 0.0)) for c in listed]


def absent(candidate: Candidate) -> Candidate:
    """A candidate that is not named though it may lower the misfit."""
    return replace(candidate, verdict="inconclusive") if candidate.verdict == "present" else candidate


def leading_candidate(listed: Sequence[Candidate], posterior: Posterior) -> Candidate | None:
    """The candidate of the most probable explanation that is not nothing; of the unknown where that holds most."""
    kinds = ("unknown",) if posterior.verdict == "unknown-effect" else ("effect", "two")
    best = next((one for one in posterior.weighed if one.kind in kinds), None)
    if best is None:
        return None
    found = next((c for c in listed if c.effect == best.effects[0]), None)
    if found is None:
        return None
    return replace(found, stage=best.stage) if best.kind == "unknown" else found


def unknown(
    bench: "Bench", first: Candidate, listed: Sequence[Candidate], tried: Mapping[str, Refit], posterior: Posterior
) -> Diagnosis:
    """The verdict where something unknown holds most."""
    best = next(one for one in posterior.weighed if one.kind == "unknown")
    physics = bench.effect(first).physics
    physical = [c for c in listed if not c.generic and c.refitted and not bench.is_fault(c)]
    pushed = physical[0] if physical and tried[physical[0].effect].pushed else None
    if bench.audit.leveled and levels(bench.effect(first)):
        words = leveled_words(bench.audit.loud)
    elif pushed is not None and pushed.evidence > first.evidence:
        words = impossible_words(pushed, first.stage)
        listed = [replace(c, verdict="excluded") if c.effect == pushed.effect else c for c in listed]
    elif len(best.effects) > 1:
        words = beside_unknown_words(best.effects[1], first, physics)
    else:
        words = unknown_words(first, physics, physical)
    return concluded(bench, "unknown-effect", words, leading(listed, first))


def undecided(
    bench: "Bench", first: Candidate, listed: Sequence[Candidate], posterior: Posterior, asked: "Asked"
) -> Diagnosis:
    """The verdict where neither nothing, nor the unknown, nor known effects hold enough."""
    first = replace(first, verdict="inconclusive", confounded_with=not_told_from(first, posterior, asked.effects))
    words = open_words(first, posterior.smallest())
    separate = advice(first, asked.effects) or MORE
    return concluded(bench, "inconclusive", words, leading(listed, first), separate=separate)


def confirmed(
    bench: "Bench",
    first: Candidate,
    listed: Sequence[Candidate],
    tried: Mapping[str, Refit],
    asked: "Asked",
    weighing: Weighing,
) -> Diagnosis:
    """The verdict on known effects that hold all but little, by passes held out."""
    winner, beside = tried[first.effect], weighing.besides.get(first.effect)
    left = 0.0 if beside is None else beside.second
    first = replace(first, confounded_with=not_told_from(first, weighing.posterior, asked.effects))
    gain = gain_of(bench.scorer, best_pair(first.effect, weighing) or winner) if asked.held_out else None
    first, separate = replace(first, held_out_gain=None if gain is None else gain.per_dof), advice(first, asked.effects)
    if gain is not None and gain.refuses(bench.scorer.variance):
        named = leading(listed, replace(first, verdict="inconclusive"))
        return concluded(bench, "inconclusive", untrusted_words(first), named, separate=separate, left=left)
    words = missing_words(first, left)
    return concluded(
        bench, "missing-effect", words, leading(listed, replace(first, verdict="present")), separate=separate, left=left
    )


def second_of(name: str, posterior: Posterior) -> str | None:
    """The effect with which a known one is most probable; None where that one suffices."""
    best = next((one for one in posterior.weighed if one.effects[:1] == (name,)), None)
    return best.effects[1] if best is not None and best.kind == "two" else None


def not_told_from(first: Candidate, posterior: Posterior, effects: Sequence[Effect]) -> tuple[str, ...]:
    """Names of known effects that the smallest set has beside a candidate, and of those that the route hides too."""
    among = [one.effects[0] for one in posterior.smallest() if one.kind in ("effect", "two")]
    return tuple(dict.fromkeys(name for name in (*among, *hidden_with(first, effects)) if name != first.effect))


def hidden_with(first: Candidate, effects: Sequence[Effect]) -> list[str]:
    """What the route hides, of some effects, together with a candidate, which is therefore never named alone."""
    kinds = [kind for kind in NEVER_ALONE if kind in first.families]
    return [name for kind in kinds for name in family(kind, effects) if name != first.effect]


def order(listed: Sequence[Candidate], first: Candidate) -> tuple[Candidate, ...]:
    """The list with one at its head."""
    return (first, *(c for c in listed if c.effect != first.effect))


def leading(listed: Sequence[Candidate], first: Candidate) -> tuple[Candidate, ...]:
    """The list with a verdict's candidate at its head.

    Whatever else lowers the misfit may do so in its place: that is open until it is in the model.
    """
    return order([absent(c) for c in listed], first)


def best_pair(name: str, weighing: Weighing) -> Refit | None:
    """The fit with a known effect and the one that explains most beside it; None where one suffices, or no such fit."""
    second, beside = second_of(name, weighing.posterior), weighing.besides.get(name)
    if second is None or beside is None:
        return None
    return next((one for one in beside.seconds if one.effect.name == second), None)


def gain_of(scorer: Scorer, winner: Refit) -> HeldOutGain | None:
    """Fall of the misfit of held-out passes with the winner in the model."""
    fits = (scorer.fit, scorer.state), (winner.fit, winner.solution.state)
    without, with_it = ((MapFit(as_located(fit.problem)), state) for fit, state in fits)
    return held_out_gain(without, with_it)
