"""The Cramer-Rao limit of a simulated street: how well any estimator could place its fiber.

The route is free across and in depth, on cubic splines with a knot every `KNOTS` m and a prior of `PRIOR` m, and keeps
its length. Besides are not known: each vehicle's load, the mean and the speed of its track (as well as its fixes tell
them), its wheelbase and its weight's share in front (as its class has them), and Poisson's ratio. Noise counts as
white, ground and everything else as known. Derivatives are differences of the simulator's own strain.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from solver.simulator import Scenario, Survey
from solver.simulator.axle_forces import contact
from solver.simulator.elastic import extension, gauge_nodes, gauge_weights
from solver.simulator.fiber_motion import arc_of
from solver.simulator.strain import PANEL
from solver.simulator.vehicle import FLEET, Vehicle

Array = NDArray[np.float64]
#: m between knots, m of the prior on a route's coefficients, sd of Poisson's ratio.
KNOTS, PRIOR, RATIO = 2.0, 3.0, 0.03
#: Numbers of each vehicle.
OWN = 6
#: Steps of the differences, m, rad or 1, and s; and m above which no ground stretches a fiber.
STEP, LAG, SHALLOWEST = 1e-3, 0.01, 0.05


@dataclass(frozen=True)
class Frame:
    """Places [n] along a fiber: points, tangents, ways across and down, [n, 3]; curvature across and down [n], 1/m."""

    point: Array
    tangent: Array
    across: Array
    down: Array
    curved: tuple[Array, Array]

    @classmethod
    def at(cls, survey: Survey, arc: Array) -> "Frame":
        """At distances [n] along the route, m."""
        tangent = survey.fiber.tangent(arc)
        across = np.cross([0.0, 0.0, 1.0], tangent) + 1e-9 * np.array([0.0, 1.0, 0.0])
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        down = np.cross(tangent, across)
        turning = (survey.fiber.tangent(arc + 0.01) - survey.fiber.tangent(arc - 0.01)) / 0.02
        return cls(
            survey.fiber.position(arc), tangent, across, down, ((turning * across).sum(1), (turning * down).sum(1))
        )


@dataclass(frozen=True)
class Basis:
    """Routes near a fiber's: cubic splines of the way across, then of that down, and a shift of all along.

    A fiber that moves outward in a bend is drawn along by what the bend takes up.
    """

    survey: Survey
    first: float
    last: float

    def at(self, arc: Array) -> tuple[Array, Array]:
        """Ways [n, 3 (across, down, along), number] at distances [n], m; and slopes [n, 2, number]."""
        count = max(1, round((self.last - self.first) / KNOTS))
        knots = self.first + (self.last - self.first) / count * np.arange(-3, count + 4)
        spline = BSpline(knots, np.eye(count + 3), 3)
        fine = np.arange(self.first, self.last, 0.02)
        frame, value = Frame.at(self.survey, fine), spline(fine)
        ways, slopes = np.zeros((len(arc), 3, 2 * count + 7)), np.zeros((len(arc), 2, 2 * count + 7))
        for way in (0, 1):
            mine = slice(way * (count + 3), (way + 1) * (count + 3))
            ways[:, way, mine], slopes[:, way, mine] = spline(arc), spline(arc, nu=1)
            drawn = np.cumsum(frame.curved[way][:, None] * value, axis=0) * 0.02
            where = np.searchsorted(fine, arc).clip(0, len(fine) - 1)
            ways[:, 2, mine] = drawn[where]
        ways[:, 2, -1] = 1.0
        return ways, slopes


@dataclass(frozen=True)
class Strain:
    """What stretches the fiber at its nodes [node], and how that changes with where it lies.

    Parameters
    ----------
    scenario : with nothing hidden
    frame : of the nodes
    """

    scenario: Scenario
    frame: Frame

    def rate(self, vehicle: Vehicle, time: Array, moved: Any = 0.0, turned: Any = 0.0, ratio: float = 0.0) -> Array:
        """Rate of extension [time, node], 1/s, of a fiber moved, m, and turned, rad, [node, 3]; `ratio` is added."""
        x, y, z = (self.frame.point + moved).T
        tangent = self.frame.tangent + turned
        tangent = (tangent / np.linalg.norm(tangent, axis=1, keepdims=True)).T
        ratio = self.scenario.poisson_ratio + ratio

        def at(time: Array) -> Array:
            place, force = contact(self.scenario, vehicle, time)
            wheels = range(place.shape[1])
            offsets = ((x - place[:, w, :1], y - place[:, w, 1:], np.maximum(z, SHALLOWEST)) for w in wheels)
            every = zip(wheels, offsets, strict=True)
            return np.asarray(sum(force[:, w, 2:] * extension(offset, tangent, ratio) for w, offset in every))

        return (at(time + LAG) - at(time - LAG)) / (2 * LAG) / (4 * np.pi * self.scenario.shear_modulus)

    def route(self, vehicle: Vehicle, time: Array, ways: Array, slopes: Array) -> Iterator[Array]:
        """Derivatives [time, node] by the numbers of a basis with those `ways` and `slopes`."""
        frame = self.frame
        moves = [self.by(vehicle, time, "moved", way) for way in (frame.across, frame.down, frame.tangent)]
        turns = [self.by(vehicle, time, "turned", way) for way in (frame.across, frame.down)]
        # To go along the fiber is to turn with it.
        moves[2] = moves[2] + turns[0] * frame.curved[0] + turns[1] * frame.curved[1]
        for way, slope in zip(np.moveaxis(ways, 2, 0), np.moveaxis(slopes, 2, 0), strict=True):
            parts = [*zip(moves, way.T, strict=True), *zip(turns, slope.T, strict=True)]
            yield np.asarray(sum(field * share for field, share in parts if share.any()))

    def others(self, vehicle: Vehicle, time: Array) -> Iterator[Array]:
        """Derivatives [time, node] by Poisson's ratio and the `OWN` numbers of a vehicle."""
        yield self.by(vehicle, time, "ratio", 1.0)
        yield self.rate(vehicle, time)
        # To move a vehicle is to move the fiber the other way, which has the same square.
        along, aside = (self.by(vehicle, time, "moved", np.array(way)) for way in ((1.0, 0, 0), (0, 1.0, 0)))
        yield along
        yield aside
        yield along * ((time - time.mean()) / (time[-1] - time[0]))[:, None]
        for name in ("wheelbase", "front_share"):
            ends = (replace(vehicle, **{name: getattr(vehicle, name) + step}) for step in (STEP, -STEP))
            more, less = (self.rate(one, time) for one in ends)
            yield (more - less) / (2 * STEP)

    def by(self, vehicle: Vehicle, time: Array, what: str, way: Any) -> Array:
        """Derivative of the rate by an argument of it, in some direction."""
        more, less = (self.rate(vehicle, time, **{what: step * way}) for step in (STEP, -STEP))
        return (more - less) / (2 * STEP)


