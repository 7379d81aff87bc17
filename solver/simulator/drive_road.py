"""The road of a simulated drive, the cable beside it with its loops, and the operator's map of it."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from solver.simulator.drive_scenario import DriveScenario

Array = NDArray[np.float64]

STEP = 1.0  # m between points of the road
CORNER = 18.0  # m, radius of a street corner


@dataclass(frozen=True)
class Loop:
    """Slack in a manhole: where on the cable it begins and ends, m, and where on the cable's path, m, it lies."""

    begin: float
    end: float
    place: float


@dataclass(frozen=True)
class Road:
    """Middle of the road: points [point, 2], and unit vectors along [point, 2], every `STEP` m."""

    points: Array
    along: Array

    @property
    def length(self) -> float:
        """Of the road, m."""
        return STEP * (len(self.points) - 1)

    def at(self, place: Array, lateral: Array | float) -> Array:
        """Points [..., 2] at places along the road, m, moved to the right, m."""
        where = np.arange(len(self.points)) * STEP
        x, y = (np.interp(place, where, column) for column in self.points.T)
        tx, ty = (np.interp(place, where, column) for column in self.along.T)
        norm = np.hypot(tx, ty)
        return np.stack([x - lateral * ty / norm, y + lateral * tx / norm], -1)


def smooth(rng: np.random.Generator, size: int, scale: float) -> Array:
    """A smooth random function [size] of unit variance that changes over `scale` samples."""
    knots = np.arange(-2, size / scale + 4)
    from scipy.interpolate import CubicSpline

    values = rng.normal(size=len(knots))
    found = CubicSpline(knots * scale, values)(np.arange(size) + scale * rng.uniform())
    return np.asarray(found / max(1e-9, float(np.sqrt((found**2).mean()))) if size > 3 * scale else found)


def make_road(scenario: DriveScenario) -> Road:
    """A road that winds, and turns at street corners."""
    rng = scenario.rng("road")
    size = int(scenario.length / STEP) + 1
    heading = 0.45 * smooth(rng, size, 350.0)
    corners = int(rng.poisson(scenario.length / 1500))
    way, side = np.arange(size) * STEP, 0.0
    for place in np.sort(rng.uniform(150, scenario.length - 150, corners)):
        turn = -side if side else rng.choice([-1, 1]) * rng.uniform(0.6, 1.3)
        side += turn
        heading += turn * np.clip((way - place) / (abs(turn) * CORNER) + 0.5, 0, 1)
    along = np.stack([np.cos(heading), np.sin(heading)], -1)
    middle = (along[1:] + along[:-1]) / 2
    points = np.concatenate([np.zeros((1, 2)), np.cumsum(middle * STEP, axis=0)])
    return Road(points, along)


@dataclass(frozen=True)
class Cable:
    """A cable beside a road.

    Parameters
    ----------
    points : [node, 3], its path, m, with unit vectors `along` [node, 3]
    arc : [node], m along its path
    cable : [node], m along the cable, loops included
    loops : slack in manholes
    length : of the cable, m
    """

    points: Array
    along: Array
    arc: Array
    cable: Array
    loops: tuple[Loop, ...]
    length: float

    def arc_of(self, distance: Array) -> Array:
        """Places along the path, m, of distances along the cable, m."""
        return np.interp(distance, self.cable, self.arc)

    def at(self, distance: Array) -> Array:
        """Points [..., 3] of distances along the cable, m."""
        return np.stack([np.interp(distance, self.cable, column) for column in self.points.T], -1)

    def slack(self, distance: Array) -> NDArray[np.bool_]:
        """Whether a distance along the cable lies in a loop or in the leads at its ends."""
        found = (distance < self.cable[0]) | (distance > self.cable[-1])
        for loop in self.loops:
            found |= (distance > loop.begin) & (distance < loop.end)
        return found


