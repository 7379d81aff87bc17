"""What shows beside a known effect once it is in the model, and whether that casts doubt on it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from solver.catalogue.catalogue import STAND_INS, families_of
from solver.criticism.bench import Asked, Bench, racers, scorable
from solver.criticism.candidate import Candidate
from solver.criticism.refit import Refit, race
from solver.criticism.score import FOUND, Score
from solver.criticism.scorer import score_all
from solver.effect import Effect
from solver.fit.least_squares import solve

#: How many enter the race for what the winner leaves.
BESIDE = 6
#: What another must explain more, as ln of the Bayes factor, to be told apart.
CLOSE = 6.0
#: Share of a stand-in's evidence at which a known effect, whose law is stricter, is preferred to it; and where the
#: stand-in has as few numbers.
STRICTER, AS_STRICT = 0.95, 0.98
#: Numbers of an effect whose law is strict, and above which it is as flexible as a stand-in.
FEW, MANY = 3, 20
#: Share of the winner's fall of chi2 that may be left to a stand-in of its own kind, as its law may be off by a little
#: (that of one with many numbers by what is finer than its knots), and to one of another kind, before it is doubted.
LEFT, FINER, ASTRAY = 0.05, 0.1, 0.025
#: Share of a stand-in's evidence from which on a known effect may, with a second one beside it, explain more.
HALF = 0.5


@dataclass
class Beside:
    """What the fit with a known effect in it still lacks.

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
        """The same with known effects that did not show before: the winner may have outshone them."""
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
    def stand_in(self) -> Refit | None:
        """The best stand-in for the unknown."""
        return max((r for r in self.tried.values() if r.effect.generic), key=lambda r: r.evidence, default=None)

    def doubt(self, first: Candidate) -> Refit | None:
        """The stand-in for the unknown to which the first candidate leaves more than its own law may be off by."""
        best = self.stand_in
        if best is None or not outdone(self.known, best.evidence, best.score.freedom):
            return None
        alike = [s.fall for s in self.others if s.effect.generic and akin(first, s.effect)]
        own = FINER if first.numbers > MANY else LEFT
        most = own if max(alike, default=0.0) >= best.fall or akin(first, best.effect) else ASTRAY
        return best if best.fall > most * max(first.delta_chi2, 1.0) else None


def both_known(
    bench: Bench, first: Candidate, stand_in: Candidate, tried: Mapping[str, Refit], asked: Asked
) -> Beside | None:
    """What shows beside a known effect where it, with a second one, explains more than a stand-in does; else None.

    Laws that are about as flexible as the stand-in explain a part of anything: they do not count.
    """
    winner, most = tried.get(first.effect), max(MANY, stand_in.numbers / 2)
    if winner is None or winner.pushed or first.numbers > most or first.evidence < HALF * stand_in.evidence:
        return None
    beside = Beside.of(bench, first, winner, asked)
    strict = [r.evidence for r in beside.tried.values() if not r.effect.generic and r.score.freedom <= most]
    more = first.evidence + max(strict, default=0.0) >= stand_in.evidence + CLOSE
    return beside if more and beside.doubt(first) is None else None


def outdone(known: float, stand_in: float, numbers: int) -> bool:
    """Whether a stand-in of so many numbers explains more, by its evidence, than the best known effect can."""
    return known + CLOSE < (STRICTER if numbers > FEW else AS_STRICT) * stand_in


def akin(first: Candidate, stand_in: Effect) -> bool:
    """Whether a stand-in takes up what the law of the first candidate, at its stage or of its family, leaves."""
    return stand_in.stage == first.stage or of_family(first, stand_in)


def of_family(first: Candidate, stand_in: Effect) -> bool:
    """Whether a stand-in takes up what the laws of the first candidate's family leave."""
    return not set(STAND_INS.get(stand_in.name, ())).isdisjoint(families_of(first.effect))


def suspects(table: Sequence[Score], effects: Sequence[Effect]) -> list[Effect]:
    """Effects that may be missing beside the winner: those that showed, and the stand-ins for the unknown."""
    shown = {s.effect.name for s in table if s.evidence > FOUND}
    return [one for one in effects if one.name in shown or one.generic]
