"""Verdicts in words, for people who bury cables and people who film streets."""

from collections.abc import Sequence

from solver.criticism.candidate import Candidate
from solver.criticism.repairs import Fault
from solver.criticism.score import FOUND
from solver.effects.catalogue import FAMILIES, families_of

ADVICE = {
    "blur": "passes from 30 to 70 km/h, a second lane farther away, and two classes of vehicle",
    "lag": "passes in both directions and at clearly different speeds",
    "even": "passes in both directions, and slow ones, with some seconds of quiet after each",
    "gain": "a second lane, and an anchor on either side of the place",
    "place": "three or more anchors along the fiber, and a check of the camera by points on the road",
    "depth": "one point of the fiber with known depth",
    "rigid": "two or more anchors, some tens of meters apart",
}


def number(value: float) -> str:
    """A number for people."""
    return f"{value:.3g}"


def missing_words(first: Candidate, faults: Sequence[Fault], left: float) -> tuple[str, str]:
    """Verdict on a missing effect, and what survey would tell its twins apart."""
    fault = next((f for f in faults if f.name == first.effect), None)
    what = fault.words if fault else f"{first.effect} is missing at the {first.stage} stage"
    unit = "" if first.unit == "1" else f" {first.unit}"
    size = f"; size {number(first.estimate)} +- {number(first.sigma)}{unit}"
    words = f"{what}{size}; adding it lowers chi2 by {first.delta_chi2:.0f}"
    if left > FOUND:
        words += "; more is missing beside it: add it and diagnose again"
    if not first.confounded_with:
        return words, ""
    words += f". This survey cannot tell it from {', '.join(first.confounded_with)}"
    kinds = [kind for kind in families_of(first.effect) if set(FAMILIES[kind]) & set(first.confounded_with)]
    return words, "; ".join(ADVICE[kind] for kind in kinds) or "another lane, other speeds, or an anchor"


def unknown_words(first: Candidate, physical: Sequence[Candidate]) -> str:
    """Verdict on something unknown."""
    words = (
        f"an unknown effect acts at the {first.stage} stage: nothing in the catalogue explains what {first.effect} does"
    )
    if physical:
        words += (
            f"; nearest is {physical[0].effect}, with {100 * physical[0].delta_chi2 / first.delta_chi2:.0f} % of it"
        )
    return words


def power_words(listed: Sequence[Candidate]) -> str:
    """What could have hidden, where nothing was found."""
    blind = [c.effect for c in listed if c.verdict == "inconclusive" and not c.generic]
    if not blind:
        return "Every effect of the catalogue would have shown at a plausible size."
    return f"It could not have shown: {', '.join(blind)}."
