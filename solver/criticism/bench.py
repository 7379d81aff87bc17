"""A converged fit of a survey with the scores of every effect that it may lack."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from solver.criticism.audit import NoiseAudit
from solver.criticism.candidate import Candidate
from solver.criticism.fault import Fault
from solver.criticism.policy import POLICY
from solver.criticism.repairs import SEARCHES
from solver.criticism.score import Score
from solver.criticism.scorer import Scorer, score_all
from solver.effect import Effect
from solver.fit.map_fit import MapFit
from solver.fit.problem import Problem
from solver.fit.state import State

Advance = Callable[[int], None]
#: Hears how candidates were ranked, and the candidates, best first.
Tell = Callable[[str, Sequence[Candidate]], None]


@dataclass(frozen=True)
class Asked:
    """What a diagnosis is asked.

    Parameters
    ----------
    effects : the catalogue
    held_out : whether to confirm the winner on passes that its fit has not seen
    advance : called with 1 after each effect is scored and after the first fit of each candidate
    tell : called with candidates as soon as they are ranked
    """

    effects: Sequence[Effect]
    held_out: bool
    advance: Advance
    tell: Tell = lambda ranking, listed: None


@dataclass
class Bench:
    """A converged fit with its scores.

    Parameters
    ----------
    audit : of the survey's noise
    scorer : at that fit, without the candidates
    table : scores, best evidence first
    idle : effects that find nothing to act on
    """

    audit: NoiseAudit
    scorer: Scorer
    table: list[Score]
    idle: list[Effect]

    @cached_property
    def faults(self) -> list[Fault]:
        """Those of the survey itself."""
        fit, state = self.scorer.fit, self.scorer.state
        return [fault for search in SEARCHES.values() if (fault := search(fit, state)) is not None]

    @classmethod
    def of(
        cls,
        fit: MapFit,
        state: State,
        audit: NoiseAudit,
        effects: Sequence[Effect],
        advance: Advance,
        variance: float | None = None,
        near: Mapping[str, Mapping[str, float]] | None = None,
    ) -> "Bench":
        """Score `effects`, those in the model left out; `variance` as of a `Scorer`, `near` as of `score_all`."""
        scorer = Scorer(fit, state, variance=variance)
        asked = scorable(fit.problem, effects)
        table = score_all(scorer, asked, advance, near)
        scorer.forget()
        scored = {score.effect.name for score in table}
        idle = [one for one in asked if one.name not in scored]
        return cls(audit, scorer, table, idle)

    def effect(self, candidate: Candidate) -> Effect:
        """The effect that a candidate is."""
        every = (*(score.effect for score in self.table), *self.idle)
        return next(one for one in every if one.name == candidate.effect)

    def is_fault(self, candidate: Candidate) -> bool:
        """Whether a candidate is a fault of the survey rather than an effect."""
        return any(fault.name == candidate.effect for fault in self.faults)


def scorable(problem: Problem, effects: Sequence[Effect]) -> list[Effect]:
    """Effects that are not in the model already."""
    inside = {one.name for one in problem.effects}
    return [one for one in effects if one.name not in inside and one.base_part not in problem.base_parts]


def racers(table: Sequence[Score], most: int = POLICY.racers) -> list[Score]:
    """Those to be fitted in full: known effects that their scores speak for, and discrepancy models that show.

    Of many numbers a score, which is linear, tells least: tracks that wander by half a meter have an evidence of 4 by
    their score and of 369 by their fit. So known effects of many numbers are fitted unless their scores speak against
    them; and as one that is fitted has the better of one that is only scored, others need not show yet either.

    Parameters
    ----------
    table : scores, best evidence first
    most : of the best ones, of which `Policy.unknown_racers` may be discrepancy models
    """
    known = [s for s in table if not s.effect.generic]
    first = [s for s in known if s.evidence > 0][: most - POLICY.unknown_racers]
    many = [s for s in known if s.effect.varies and s.evidence > -POLICY.bare and all(s is not one for one in first)]
    unknown = [s for s in table if s.effect.generic and s.evidence > POLICY.found][: POLICY.unknown_racers]
    return first + many + unknown
