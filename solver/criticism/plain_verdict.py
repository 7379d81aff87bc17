"""A diagnosis in plain words: what the model lacks, what that does to the route, and what it may be instead."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from solver.catalogue.catalogue import FAULTS
from solver.catalogue.plain_words import rounded, told, with_unit
from solver.criticism.candidate import Candidate
from solver.effect import Effect, Setting
from solver.fit.problem import Problem
from solver.run.titles import lower
from vision.contract.rounding import at_most, with_sigma

if TYPE_CHECKING:
    from solver.criticism.finding import Diagnosis


def setting_of(problem: Problem) -> Setting:
    """What sizes depend on in a survey."""
    seen, along = problem.traffic.position[:, 0].numpy(), problem.distance
    middle, center = (seen.min() + seen.max()) / 2, (along.min() + along.max()) / 2
    return Setting(problem.gauge_length, problem.channel_spacing, float(middle), float(center))


def spoken(listed: Sequence[Candidate], problem: Problem, effects: Sequence[Effect]) -> tuple[Candidate, ...]:
    """Candidates with what people are told of each."""
    setting, known = setting_of(problem), {one.name: one for one in effects} | FAULTS

    def one(c: Candidate) -> Candidate:
        effect = known[c.effect]
        # A score tells the change from null, a full fit the number itself.
        null = effect.amplitudes[0].null if isinstance(effect, Effect) and not c.refitted and c.numbers else 0.0
        said = told(
            effect,
            setting,
            estimate=null + c.estimate,
            sigma=c.sigma,
            detectable=c.detectable_size,
            shape=c.shape,
            unit=c.unit,
        )
        return replace(c, told=said)

    return tuple(map(one, listed))


def titles(names: Sequence[str], listed: Sequence[Candidate], last: str = "or") -> str:
    """Titles of effects, within a sentence; the word before the last of several."""
    known = {c.effect: c.title for c in listed}
    said = [lower(known.get(name, name)) for name in names]
    return said[0] if len(said) == 1 else f"{', '.join(said[:-1])} {last} {said[-1]}"


def headline(diagnosis: "Diagnosis") -> str:
    """The verdict in a sentence."""
    listed = diagnosis.candidates
    first = listed[0] if listed else None
    if diagnosis.bend:
        return f"{diagnosis.bend[0].upper()}{diagnosis.bend[1:]}; nothing else is missing that this survey could show."
    if diagnosis.verdict == "adequate" and first is not None and first.shows_small and first.told:
        small = f"{first.title} shows, too small to matter: {lower(first.told.sentence)}"
        return f"{small} Nothing else is missing that shows."
    if diagnosis.verdict == "adequate":
        return "Nothing is missing that this survey could show."
    if first is None or first.told is None:
        return diagnosis.words
    if diagnosis.verdict == "missing-effect":
        return f"{first.title}. {first.told.sentence}"
    if diagnosis.verdict == "unknown-effect":
        return f"Something acts that the catalogue does not know, at the {first.stage} stage."
    return "This survey cannot say what is missing."


def details(diagnosis: "Diagnosis") -> list[str]:
    """What else must be known of the verdict, a sentence each."""
    listed = diagnosis.candidates
    if not listed or listed[0].told is None or diagnosis.verdict == "adequate":
        return []
    first, lines = listed[0], list[str]()
    if diagnosis.verdict == "unknown-effect":
        lines.append(f"What is left looks as if this were so: {first.told.sentence if first.told else ''}")
    if diagnosis.verdict != "inconclusive" and first.route_change is not None:
        lines.append(f"Ignored, it moves the route by {at_most(first.route_change)}.")
    # Where a fit found more than the score test could promise, the promise says nothing.
    shown = first.told is not None and first.told.detectable <= abs(first.told.size)
    if diagnosis.verdict == "missing-effect" and shown and (least := least_words(first)):
        lines.append(f"This survey would have shown it from {least} on.")
    if first.confounded_with:
        other = titles(first.confounded_with, listed)
        lines.append(f"The survey cannot tell it from {other}: each of these may be there in its place.")
    return lines


def size_words(c: Candidate) -> str:
    """Size and standard deviation, in a unit that people know."""
    if c.told is None or not np.isfinite(c.told.sigma):
        return "-"
    return with_unit(with_sigma(c.told.size, c.told.sigma), c.told.unit)


def least_words(c: Candidate) -> str:
    """Smallest size that would have shown; "" where none would."""
    if c.told is None or not np.isfinite(c.told.detectable):
        return ""
    return with_unit(rounded(c.told.detectable, c.told.detectable / 10, 2), c.told.unit)


def hidden_change(c: Candidate) -> float | None:
    """Largest way, m, that the route would move with the smallest size that would have shown; None if not known."""
    away = abs(c.estimate)
    if c.route_change is None or c.refitted or not away or not np.isfinite(c.detectable_size):
        return None
    return c.route_change * c.detectable_size / away
