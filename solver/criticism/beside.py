"""What still shows beside a known effect that was fitted in full, and how much of that its law may be off by."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from solver.criticism.bench import Asked, Bench, racers, scorable
from solver.criticism.marginal import mixture
from solver.criticism.policy import POLICY
from solver.criticism.race import race, started_elsewhere, told_from_slow_errors, with_slow_errors
from solver.criticism.refit import Refit
from solver.criticism.score import Score
from solver.criticism.scorer import Scorer, score_all
from solver.effect import Effect
from solver.fit.windowed import Windowed


@dataclass(frozen=True)
class Beside:
    """What a fit with a known effect in its model still lacks.

    Parameters
    ----------
    refit : with the effect
    bench : at that fit
    table : scores of what may be missing besides, best evidence first
    seconds : known effects of the table that were fitted in full beside it
    """

    refit: Refit
    bench: Bench
    table: Sequence[Score]
    seconds: Sequence[Refit] = field(default=())

    @classmethod
    def of(cls, bench: Bench, refit: Refit, asked: Asked) -> "Beside":
        """Score what by its signal still shows once the effect is in the model, and the discrepancy models.

        Known effects are scored near the shapes that they had alone.
        """
        fit, state = refit.fit, refit.solution.state
        effects = suspects(beyond(bench.scorer, refit.score, shown(bench.table)), asked.effects)
        near = {s.effect.name: s.shape for s in bench.table if s.shape and not s.effect.generic}
        variance = bench.scorer.variance + off(refit)
        again = Bench.of(fit, state, bench.audit, effects, asked.advance, variance, near)
        return cls(told_from_slow_errors(bench.scorer, refit, again.scorer), again, again.table)

    def widened(self, asked: Asked) -> "Beside":
        """The same with known effects of all shapes, those too that the effect may have masked, and full fits."""
        scorer = self.bench.scorer
        seen = {s.effect.name for s in self.table if s.effect.generic or not s.shape}
        unseen = [one for one in scorable(scorer.fit.problem, asked.effects) if one.name not in seen]
        scored = [s for s in self.table if s.effect.name in seen] + score_all(scorer, unseen, asked.advance)
        table = sorted(scored, key=lambda s: -s.evidence)
        # What may be unknown beside it is scored alone, so that of known effects only what shows is fitted.
        known = [s for s in shown(table) if not s.effect.generic]
        first = racers(known, POLICY.besides + POLICY.unknown_racers)
        others = started_elsewhere(scorer, scorable(scorer.fit.problem, asked.effects))
        seconds = race(scorer, first, asked.advance, others)
        return replace(self, table=table, seconds=tuple(with_slow_errors(scorer, seconds).values()))

    @property
    def second(self) -> float:
        """Ln of the Bayes factor of a second effect against an inexact law of the first."""
        fitted = {one.effect.name: one.evidence for one in self.seconds}
        return max((fitted.get(s.effect.name, s.evidence) for s in self.table), default=0.0)

    @property
    def both(self) -> float:
        """Ln of the Bayes factor of the effect, its law inexact, and a second one."""
        return self.refit.evidence + self.tolerated + self.second

    @staticmethod
    def hope(one: Refit, fall: float, variance: float) -> float:
        """Most that a tolerance may add to the evidence of a refit, where `fall` is the most that any explains."""
        share = off(one) / variance
        return max(fall - one.fall, 0.0) / variance * share / (1 + share) / 2

    @property
    def tolerated(self) -> float:
        """Ln of the Bayes factor for a law that is off by what its tolerance allows, in the way of a discrepancy model.

        Each of those models, and a law that is exact, are as probable before.
        """
        more = off(self.refit)
        variance = self.bench.scorer.variance - more
        return mixture([0.0, *(s.tolerated(variance, more) for s in self.table if s.effect.generic)])


def off(refit: Refit) -> float:
    """Squared sigmas by which a refit's law may be off in any one direction, and so as what the noise counts there.

    The fit leaves of that about as much as of the effect itself.
    """
    return POLICY.tolerance**2 * max(refit.fall, 0.0)


def akin(effect: Effect, discrepancy: Effect) -> bool:
    """Whether a discrepancy model is of an effect's stage or family, and so absorbs an error of its law.

    >>> from solver.catalogue.catalogue import built_in
    >>> known = built_in()
    >>> [akin(known["lowpass"], known[name]) for name in ("generic_neighbors", "generic_kernel", "generic_road")]
    [True, True, False]
    """
    return discrepancy.stage == effect.stage or not set(discrepancy.families).isdisjoint(effect.families)


def shown(table: Sequence[Score]) -> list[Score]:
    """Scores of what showed."""
    return [s for s in table if s.evidence > POLICY.found]


def beyond(scorer: Scorer, first: Score, others: Sequence[Score]) -> list[Score]:
    """Of some scores those whose signals the residual still holds once that of a first one is taken out of it."""
    rest = [one for one in others if one.effect.name != first.effect.name]
    signals = [one.signal for one in (first, *rest) if one.signal is not None]
    left = scorer.project([Windowed.beside(signals)])[0]
    own, score = left.information.diagonal(), left.score
    along = left.information[0] / own[0].clamp_min(1e-300)
    falls = (score - along * score[0]).square() / (own - along * left.information[0]).clamp_min(1e-12 * own)
    least = 2 * POLICY.found * scorer.variance
    return [one for one, fall in zip(rest, falls[1:].tolist(), strict=True) if fall > least]


def suspects(table: Sequence[Score], effects: Sequence[Effect]) -> list[Effect]:
    """Effects that may be missing too: those of a table, and the discrepancy models for the unknown."""
    names = {s.effect.name for s in table}
    return [one for one in effects if one.name in names or one.generic]
