"""The 95 % corridor of a run: the fit's own, which takes its model for granted, and with what the model may lack."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from solver.fit.result import FitResult, Placed
from solver.run.geojson import half_width

if TYPE_CHECKING:
    from solver.run.run import Run

Array = NDArray[np.float64]

#: Why a corridor is the fit's own where nobody asked for more.
NOT_LOOKED = "what it may lack was not looked at"
#: By how much a corridor must be wider than the fit's own for it to be said what widens it.
NOTED = 1.1
#: Name and title of what widens a corridor where parts of the record disagree about the route.
DISAGREEMENT, DISAGREE = "disagreement", "How far vehicles disagree about the route"
#: What is added where the route bends more sharply than it was fitted.
BENDS, BEND = "bends", "Bends of the fiber that were not followed"
#: Probability from which an explanation is told of.
TOLD = 0.05


def placed(result: FitResult, added: Array | None, grade: str = "good", trust: str = "", left_out: str = "") -> Placed:
    """The route of a fit with the covariance of its corridor.

    Parameters
    ----------
    result : of the fit
    added : [channel, 3, 3], m^2, for what its model may lack; None where nothing is added
    grade, trust : of the run's checks
    left_out : what the corridor leaves out, in a sentence
    """
    own = result.covariance
    whole = own if added is None else own + added
    place = result.channel, result.distance, result.route, whole, result.constrained, own
    return Placed(*place, grade, trust, left_out, result.corners)


def median_half(place: FitResult | Placed) -> float:
    """Half the width of the 95 % corridor, m: the median over channels that data decide, over all where there are none.

    NaN where no sigma is known.
    """
    half = half_width(place.route, place.covariance)
    known = half[place.constrained] if place.constrained.any() else half
    return float(np.median(known)) if np.isfinite(known).all() else float("nan")


def corridor_facts(
    result: FitResult,
    added: Array | None = None,
    *,
    why: str = "",
    widest: str = "",
    title: str = "",
    share: float = 0.0,
    narrower: str = "",
    explanations: Sequence[Mapping[str, Any]] = (),
) -> dict[str, Any]:
    """What fit.json says of the corridor.

    Parameters
    ----------
    result : of the fit
    added : [channel, 3, 3], m^2, for what its model may lack; None where the corridor is the fit's own
    why : what the model may lack is left out, as a clause; where something is added, it is what vehicles disagree about
    widest, title, share : what adds most, its title in plain words, its share of what is added
    narrower : what would narrow it, with commands between backticks
    explanations : title, kind, effects, stage and probability of each, most probable first
    """
    # Sigmas of a fit that has not ended say nothing.
    whole, own = (median_half(one) if result.converged else np.nan for one in (placed(result, added), result))
    return {
        "full": added is not None,
        "why": why or (NOT_LOOKED if added is None else ""),
        "half_width": whole,
        "half_width_fit": own,
        "widest": widest,
        "title": title,
        "share": share,
        "narrower": narrower,
        "explanations": list(explanations),
    }


def corridor_sentence(facts: Mapping[str, Any]) -> str:
    """How wide the corridor is, what widens it, and what would narrow it; "" where no sigma is known.

    Parameters
    ----------
    facts : as `corridor_facts` has them, NaN or None for what is not known

    >>> facts = {"full": True, "why": "", "half_width": 0.3, "half_width_fit": 0.1, "widest": "gauge_length",
    ...          "title": "gauge length", "share": 0.8, "narrower": "two lanes", "explanations": []}
    >>> corridor_sentence(facts)
    '95 % corridor: 0.30 m to either side (median) with what the model may lack, 0.10 m if it lacks nothing. It is \
widened most by gauge length (80 % of what is added); two lanes would narrow it.'
    >>> corridor_sentence(facts | {"why": "the noise is not understood: it is correlated in time"})
    '95 % corridor: 0.30 m to either side (median) with what vehicles disagree about, 0.10 m if the model lacks \
nothing. The noise is not understood: it is correlated in time.'
    >>> corridor_sentence(facts | {"full": False, "why": "what it may lack was not looked at"})
    '95 % corridor: 0.10 m to either side (median) if the model lacks nothing; what it may lack was not looked at.'
    """
    own, whole = facts["half_width_fit"], facts["half_width"]
    if own is None or not np.isfinite(own):
        return ""
    if not facts["full"]:
        return f"95 % corridor: {own:.2f} m to either side (median) if the model lacks nothing; {facts['why']}."
    said = f"95 % corridor: {whole:.2f} m to either side (median) with what "
    if facts["why"]:
        said += f"vehicles disagree about, {own:.2f} m if the model lacks nothing."
        return f"{said} {facts['why'][:1].upper()}{facts['why'][1:]}."
    said += f"the model may lack, {own:.2f} m if it lacks nothing."
    if whole < NOTED * own or not facts["title"]:
        return said
    said += f" It is widened most by {facts['title']} ({100 * facts['share']:.0f} % of what is added)"
    return f"{said}; {facts['narrower']} would narrow it." if facts["narrower"] else f"{said}."


def probable(facts: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Explanations that are told of, most probable first."""
    return [one for one in facts["explanations"] if one["probability"] >= TOLD]


def lacking(runs: Sequence["Run"], channel: NDArray[np.int64]) -> Array:
    """Covariance [channel, 3, 3], m^2, for what the models of runs of one fiber may lack.

    What all of them lack moves all of them alike, and does not average out: the mean of theirs, by their precision.
    """
    total, weights = np.zeros((len(channel), 3, 3)), np.zeros(len(channel))
    for run in runs:
        there = np.isin(channel, run.result.channel)
        at = np.searchsorted(run.result.channel, channel[there])
        weight = 1 / np.trace(run.result.covariance[at], axis1=1, axis2=2)
        weights[there] += weight
        if run.added is not None:
            total[there] += weight[:, None, None] * run.added[at]
    return total / np.maximum(weights, 1e-300)[:, None, None]
