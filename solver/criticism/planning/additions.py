"""What to add to a planned survey: passes and anchors, by how much each is expected to lower the variance.

Information adds up: that of a pass with its own numbers eliminated, and that of an anchor, are added to the precision
of the plan, and the best are taken one by one (Krause, Singh and Guestrin 2008, J. Mach. Learn. Res. 9, 235).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from solver.fit.choice import EVERY, Informed
from solver.fit.map_fit import MapFit
from solver.fit.parameter_layout import AXES
from solver.fit.posterior import Posterior
from solver.survey.plan_section import LaneSection

if TYPE_CHECKING:
    from solver.criticism.planning.planned import Planned

Array = NDArray[np.float64]

#: Additions of one way at most.
MOST = 12
#: m between the places where an anchor may be.
APART = 5.0
#: How an anchor is told.
NEAR = "an anchor near x = "
#: Mean ln variance that an addition must take away to be worth a line.
WORTH = 1e-3


@dataclass(frozen=True)
class Sigmas:
    """Expected standard deviations along the fiber.

    Parameters
    ----------
    across, depth : largest in view, m
    """

    across: float
    depth: float


@dataclass(frozen=True)
class Addition:
    """Something to add.

    Parameters
    ----------
    kind : "pass" or "anchor"
    words : what, where
    after : sigmas once it is there, beside all that was added before
    """

    kind: str
    words: str
    after: Sigmas


@dataclass(frozen=True)
class Way:
    """Additions, one after the other, until the wanted accuracy is reached or nothing helps any more.

    Parameters
    ----------
    kind : "passes", "anchors" or "both"
    additions : in order
    reached : whether the wanted accuracy is
    """

    kind: str
    additions: tuple[Addition, ...]
    reached: bool


@dataclass(frozen=True)
class Option:
    """A pass or an anchor that could be added, and its information [shared, shared]."""

    kind: str
    words: str
    information: Array


@dataclass(frozen=True)
class Known:
    """What a plan knows of the fiber.

    Parameters
    ----------
    covariance : [shared, shared], of what all vehicles share
    across, depth : [place, shared], the places in view
    """

    covariance: Array
    across: Array
    depth: Array

    @classmethod
    def of(cls, planned: "Planned", posterior: Posterior) -> "Known":
        """What the planned survey knows."""
        size = len(posterior.visit.normal.right)
        covariance = posterior.columns(np.arange(size))
        problem, basis = planned.problem, posterior.chain.basis
        step = max(1, round(EVERY / problem.channel_spacing))
        at = basis.at(problem.distance[::step])
        every = np.zeros((AXES, len(at), size))
        for axis in range(AXES):
            every[axis][:, axis : AXES * basis.size : AXES] = at
        return cls((covariance + covariance.T) / 2, every[1], every[2])

    def variances(self, covariance: Array) -> tuple[Array, Array]:
        """Variances [..., place] across and in depth, m^2, by covariances [..., shared, shared]."""
        across, depth = (np.einsum("pi,...ij,pj->...p", one, covariance, one) for one in (self.across, self.depth))
        return across, depth

    def with_more(self, information: Array) -> "Known":
        """The same with more information [shared, shared]."""
        more = np.linalg.inv(np.linalg.inv(self.covariance) + information)
        return Known((more + more.T) / 2, self.across, self.depth)

    @property
    def sigmas(self) -> Sigmas:
        """Largest in view."""
        across, depth = self.variances(self.covariance)
        return Sigmas(float(np.sqrt(across.max())), float(np.sqrt(depth.max())))


def pass_options(planned: "Planned") -> list[Option]:
    """One more pass of each class that the plan names, in each lane, at the middle speed."""
    plan, found = planned.site.plan, []
    classes = dict.fromkeys(name for lane in plan.lanes for name in lane.vehicles)
    speed = sum(plan.speeds) / 2 / 3.6
    for lane in plan.lanes:
        for name in classes:
            problem, state = planned.alone(name, lane, speed)
            told = Informed.of(MapFit(problem, basis=planned.problem.basis), state)
            shared = told.chain.size + len(told.chain.border)
            words = f"one pass of a {name} in the {lane_words(plan.lanes, lane, plan.offset)}"
            found.append(Option("pass", words, told.matrix[:shared, :shared]))
    return found


def lane_words(lanes: Sequence[LaneSection], lane: LaneSection, offset: float) -> str:
    """A lane in words.

    >>> two = [LaneSection(y=0.0, toward="+x"), LaneSection(y=-3.5, toward="-x")]
    >>> lane_words(two, two[1], 4.0)
    'far lane (y -3.5 m, toward -x)'
    """
    distances = sorted({abs(one.y - offset) for one in lanes})
    rank = {0: "near lane", len(distances) - 1: "far lane"} if len(distances) > 1 else {}
    name = rank.get(distances.index(abs(lane.y - offset)), "lane")
    return f"{name} (y {lane.y:g} m, toward {lane.toward})"


def anchor_options(planned: "Planned", known: Known) -> list[Option]:
    """One more anchor every few meters of the view."""
    problem, size = planned.problem, len(known.covariance)
    sigma, found = planned.site.plan.anchor_sigma, []
    for x in np.arange(0.0, planned.site.plan.length + 1e-9, APART):
        at = problem.basis.at(np.array([x]))
        rows = np.zeros((AXES, size))
        for axis in range(AXES):
            rows[axis, axis : AXES * problem.basis.size : AXES] = at[0]
        found.append(Option("anchor", f"{NEAR}{x:.0f} m", rows.T @ rows / sigma**2))
    return found


def beyond(known: Known, covariance: Array, wanted: Sigmas) -> Array:
    """Mean ln variance [...] that is beyond what is wanted, by covariances [..., shared, shared]; 0 where it is met."""
    parts = [
        np.maximum(np.log(variance / limit**2), 0.0) if np.isfinite(limit) else np.zeros_like(variance)
        for variance, limit in zip(known.variances(covariance), (wanted.across, wanted.depth), strict=True)
    ]
    return np.asarray(np.concatenate(parts, -1).mean(-1))


def way_to(kind: str, known: Known, options: Sequence[Option], wanted: Sigmas) -> Way:
    """Add the best option, again and again, until the wanted accuracy is reached."""
    added, left = list[Addition](), list(options)
    missing = float(beyond(known, known.covariance, wanted))
    while missing > 0 and left and len(added) < MOST:
        ends = [known.with_more(one.information) for one in left]
        after = beyond(known, np.stack([one.covariance for one in ends]), wanted)
        best = int(after.argmin())
        if missing - after[best] < WORTH * missing:
            break
        known, missing = ends[best], float(after[best])
        added.append(Addition(left[best].kind, left[best].words, known.sigmas))
        if left[best].kind == "anchor":  # a second one at the same place is no manhole
            left.pop(best)
    return Way(kind, tuple(added), missing == 0)


def ways(known: Known, passes: Sequence[Option], anchors: Sequence[Option], wanted: Sigmas) -> list[Way]:
    """By passes alone, by anchors alone, and by both where neither reaches what is wanted."""
    found = [way_to("passes", known, passes, wanted), way_to("anchors", known, anchors, wanted)]
    if not any(one.reached for one in found):
        found.append(way_to("both", known, [*passes, *anchors], wanted))
    return found


def single(known: Known, options: Sequence[Option]) -> list[Addition]:
    """What each option would do by itself, the one that narrows most first."""
    before = np.concatenate(known.variances(known.covariance))
    found = []
    for one in options:
        after = known.with_more(one.information)
        fall = float(np.log(before / np.concatenate(known.variances(after.covariance))).mean())
        found.append((fall, Addition(one.kind, one.words, after.sigmas)))
    return [addition for _, addition in sorted(found, key=lambda pair: -pair[0])]
