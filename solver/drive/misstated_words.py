"""What may be stated wrongly of a drive, in words, as a check, and as facts."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from solver.drive.misstated import DRIFT, GAUGE, TOLD, Misstated
from solver.run.trust import Gate
from vision.contract.rounding import with_sigma


def words_of(one: Misstated, stated: Mapping[str, float]) -> str:
    """What a drive says of one of them, in a sentence or two.

    Parameters
    ----------
    stated : gauge length and channel spacing as files have them, m, by the name of the effect

    >>> print(words_of(Misstated("gauge_length", 0.25, 0.05, 0.2, 0.999), {"gauge_length": 10.0}))
    The interrogator averages strain over 12.50 ± 0.50 m, not over 10 m.
    >>> print(words_of(Misstated("clock_drift", 1e-4, 3e-4, 0.002, 0.04), {}))
    The record's clock gains 0.4 ± 1.1 s an hour on the GPS's. A drift of 7.2 s an hour would show.
    """
    told = one.named or one.fitted
    if one.effect == DRIFT:
        found = f"The record's clock gains {with_sigma(3600 * one.value, 3600 * one.sigma)} s an hour on the GPS's."
        return found if told else f"{found} A drift of {3600 * one.shows:.2g} s an hour would show."
    size = f"{with_sigma(stated[one.effect] * (1 + one.value), stated[one.effect] * one.sigma)} m"
    shows = f"An error of {stated[one.effect] * one.shows:.2g} m would show."
    if one.effect == GAUGE:
        found, beside = f"The interrogator averages strain over {size}", f"over {stated[one.effect]:g} m"
    else:
        found = f"Channels lie {size} apart along the cable, or length_factor is off by as much"
        beside = f"{stated[one.effect]:g} m apart"
    return f"{found}, not {beside}." if told else f"{found}; {beside} is stated. {shows}"


def facts_of(found: Sequence[Misstated], stated: Mapping[str, float]) -> list[dict[str, Any]]:
    """`misstated` of fit.json."""
    return [
        asdict(one)
        | {
            "title": TOLD[one.effect].title,
            "probability": None if one.fitted else one.probability,
            "words": words_of(one, stated),
        }
        for one in found
    ]


def as_stated(found: Sequence[Misstated], stated: Mapping[str, float]) -> Gate:
    """Whether gauge length, channel spacing and clock are as files state them."""
    wrong = [one for one in found if one.named]
    if not wrong:
        return Gate("stated", "passed", "nothing shows that gauge length, channel spacing or clock are not as stated")
    names = ",".join([one.effect for one in found if one.fitted] + [one.effect for one in wrong])
    words = " ".join(words_of(one, stated) for one in wrong).rstrip(".")
    return Gate(
        "stated",
        "failed",
        words[0].lower() + words[1:],
        (f"locate again with `--effects {names}`, which fits that",),
        found=float(len(wrong)),
        expected=0.0,
    )