def make_cable(scenario: DriveScenario, road: Road) -> Cable:
    """Lay a cable: beside the road, at times across it, with slack in manholes, longer or shorter than its path."""
    rng = scenario.rng("cable")
    size = len(road.points)
    way = np.arange(size) * STEP
    side = np.full(size, float(rng.choice([-1, 1])))
    for place in rng.uniform(0, road.length, rng.poisson(road.length / 1500)):
        side *= np.tanh((way - place) / 8.0)
    lateral = side * scenario.drawn("lateral") + 0.6 * smooth(rng, size, 120.0)
    depth = np.clip(scenario.drawn("depth") + 0.1 * smooth(rng, size, 200.0), 0.4, None)
    points = np.column_stack([road.at(np.asarray(way, float), lateral), depth])
    step = np.linalg.norm(np.diff(points, axis=0), axis=1)
    arc = np.concatenate([[0.0], np.cumsum(step)])
    along = np.gradient(points, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    stretch = 1 + scenario.length_error * rng.normal() + 0.2 * scenario.length_error * smooth(rng, size, 400.0)
    lead = rng.uniform(*scenario.lead, 2)
    cable = lead[0] + np.concatenate([[0.0], np.cumsum(step * (stretch[1:] + stretch[:-1]) / 2)])
    loops = list[Loop]()
    for place in manholes(scenario, rng, float(arc[-1])):
        extra = rng.uniform(*scenario.loop_channels) * scenario.channel_spacing
        begin = float(np.interp(place, arc, cable))
        behind = int(np.searchsorted(arc, place, side="right"))
        loops.append(Loop(begin, begin + extra, place))
        # Two nodes at one place: the cable between them is slack.
        arc = np.concatenate([arc[:behind], [place, place], arc[behind:]])
        cable = np.concatenate([cable[:behind], [begin, begin + extra], cable[behind:] + extra])
        points, along = (
            np.concatenate([one[:behind], [mean_of(one, behind)] * 2, one[behind:]]) for one in (points, along)
        )
    return Cable(points, along, arc, cable, tuple(loops), float(cable[-1] + lead[1]))


def mean_of(values: Array, index: int) -> Array:
    """Mean of the rows before and at an index."""
    return np.asarray((values[index - 1] + values[index]) / 2)


def manholes(scenario: DriveScenario, rng: np.random.Generator, length: float) -> list[float]:
    """Places of manholes along the path, m, 80 m apart at least."""
    count = rng.poisson(scenario.loops_per_km * length / 1000)
    places = np.sort(rng.uniform(60, length - 60, count))
    kept = list[float]()
    for place in places:
        if not kept or place - kept[-1] > 80:
            kept.append(float(place))
    return kept


def make_map(scenario: DriveScenario, cable: Cable) -> Array:
    """The operator's map [vertex, 2], m: few points, smoothly off by some meters."""
    rng = scenario.rng("map")
    straight = np.concatenate([[True], np.diff(cable.arc) > 0])
    points, arc = cable.points[straight, :2], cable.arc[straight]
    off = scenario.drawn("map_shift")
    shift = np.stack([smooth(rng, len(points), 400.0), smooth(rng, len(points), 400.0)], -1)
    shift = 0.5 * shift + rng.normal(size=2)
    shift *= off / np.sqrt((shift**2).sum(1).mean())
    vertices, place = [0.0], 0.0
    while place < arc[-1]:
        place += rng.uniform(*scenario.map_vertices)
        vertices.append(min(place, float(arc[-1])))
    moved = points + shift
    return np.stack([np.interp(vertices, arc, column) for column in moved.T], -1)


@dataclass(frozen=True)
class Ground:
    """Road, cable and map of a drive."""

    scenario: DriveScenario

    @cached_property
    def road(self) -> Road:
        """The road."""
        return make_road(self.scenario)

    @cached_property
    def cable(self) -> Cable:
        """The cable."""
        return make_cable(self.scenario, self.road)

    @cached_property
    def map(self) -> Array:
        """The operator's map [vertex, 2], m."""
        return make_map(self.scenario, self.cable)

    @cached_property
    def distance(self) -> Array:
        """Middle of each gauge [channel], m along the cable."""
        s = self.scenario
        first = s.gauge_length / 2
        return np.asarray(np.arange(first, self.cable.length - s.gauge_length / 2, s.channel_spacing))
