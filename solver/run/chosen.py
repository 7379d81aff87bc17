"""Which of many passes a run was fitted to, as fit.json keeps it and as people read it."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

if TYPE_CHECKING:
    from solver.fit.choice import Choice

#: Expected fall of a sigma below which a pass more of a kind is not worth naming.
TELLING = 0.03
#: What is told -> how a sentence calls it.
LABELS = {"route": "the route", "depth": "the depth", "ground": "Poisson's ratio"}


def narrower(falls: ArrayLike, names: Sequence[str]) -> dict[str, float]:
    """By how much each sigma falls, as shares, from falls of ln variance.

    >>> narrower([0.0, 2 * np.log(2)], ["route", "depth"])
    {'route': 0.0, 'depth': 0.5}
    """
    return {name: round(float(1 - np.exp(-fall / 2)), 4) for name, fall in zip(names, np.asarray(falls), strict=True)}


def choice_facts(choice: "Choice", tested: int) -> dict[str, Any]:
    """What fit.json says of a choice; `tested` passes are held out as a test."""
    return {
        "of": len(choice.passes),
        "tested": tested,
        "taken": [
            {
                "track_id": choice.passes[one.number].track_id,
                "vehicle_class": choice.passes[one.number].vehicle_class,
                "speed": float(choice.passes[one.number].speed),
                "lane": float(choice.passes[one.number].position[:, 1].mean()),
                "narrower": narrower(one.falls, choice.names),
            }
            for one in choice.taken
        ],
        "missing": [{"kind": words, "narrower": narrower(falls, choice.names)} for words, falls in choice.missing],
    }


def choice_line(facts: Mapping[str, Any]) -> str:
    """A choice in a line.

    >>> taken = [{"speed": 9.0}, {"speed": -8.0}]
    >>> missing = [{"kind": "toward -x", "narrower": {"route": 0.02, "depth": 0.12}}]
    >>> choice_line({"of": 80, "tested": 40, "taken": taken, "missing": missing})
    'of 80 passes the 2 that tell most were fitted (1 toward +x, 1 toward -x), 40 others test the route; --all-passes \
fits all; still missing: a pass toward -x, which would narrow the sigma of the depth by 12 %'
    """
    ways = [sum((one["speed"] > 0) is way for one in facts["taken"]) for way in (True, False)]
    line = (
        f"of {facts['of']} passes the {len(facts['taken'])} that tell most were fitted ({ways[0]} toward +x, "
        f"{ways[1]} toward -x), {facts['tested']} others test the route; --all-passes fits all"
    )
    if not facts["missing"]:
        return line
    best = facts["missing"][0]
    name, share = max(best["narrower"].items(), key=lambda item: float(item[1]))
    if share < TELLING:
        return f"{line}; no kind of pass that is missing would tell much more"
    gain = f"would narrow the sigma of {LABELS[name]} by {100 * share:.0f} %"
    return f"{line}; still missing: a pass {best['kind']}, which {gain}"
