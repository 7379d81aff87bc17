"""One model on the error ladder."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from vision.contract.rounding import at_most

#: Rows of channel number, x, y, z (m).
Route = tuple[tuple[float, float, float, float], ...]


@dataclass(frozen=True)
class Glimpse:
    """What of a rung is drawn on the rungs above it.

    Parameters
    ----------
    track : of the pass whose residual it is; "" where there is none
    residual : [row][column], coarse, in noise sigmas; None where nothing was measured
    anchors : name, way from the route, m, and the same in its sigmas, of each anchor
    """

    track: str
    residual: tuple[tuple[float | None, ...], ...]
    anchors: tuple[tuple[str, float, float], ...]


@dataclass(frozen=True)
class Rung:
    """One model on the error ladder.

    Parameters
    ----------
    effects : in the model
    chi2_per_dof, held_out_chi2_per_dof, noise_floor : misfit of the fit, of passes it has not seen, and of noise alone
    route_change : largest way that the route moved from the rung before, m
    route_change_from_first : and from the first rung, m
    folder : of its run: a label, nothing is read there; None where it was not kept
    route : channel number and x, y, z, m, of every channel that is constrained
    words : what must be said of it first; nothing where the route is better founded than that of the rung before
    glimpse : what is drawn of it; None where its ladder was written before there were any
    """

    effects: tuple[str, ...]
    chi2_per_dof: float
    held_out_chi2_per_dof: float | None
    noise_floor: float | None
    route_change: float
    route_change_from_first: float
    folder: Path | None
    route: Route
    words: tuple[str, ...] = ()
    glimpse: Glimpse | None = None

    @property
    def moved(self) -> str:
        """How far the route moved from the rung before; unknown where no place is decided in both."""
        return "unknown" if math.isnan(self.route_change) else f"{self.route_change:.2f} m"


def route_moved(length: float) -> str:
    """How far a route moved from model to model, m, within a sentence.

    >>> route_moved(0.123), route_moved(float("nan"))
    ('the route moved by up to 0.12 m', 'how far the route moved is not known: no place is decided in both models')
    """
    if math.isnan(length):
        return "how far the route moved is not known: no place is decided in both models"
    return f"the route moved by {at_most(length)}"


def rung_names(rungs: Sequence[Rung], title: Callable[[str], str]) -> list[str]:
    """What each rung has that the one below has not.

    Parameters
    ----------
    rungs : lowest first
    title : of an effect, by its name
    """
    added = [[title(n) for n in after.effects if n not in before.effects] for before, after in pairwise(rungs)]
    first = ", ".join(map(title, rungs[0].effects))
    return [
        f"Start: {first}" if first else "Start",
        *(f"+ {', '.join(names)}" if names else "again" for names in added),
    ]
