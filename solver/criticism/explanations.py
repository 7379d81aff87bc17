"""A posterior over explanations of what a model leaves, and the verdict that is read off it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from solver.criticism.policy import POLICY, Policy
from solver.run.titles import lower

#: Kinds of explanations; overlooked is something that shows, and of which no model has a trace.
KINDS = ("nothing", "effect", "two", "fault", "unknown", "overlooked")


@dataclass(frozen=True)
class Explanation:
    """One way to explain what a survey's model leaves.

    Parameters
    ----------
    kind : of `KINDS`
    effects : names of what is missing, the one that explains most first; () for nothing, and for what is overlooked
    stage : at which that acts; "" for those
    prior : probability before the record
    evidence : ln of the Bayes factor against nothing
    simpler : key and evidence of what it adds to: nothing, or a known effect alone
    """

    kind: str
    effects: tuple[str, ...]
    stage: str
    prior: float
    evidence: float
    simpler: tuple[str, float] = ("", 0.0)

    @property
    def key(self) -> str:
        """What it is a case of, as of `key_of`."""
        return key_of(self)


@dataclass(frozen=True)
class Weighed:
    """Explanations of one name, together.

    Parameters
    ----------
    kind, effects, stage : of the most probable case
    probability : of all cases
    """

    kind: str
    effects: tuple[str, ...]
    stage: str
    probability: float


def key_of(one: Explanation | Weighed) -> str:
    """What an explanation is a case of: the effect that explains most, or the stage where something unknown acts."""
    if one.kind == "overlooked":
        return one.kind
    return one.stage if one.kind == "unknown" else (*one.effects, "")[0]


@dataclass(frozen=True)
class Posterior:
    """Explanations, most probable first; their probabilities sum to 1."""

    weighed: tuple[Weighed, ...]

    @classmethod
    def of(cls, explanations: Sequence[Explanation]) -> "Posterior":
        """Weigh explanations.

        What the record makes no more probable than something simpler does not show, and counts as that.

        >>> lowpass = Explanation("effect", ("lowpass",), "interrogator", 0.5, 3.0)
        >>> nothing = Explanation("nothing", (), "", 0.5, 0.0)
        >>> [(one.kind, round(one.probability, 3)) for one in Posterior.of([nothing, lowpass]).weighed]
        [('effect', 0.905), ('nothing', 0.095)]
        """
        most = max([0.0, *(one.evidence for one in explanations)])
        cases: dict[str, list[tuple[float, Explanation | None]]] = {"": [(0.0, None)]}
        for one in explanations:
            whole = one.prior * np.exp(one.evidence - most)
            simpler, evidence = one.simpler
            below = one.prior * np.exp(min(one.evidence, evidence) - most)
            hidden = {"nothing": whole, "overlooked": 0.0}.get(one.kind, below)
            cases.setdefault(simpler, []).append((float(hidden), None))
            cases.setdefault(one.key, []).append((float(whole - hidden), one))
        total = sum(share for found in cases.values() for share, _ in found)
        weighed = [cls._together(found, total) for found in cases.values()]
        return cls(tuple(sorted(weighed, key=lambda one: -one.probability)))

    @staticmethod
    def _together(found: Sequence[tuple[float, Explanation | None]], total: float) -> Weighed:
        """Explanations of one name, with their shares of a total."""
        named = [(share, one) for share, one in found if one is not None]
        best = max(named, key=lambda case: case[0])[1] if named else Explanation("nothing", (), "", 1.0, 0.0)
        return Weighed(best.kind, best.effects, best.stage, sum(share for share, _ in found) / total)

    def smallest(self, held: float = POLICY.held) -> tuple[Weighed, ...]:
        """The fewest explanations that hold so much together."""
        sums = np.cumsum([one.probability for one in self.weighed])
        return self.weighed[: int(np.searchsorted(sums, min(held, sums[-1]))) + 1]

    def of_kind(self, *kinds: str) -> float:
        """Probability of some kinds."""
        return sum(one.probability for one in self.weighed if one.kind in kinds)

    @property
    def unmoved(self) -> float:
        """Probability of all for which the route stays as it was fitted: no known effect or fault is missing."""
        return self.of_kind("nothing", "overlooked", "unknown")

    @property
    def beside_leader(self) -> float:
        """Probability of something unknown beside a known effect that alone holds most: that one is missing either way.

        Where it does not hold most alone, it may only stand in for a part of the unknown. What is unknown at a stage
        counts by its most probable case.
        """
        first = self.weighed[0]
        if first.kind != "effect" or first.probability < 0.5:
            return 0.0
        return sum(one.probability for one in self.weighed if one.kind == "unknown" and first.effects[0] in one.effects)

    @property
    def verdict(self) -> str:
        """Adequate, missing-effect, unknown-effect or inconclusive.

        Nothing, or the unknown, is said where it holds most; a known effect, or a set of them, where it holds all but
        what `Policy.held` leaves, with or without more that is not known.
        """
        if self.of_kind("nothing") >= 0.5:
            return "adequate"
        if self.of_kind("unknown") >= 0.5:
            return "unknown-effect"
        claimed = self.of_kind("effect", "two", "fault") + self.beside_leader
        return "missing-effect" if claimed >= POLICY.held else "inconclusive"


def priors(policy: Policy, known: int, stages: int, faults: int) -> dict[str, float]:
    """Prior probability of each single explanation of a kind, of so many effects, stages and faults.

    >>> round(priors(Policy(known=0.3), 30, 6, 3)["effect"], 3)
    0.01
    """
    pairs = max(known * (known - 1) / 2, 1.0)
    return {
        "nothing": policy.nothing,
        "effect": policy.known / max(known, 1),
        "two": policy.two / pairs,
        "fault": policy.fault / max(faults, 1),
        "unknown": policy.unknown / max(stages, 1),
        "overlooked": policy.overlooked,
    }


def title_of_explanation(one: Weighed, titles: Mapping[str, str]) -> str:
    """An explanation in plain words, with the titles of effects.

    >>> title_of_explanation(Weighed("unknown", ("generic_echo",), "interrogator", 0.1), {})
    'Something unknown (interrogator)'
    >>> beside = Weighed("unknown", ("generic_echo", "camber"), "interrogator", 0.1)
    >>> title_of_explanation(beside, {"camber": "Cambered road"})
    'Something unknown (interrogator) beside cambered road'
    """
    if one.kind == "nothing":
        return "Nothing that would show"
    if one.kind == "overlooked":
        return "Something unnoticed"
    if one.kind == "unknown":
        known = [lower(titles.get(name, name)) for name in one.effects[1:]]
        return " beside ".join([f"Something unknown ({one.stage})", *known])
    return titles.get(one.effects[0], one.effects[0]) + (", and more" if one.kind == "two" else "")
