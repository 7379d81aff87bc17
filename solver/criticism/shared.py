"""What several stretches of one fiber lack: the same cause along all of it, or each its own."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from solver.catalogue.catalogue import FAULTS
from solver.catalogue.plain_words import Told
from solver.criticism.explanations import Weighed, key_of, priors
from solver.criticism.policy import POLICY
from solver.effect import STAGES

#: Ln of a probability that a posterior rounded to zero.
LEAST = -700.0


@dataclass(frozen=True)
class Shared:
    """What stretches lack together.

    Parameters
    ----------
    weighed : explanations with one cause along all of the fiber, most probable first; their probabilities sum to 1
    alike : probability that there is one cause along all of it (or none), rather than each stretch its own, if both
        were as likely before
    """

    weighed: tuple[Weighed, ...]
    alike: float

    @classmethod
    def of(cls, posteriors: Sequence[Sequence[Weighed]], known: int) -> "Shared":
        """From the explanations of each stretch and their probabilities, of a catalogue of so many known effects.

        With the probability P_s(h) of an explanation h in stretch s and p(h) before, the stretches' Bayes factors
        multiply: p(h) prod_s P_s(h) / p(h), summed over h, is also how much more probable one cause along all of the
        fiber makes the records than one of its own in each stretch (Kass and Raftery 1995, J. Am. Stat. Assoc. 90,
        773). An explanation that a stretch does not list acts on nothing there.

        >>> nothing, gauge = Weighed("nothing", (), "", 0.4), Weighed("effect", ("gauge",), "interrogator", 0.6)
        >>> found = Shared.of([[gauge, nothing]] * 3, 50)
        >>> found.weighed[0].effects, found.weighed[0].probability > 0.99, found.alike > 0.99
        (('gauge',), True, True)
        """
        before = priors(POLICY, known, len(STAGES), len(FAULTS))
        told = {key_of(one): one for stretch in posteriors for one in reversed(stretch)}
        prior = {name: before["effect" if one.kind == "two" else one.kind] for name, one in told.items()}
        told.setdefault("", Weighed("nothing", (), "", 0.0))
        prior[""] = before["nothing"]
        total = {name: np.log(prior[name]) for name in told}
        for stretch in posteriors:
            share = shares(stretch)
            none = share.get("", LEAST) - np.log(prior[""])
            for name in told:
                total[name] += share[name] - np.log(prior[name]) if name in share else none
        most = max(total.values())
        weight = {name: float(np.exp(one - most)) for name, one in total.items()}
        whole = sum(weight.values())
        odds = np.clip(np.log(whole) + most, LEAST, -LEAST)
        weighed = [
            Weighed("effect" if one.kind == "two" else one.kind, one.effects[:1], one.stage, weight[name] / whole)
            for name, one in told.items()
        ]
        return cls(tuple(sorted(weighed, key=lambda one: -one.probability)), float(1 / (1 + np.exp(-odds))))


def shares(stretch: Sequence[Weighed]) -> Mapping[str, float]:
    """Ln of the probability of each case in a stretch."""
    found: dict[str, float] = {}
    for one in stretch:
        found[key_of(one)] = found.get(key_of(one), 0.0) + one.probability
    return {name: max(float(np.log(max(share, 1e-300))), LEAST) for name, share in found.items()}


def pooled(sizes: Sequence[Told]) -> tuple[float, float, float]:
    """Mean size of an effect by precision, its standard deviation, and how far sizes scatter, in their sigmas (rms).

    >>> told = [Told("", "", size, 0.1, 0.0, "m") for size in (1.0, 1.2)]
    >>> [round(one, 2) for one in pooled(told)]
    [1.1, 0.07, 1.41]
    """
    size, sigma = np.array([(one.size, one.sigma) for one in sizes]).T
    weight = 1 / sigma**2
    mean = float((weight * size).sum() / weight.sum())
    freedom = max(len(size) - 1, 1)
    return mean, float(weight.sum() ** -0.5), float(np.sqrt((weight * (size - mean) ** 2).sum() / freedom))