def sds(scenario: Scenario, vehicle: Vehicle, seconds: float) -> list[float]:
    """What is known of a vehicle's `OWN` numbers: load (relative), track along, aside and its speed, m, and wheels."""
    make, fixes = FLEET[vehicle.vehicle_class], scenario.fix_sigma / np.sqrt(seconds * scenario.frame_rate)
    return [1.0, fixes, fixes, fixes * np.sqrt(12), make.wheelbase[1], make.front_share[1]]


def limit(survey: Survey) -> tuple[NDArray[np.int64], Array, Array]:
    """Channels in view and under the ground, and the least sds [channel] across and in depth, m."""
    scenario = replace(survey.scenario, effects={})
    channel = np.arange(survey.active[0], survey.active[1] + 1)
    channel = channel[survey.route[channel, 2] > 0]
    arc = arc_of(survey.scenario, survey.distance, survey.distance)[channel]
    reach = scenario.gauge_length / 2 + 1.0
    span = (float(arc.min() - reach), float(arc.max() + reach), PANEL)
    nodes = gauge_nodes(*span)
    basis, strain = Basis(survey, *span[:2]), Strain(scenario, Frame.at(survey, nodes))
    average = (gauge_weights(arc, scenario.gauge_length, *span) * (strain.frame.point[:, 2] > SHALLOWEST)).T
    ways, slopes = basis.at(nodes)
    shared = ways.shape[2] + 1
    known = [PRIOR] * (shared - 1) + [RATIO]
    information = np.zeros((shared + OWN * len(survey.vehicles),) * 2)
    for number, vehicle in enumerate(survey.vehicles):
        begin, end = vehicle.times_within(*scenario.view, 0.05)
        known += sds(scenario, vehicle, end - begin)
        time = survey.time[(survey.time >= begin) & (survey.time <= end)]
        fields = chain(strain.route(vehicle, time, ways, slopes), strain.others(vehicle, time))
        jacobian = np.stack([(field @ average).ravel() for field in fields], axis=1) / survey.noise_sd
        where = np.r_[:shared, shared + OWN * number : shared + OWN * (number + 1)]
        information[np.ix_(where, where)] += jacobian.T @ jacobian
    information += np.diag(np.array(known) ** -2.0)
    here = basis.at(arc)[0]
    anchors = here[np.isin(channel, survey.anchors["channel"])].reshape(-1, shared - 1)
    information[: shared - 1, : shared - 1] += anchors.T @ anchors / max(scenario.anchor_sigma, STEP) ** 2
    covariance = np.linalg.inv(information)[: shared - 1, : shared - 1]
    across, depth = (np.sqrt(np.einsum("ck,kl,cl->c", one, covariance, one)) for one in (here[:, 0], here[:, 1]))
    return channel, across, depth
