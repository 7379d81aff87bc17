"""The explanations of what a fit leaves, each with its marginal likelihood: from scores, and from full fits."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from solver.catalogue.catalogue import FAULTS
from solver.criticism.bench import Bench
from solver.criticism.candidate import fault_candidate
from solver.criticism.explanations import Explanation, priors
from solver.criticism.placing import declared_stage, levels, stage_of
from solver.criticism.policy import POLICY
from solver.criticism.refit import Refit
from solver.effect import STAGES, Effect

if TYPE_CHECKING:
    from solver.criticism.beside import Beside


def in_order(pair: Explanation, alone: Mapping[str, Explanation]) -> Explanation:
    """Two effects, the one that explains more by itself first: the two must explain more than that."""
    known = [alone[name] for name in pair.effects if name in alone]
    first = max(known, key=lambda one: one.evidence, default=None)
    if first is None:
        return pair
    names = (first.effects[0], *(name for name in pair.effects if name != first.effects[0]))
    return replace(pair, effects=names, stage=first.stage, simpler=(names[0], first.evidence))


class Explainer:
    """Explanations of what a fit leaves.

    Parameters
    ----------
    bench : at that fit
    tried : full fits, by effect
    effects : the catalogue
    """

    def __init__(self, bench: Bench, tried: Mapping[str, Refit], effects: Sequence[Effect]):
        self.bench, self.tried = bench, tried
        self.known = sum(not one.generic for one in effects)
        self.generic = [one for one in effects if one.generic]
        self.prior = priors(POLICY, self.known, len(STAGES), len(FAULTS))
        self._stages: dict[str, str] = {}

    def stage(self, discrepancy: Effect) -> str:
        """Stage at which what a discrepancy model explains acts."""
        if discrepancy.name not in self._stages:
            self._stages[discrepancy.name] = stage_of(discrepancy, self.bench.scorer, self.bench.audit)
        return self._stages[discrepancy.name]

    def all(self, besides: Mapping[str, "Beside"]) -> list[Explanation]:
        """Every explanation; `besides` has what shows beside known effects, by effect."""
        found = [Explanation(kind, (), "", self.prior[kind], 0.0) for kind in ("nothing", "overlooked")] + self.faults()
        for score in self.bench.table:
            name = score.effect.name
            one = self.tried.get(name)
            if score.effect.generic:
                found.append(self.unknown(score.effect, (name,), score.evidence if one is None else one.evidence, 1.0))
            elif one is None or name not in besides:
                found += self.alone(score.effect, score.evidence if one is None else one.evidence, one)
            else:
                found += self.with_beside(besides[name])
        alone = {one.effects[0]: one for one in found if one.kind == "effect"}
        return [in_order(one, alone) if one.kind == "two" else one for one in found]

    def faults(self) -> list[Explanation]:
        """Faults of the survey."""
        told = [fault_candidate(fault, self.bench.scorer.variance) for fault in self.bench.faults]
        return [
            Explanation("fault", (one.effect,), one.stage, self.prior["fault"], one.evidence)
            for one in told
            if one.verdict == "present"
        ]

    def alone(self, effect: Effect, evidence: float, one: Refit | None) -> list[Explanation]:
        """A known effect alone; none at a size that cannot be."""
        if one is not None and one.pushed:
            return []
        return [Explanation("effect", (effect.name,), effect.stage, self.prior["effect"], evidence)]

    def unknown(
        self,
        discrepancy: Effect,
        names: tuple[str, ...],
        evidence: float,
        share: float,
        simpler: tuple[str, float] = ("", 0.0),
    ) -> Explanation:
        """Something unknown that a discrepancy model imitates; `share` of what its stage's models have before."""
        stage = self.stage(discrepancy)
        same = sum(declared_stage(one) == stage for one in self.generic)
        if self.bench.audit.leveled and stage == "processing" and levels(discrepancy):
            evidence = max(evidence, 0.0) + POLICY.leveled
        return Explanation("unknown", names, stage, share * self.prior["unknown"] / max(same, 1), evidence, simpler)

    def with_beside(self, beside: "Beside") -> list[Explanation]:
        """A known effect whose law may be off, with a second one, or as a stand-in for a part of something unknown."""
        one = beside.refit
        name, stage = one.effect.name, one.effect.stage
        least = one.evidence + beside.tolerated
        found = self.alone(one.effect, least, one)
        simpler = next(((name, alone.evidence) for alone in found), ("", 0.0))
        fitted = {second.effect.name: second.evidence for second in beside.seconds if not second.pushed}
        for score in beside.table:
            other = score.effect.name
            if score.effect.generic:
                both = least + score.evidence
                found.append(self.unknown(score.effect, (other, name), both, 1 / self.known, simpler))
            elif not one.pushed:
                both = least + fitted.get(other, score.evidence)
                found.append(Explanation("two", (name, other), stage, self.prior["two"], both, simpler))
        return found
