"""What else shows once a known effect is in the model, and whether that casts doubt on it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from solver.criticism.bench import Asked, Bench, racers, scorable
from solver.criticism.candidate import Candidate
from solver.criticism.race import race
from solver.criticism.refit import Refit
from solver.criticism.score import FOUND, Score
from solver.criticism.scorer import score_all
from solver.effect import Effect
from solver.fit.least_squares import solve

#: Number of candidates fitted in full to what the winner leaves.
BESIDE = 6
#: Evidence, as ln of the Bayes factor, by which another must lead to be told apart.
CLOSE = 6.0
#: Share of a discrepancy model's evidence at which a known effect, whose law is stricter, is preferred to it; and the
#: same where that model has as few numbers.
STRICTER, AS_STRICT = 0.95, 0.98
#: Most numbers of an effect with a strict law, and the number above which one is as flexible as a discrepancy model.
FEW, MANY = 3, 20
#: Share of the winner's fall of chi2 left to a discrepancy model of its own kind, whose law may be a bit off
#: (that of one with many numbers by what is finer than its knots), and to one of another kind, before it is doubted.
LEFT, FINER, ASTRAY = 0.05, 0.1, 0.025
#: Share of a discrepancy model's evidence from which on a known effect may, with a second one beside it, explain more.
HALF = 0.5


@dataclass
class Beside:
    """What a fit with a known effect in its model still lacks.

    Parameters
    ----------
    bench : at that fit
    others : scores of what shows there, best evidence first
    tried : the best of them fitted in full
    """

    bench: Bench
    others: list[Score]
    tried: Mapping[str, Refit]

    @classmethod
    def of(cls, bench: Bench, first: Candidate, winner: Refit, asked: Asked) -> "Beside":
        """Fit the first candidate, the winner, to its end; score all that showed before, and race the best."""
        fit, state = winner.fit, solve(winner.fit, winner.solution, iterations=40).state
        again = Bench.of(fit, state, bench.audit, suspects(bench.table, asked.effects), asked.advance)
        others = [s for s in again.table if s.evidence > FOUND]
        beside = cls(again, others, race(again.scorer, racers(others, BESIDE), asked.advance))
        return beside if beside.doubt(first) is None else beside.widened(asked)

    def widened(self, asked: Asked) -> "Beside":
        """The same with known effects that did not show before: the winner may have masked them."""
        scorer, seen = self.bench.scorer, {s.effect.name for s in self.bench.table}
        unseen = [one for one in scorable(scorer.fit.problem, asked.effects) if one.name not in seen]
        shown = [s for s in score_all(scorer, unseen, asked.advance) if s.evidence > FOUND]
        others = sorted(self.others + shown, key=lambda s: -s.evidence)
        late = race(scorer, racers(shown, BESIDE), asked.advance)
        return replace(self, others=others, tried={**self.tried, **late})

    @property
    def left(self) -> float:
        """Ln of the Bayes factor of the best effect beside."""
        return self.others[0].evidence if self.others else 0.0

    @property
    def known(self) -> float:
        """That of the best known effect, fitted in full."""
        return max((r.evidence for r in self.tried.values() if not r.effect.generic), default=0.0)

    @property
    def discrepancy(self) -> Refit | None:
        """The best discrepancy model for the unknown."""
        return max((r for r in self.tried.values() if r.effect.generic), key=lambda r: r.evidence, default=None)

    def doubt(self, first: Candidate) -> Refit | None:
        """The discrepancy model that explains more of what the first leaves than an error of its law could."""
        best = self.discrepancy
        if best is None or not outdone(self.known, best.evidence, best.score.freedom):
            return None
        alike = [s.fall for s in self.others if s.effect.generic and akin(first, s.effect)]
        own = FINER if first.numbers > MANY else LEFT
        most = own if max(alike, default=0.0) >= best.fall or akin(first, best.effect) else ASTRAY
        return best if best.fall > most * max(first.delta_chi2, 1.0) else None


def both_known(
    bench: Bench, first: Candidate, discrepancy: Candidate, tried: Mapping[str, Refit], asked: Asked
) -> Beside | None:
    """What shows beside a known effect where the two explain more than a discrepancy model; else None.

    Laws about as flexible as the discrepancy model can explain part of anything and do not count.
    """
    winner, most = tried.get(first.effect), max(MANY, discrepancy.numbers / 2)
    if winner is None or winner.pushed or first.numbers > most or first.evidence < HALF * discrepancy.evidence:
        return None
    beside = Beside.of(bench, first, winner, asked)
    strict = [r.evidence for r in beside.tried.values() if not r.effect.generic and r.score.freedom <= most]
    more = first.evidence + max(strict, default=0.0) >= discrepancy.evidence + CLOSE
    return beside if more and beside.doubt(first) is None else None


def outdone(known: float, discrepancy: float, numbers: int) -> bool:
    """Whether a discrepancy model of so many numbers explains more, by its evidence, than the best known effect can."""
    return known + CLOSE < (STRICTER if numbers > FEW else AS_STRICT) * discrepancy


def akin(first: Candidate, discrepancy: Effect) -> bool:
    """Whether a discrepancy model is of the first candidate's stage or family, and so absorbs an error of its law."""
    return discrepancy.stage == first.stage or of_family(first, discrepancy)


def of_family(first: Candidate, discrepancy: Effect) -> bool:
    """Whether a discrepancy model absorbs errors of the laws of the first candidate's family."""
    return not set(discrepancy.families).isdisjoint(first.families)


def suspects(table: Sequence[Score], effects: Sequence[Effect]) -> list[Effect]:
    """Effects that may be missing too: those that showed, and the discrepancy models for the unknown."""
    shown = {s.effect.name for s in table if s.evidence > FOUND}
    return [one for one in effects if one.name in shown or one.generic]
