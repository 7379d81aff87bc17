"""Verdicts in words, for people who bury cables and people who film streets."""

from collections.abc import Iterable, Sequence

from solver.catalogue.catalogue import family, title_of
from solver.criticism.candidate import Candidate
from solver.criticism.explanations import Weighed
from solver.criticism.fault import Fault
from solver.criticism.policy import POLICY
from solver.effect import Effect
from solver.run.titles import lower
from vision.contract.rounding import with_sigma

ADVICE = {
    "blur": "passes from 30 to 70 km/h, a second lane farther away, and two classes of vehicle",
    "lag": "passes in both directions and at clearly different speeds",
    "even": "passes in both directions, and slow ones, with some seconds of quiet after each",
    "gain": "a second lane, and an anchor on either side of the place",
    "place": "three or more anchors along the fiber, and a check of the camera by points on the road",
    "depth": "one point of the fiber with known depth",
    "rigid": "two or more anchors, some tens of meters apart",
    "curve": "lanes at clearly different distances from the fiber, and a check of the camera by points on the road",
}
#: Where something shows too weakly.
MORE = "more passes, heavier vehicles, and a second lane"
#: What mends a bend that the route does not follow.
TURN = "`roadfiber turn RUN CHANNEL --out RUN-2`"


def size_words(first: Candidate) -> str:
    """How large something is."""
    unit = "" if first.unit == "1" else f" {first.unit}"
    return f"size {with_sigma(first.estimate, first.sigma)}{unit}"


def fault_words(first: Candidate, fault: Fault) -> str:
    """What is wrong with the survey itself."""
    return f"{fault.words}; {size_words(first)}; mending it lowers chi2 by {first.delta_chi2:.0f}"


def missing_words(first: Candidate, left: float) -> str:
    """Verdict on a missing effect."""
    words = f"{first.effect} is missing at the {first.stage} stage; {size_words(first)}"
    words += f"; adding it lowers chi2 by {first.delta_chi2:.0f}"
    if left > POLICY.found:
        words += "; more is missing beside it: add it and diagnose again"
    return words + twin_words(first)


def untrusted_words(first: Candidate) -> str:
    """Verdict on an effect that passes held out do not confirm."""
    words = f"{first.effect} lowers the misfit, but not that of passes held out: it is not trusted"
    return words + twin_words(first)


def twin_words(first: Candidate) -> str:
    """What an effect cannot be told from, as a sentence to follow; "" where there is nothing."""
    names = ", ".join(first.confounded_with)
    return f". This survey cannot tell it from {names}" if names else ""


def left_open(firsts: Iterable[Candidate]) -> str:
    """What a survey could not tell apart of all that verdicts named first, as a sentence; "" where nothing is left.

    What one effect could not be told from does not end with adding it: the other may be what is there.
    """
    pairs = {one.effect: one.confounded_with for one in firsts if one.confounded_with}
    if not pairs:
        return ""
    said = "; ".join(f"{called(effect)} from {', '.join(map(called, others))}" for effect, others in pairs.items())
    return f"Still open: this survey cannot tell {said}. Each of these may be there in place of the other."


def called(effect: str) -> str:
    """Title of an effect within a sentence."""
    return lower(title_of(effect))


def advice(first: Candidate, effects: Sequence[Effect]) -> str:
    """What survey would tell one of some effects from its twins; "" where it has none."""
    if not first.confounded_with:
        return ""
    kinds = [kind for kind in first.families if set(family(kind, effects)) & set(first.confounded_with)]
    return "; ".join(ADVICE[kind] for kind in kinds) or "another lane, other speeds, or an anchor"


def unknown_words(first: Candidate, physics: str, physical: Sequence[Candidate]) -> str:
    """Verdict on something unknown, by what its discrepancy model does."""
    words = (
        f"an unknown effect acts at the {first.stage} stage, as if {like(physics)} ({first.effect}); nothing in the "
        "catalogue explains as much"
    )
    if physical:
        words += (
            f"; nearest is {physical[0].effect}, with {100 * physical[0].delta_chi2 / first.delta_chi2:.0f} % of it"
        )
    return words


def impossible_words(first: Candidate, stage: str) -> str:
    """Verdict on a known effect that explains the most, but not as what it is."""
    return (
        f"{first.effect} explains the most of all known effects, but only at an impossible size "
        f"({size_words(first)}): something unknown acts, as it seems at the {stage} stage"
    )


def beside_unknown_words(known: str, first: Candidate, physics: str) -> str:
    """Verdict on something unknown of which a known effect explains a part."""
    return (
        f"{known} explains the most of all known effects, but leaves too much: something unknown acts at the "
        f"{first.stage} stage, as if {like(physics)} ({first.effect})"
    )


def negligible_words(first: Candidate, power: str) -> str:
    """Verdict on an effect that shows, at a size that does not matter."""
    return f"{first.effect} shows, but is negligible: {size_words(first)}. {power}"


def open_words(first: Candidate, among: Sequence[Weighed]) -> str:
    """Verdict where nothing known, alone or with its twins, holds enough."""
    shares = ", ".join(f"{explanation_words(one)} {100 * one.probability:.0f} %" for one in among)
    words = f"something shows: {first.effect} ({size_words(first)}) lowers chi2 by {first.delta_chi2:.0f}"
    return f"{words}, but it may be otherwise: {shares}{twin_words(first)}"


def explanation_words(one: Weighed) -> str:
    """What an explanation says is missing, in the commands' terms.

    >>> explanation_words(Weighed("unknown", ("generic_echo",), "interrogator", 0.1))
    'something unknown at the interrogator stage'
    >>> explanation_words(Weighed("unknown", ("generic_echo", "camber"), "interrogator", 0.1))
    'something unknown at the interrogator stage beside camber'
    """
    if one.kind == "unknown":
        return " beside ".join([f"something unknown at the {one.stage} stage", *one.effects[1:]])
    return " and ".join(one.effects) or "nothing"


def like(physics: str) -> str:
    """What a discrepancy model does, within a sentence.

    >>> like("Each channel mixes with the channels before and after it.")
    'each channel mixes with the channels before and after it'
    """
    return physics[0].lower() + physics[1:].rstrip(".")


def leveled_words(loud: float) -> str:
    """Verdict on a record whose gain followed the signal, which the fit takes for lighter vehicles."""
    return (
        f"an unknown effect acts at the processing stage: where vehicles are loud the noise has {100 * loud:.0f} % of "
        "the variance that it has elsewhere, as an automatic gain or a normalization leaves it; diagnose the record as "
        "it was before"
    )


def power_words(listed: Sequence[Candidate]) -> str:
    """What could have hidden, where nothing was found."""
    blind = [c.effect for c in listed if c.verdict == "inconclusive" and not c.generic]
    if not blind:
        return "Every effect of the catalogue would have shown at a plausible size."
    return f"It could not have shown: {', '.join(blind)}."
