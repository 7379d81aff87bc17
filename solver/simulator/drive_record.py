"""The record of a simulated drive: strain rate under the car and the traffic, noise, dead channels."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solver.simulator.drive_road import Cable, Ground
from solver.simulator.drive_scenario import DriveScenario
from solver.simulator.drive_traffic import Motion, car_motion, other_motions
from solver.simulator.elastic import extension
from solver.simulator.recorded_noise import Color, noise

Array = NDArray[np.float64]

REACH = 70.0  # m from a vehicle where its strain is computed
NODE = 1.0  # m between the points of the cable that are strained
SOME = 48  # channels at once
HEARD = 30.0  # m from the car, within which the signal is compared with the noise
OWN = Color(common_share=0.0)


@cache
def strain_under() -> Any:
    """`strain[time, node] +=` what one vehicle does to points of the cable; in machine code."""
    from numba import njit

    point = njit(extension)

    @njit(nogil=True)
    def under(strain, nodes, along, live, axles, shares, ratio, reach):  # type: ignore[no-untyped-def]
        for row in range(axles.shape[0]):
            for node in range(nodes.shape[0]):
                if not live[node]:
                    continue
                total = 0.0
                for axle in range(axles.shape[1]):
                    x = nodes[node, 0] - axles[row, axle, 0]
                    y = nodes[node, 1] - axles[row, axle, 1]
                    if x * x + y * y < reach * reach:
                        tangent = (along[node, 0], along[node, 1], along[node, 2])
                        total += shares[axle] * point((x, y, nodes[node, 2]), tangent, ratio)
                strain[row, node] += total

    return under


@dataclass(frozen=True)
class Block:
    """Some channels of a record: strain rate [time, channel] of the car and of the other traffic, 1/s."""

    channels: slice
    car: Array
    others: Array


def blocks(ground: Ground, car: Motion, others: Sequence[Motion], time: Array) -> Iterator[Block]:
    """Strain rate of all channels, some at a time.

    Strain is computed at the edges of samples and differenced, as interrogators difference phase.
    """
    step = float(time[1] - time[0])
    edges = time[0] + step * (np.arange(len(time) + 1) - 0.5)
    beside = axles_at(car, edges)
    placed = [passing(one, edges) for one in others]
    for first in range(0, len(ground.distance), SOME):
        channels = slice(first, min(first + SOME, len(ground.distance)))
        part = Gauges(ground.scenario, ground.cable, ground.distance[channels])
        mine = np.diff(part.strain(car, beside), axis=0) / step
        theirs = np.zeros_like(mine)
        for one in placed:
            part.add(theirs, one, step)
        yield Block(channels, mine, theirs)


@dataclass(frozen=True)
class Passing:
    """Another vehicle: its motion, the first edge of samples when it is there, its axles from then on [time, 2, 2]."""

    motion: Motion
    first: int
    axles: Array


def passing(motion: Motion, edges: Array) -> Passing:
    """A vehicle at the edges of samples, s, at which it is there."""
    first, last = np.searchsorted(edges, motion.time[0]), np.searchsorted(edges, motion.time[-1], side="right")
    return Passing(motion, int(first), axles_at(motion, edges[first:last]))


def axles_at(motion: Motion, time: Array) -> Array:
    """Positions of front and rear axle [time, 2, 2], m."""
    place, heading = motion.at(time)
    half = motion.wheelbase / 2 * heading
    return np.stack([place + half, place - half], 1)


class Gauges:
    """Some channels of the cable: the points that they average over."""

    def __init__(self, scenario: DriveScenario, cable: Cable, distance: Array):
        self.scenario = scenario
        gauge = scenario.gauge_length
        first, last = distance[0] - gauge / 2, distance[-1] + gauge / 2
        count = int(np.ceil((last - first) / NODE))
        self.edges = np.linspace(first, last, count + 1)
        middle = (self.edges[1:] + self.edges[:-1]) / 2
        self.live = ~cable.slack(middle)
        self.nodes = cable.at(middle)
        self.along = np.stack([np.interp(middle, cable.cable, column) for column in cable.along.T], -1)
        self.low, self.high = distance - gauge / 2, distance + gauge / 2

    def near(self, axles: Array) -> slice:
        """Rows [time] at which a vehicle may be felt."""
        if not self.live.any():
            return slice(0, 0)
        low, high = (self.nodes[self.live, :2].min(0) - REACH, self.nodes[self.live, :2].max(0) + REACH)
        inside = ((axles[:, 0] > low) & (axles[:, 0] < high)).all(1)
        if not inside.any():
            return slice(0, 0)
        rows = np.flatnonzero(inside)
        return slice(int(rows[0]), int(rows[-1]) + 1)

    def strain(self, motion: Motion, axles: Array) -> Array:
        """Strain [time, channel] under one vehicle that is at `axles` [time, 2, 2]."""
        found = np.zeros((len(axles), len(self.low)))
        rows = self.near(axles)
        if rows.stop > rows.start:
            found[rows] = self.averaged(self.at_nodes(motion, axles[rows]))
        return found

    def add(self, rate: Array, one: Passing, step: float) -> None:
        """Add the strain rate under one vehicle, that is there only part of the time."""
        rows = self.near(one.axles)
        if rows.stop - rows.start < 2:
            return
        strain = self.averaged(self.at_nodes(one.motion, one.axles[rows]))
        first = one.first + rows.start
        rate[first : first + len(strain) - 1] += np.diff(strain, axis=0) / step

    def at_nodes(self, motion: Motion, axles: Array) -> Array:
        """Strain [time, node]."""
        softness = motion.weight / (4 * np.pi * self.scenario.shear_modulus)
        shares = softness * np.array([motion.front_share, 1 - motion.front_share])
        strain = np.zeros((len(axles), len(self.nodes)))
        strain_under()(strain, self.nodes, self.along, self.live, axles, shares, self.scenario.poisson_ratio, REACH)
        return strain

    def averaged(self, strain: Array) -> Array:
        """Mean over each gauge [time, channel] of strain at the points [time, node]."""
        width = np.diff(self.edges)
        whole = np.concatenate([np.zeros((len(strain), 1)), np.cumsum(strain * width, axis=1)], axis=1)
        return self.integral(whole, self.high) - self.integral(whole, self.low)

    def integral(self, whole: Array, at: Array) -> Array:
        """Integral of strain up to places on the cable, over the gauge length, [time, channel]."""
        index = np.clip(np.searchsorted(self.edges, at) - 1, 0, len(self.edges) - 2)
        share = (at - self.edges[index]) / (self.edges[index + 1] - self.edges[index])
        return np.asarray(((1 - share) * whole[:, index] + share * whole[:, index + 1]) / self.scenario.gauge_length)


@dataclass(frozen=True)
class DriveRecord:
    """A simulated drive.

    Parameters
    ----------
    ground : road, cable and map
    car : its motion, by the time of the GPS
    time : [time], s, by the record's clock less `clock_offset`
    rate : strain rate [time, channel], 1/s, single precision
    noise_sd : 1/s
    clock_offset, polarity : drawn
    bad : channels that record loud noise, or nothing
    """

    ground: Ground
    car: Motion
    time: Array
    rate: NDArray[np.float32]
    noise_sd: float
    clock_offset: float
    polarity: int
    bad: tuple[int, ...]


def record_drive(scenario: DriveScenario, into: NDArray[np.float32] | None = None) -> DriveRecord:
    """Simulate a drive.

    Parameters
    ----------
    scenario : what to simulate
    into : [time, channel] to write the record into, such as a memory map of `shape_of` it; a new array if None
    """
    ground = Ground(scenario)
    car = car_motion(scenario, ground.road)
    time = times_of(scenario, car)
    others = other_motions(scenario, ground.road, float(time[-1]))
    channels = len(ground.distance)
    rate = np.zeros((len(time), channels), np.float32) if into is None else into
    polarity = scenario.polarity or int(scenario.rng("polarity").choice([-1, 1]))
    energy, cells = 0.0, 0
    reach = car.at(time)[0]
    for block in blocks(ground, car, others, time):
        middle = ground.distance[block.channels]
        points, live = ground.cable.at(middle)[:, :2], ~ground.cable.slack(middle)
        near = (np.linalg.norm(reach[:, None] - points[None], axis=2) < HEARD) & live
        energy, cells = energy + float((block.car[near] ** 2).sum()), cells + int(near.sum())
        rate[:, block.channels] = polarity * (block.car + block.others)
    sd = float(np.sqrt(energy / max(cells, 1) / 10 ** (scenario.drawn("snr_db") / 10)))
    bad = add_noise(scenario, rate, sd)
    offset = scenario.drawn("clock_offset")
    return DriveRecord(ground, car, time, rate, sd, offset, polarity, bad)


def times_of(scenario: DriveScenario, car: Motion) -> Array:
    """Times of the samples, s: half a minute before and after the drive."""
    return np.asarray(np.arange(0, car.time[-1] + 30, 1 / scenario.sampling_rate))


def add_noise(scenario: DriveScenario, rate: NDArray[np.float32], sd: float) -> tuple[int, ...]:
    """Add noise to a record [time, channel] in place, colored, unequal and partly common; the bad channels."""
    rng = scenario.rng("noise")
    shared = np.sqrt(Color().common_share) * noise(rng, (len(rate), 1), Color(common_share=0.0, channel_spread=0.0))
    own = np.sqrt(1 - Color().common_share)
    for first in range(0, rate.shape[1], SOME):
        part = rate[:, first : first + SOME]
        part += (sd * (own * noise(rng, part.shape, OWN) + shared)).astype(np.float32)
    count = round(scenario.bad_channels * rate.shape[1])
    bad = scenario.rng("bad").choice(rate.shape[1], 2 * count, replace=False)
    for channel in bad[:count]:
        rate[:, channel] = 20 * sd * rng.normal(size=len(rate))
    rate[:, bad[count:]] = 0.0
    return tuple(sorted(int(one) for one in bad))
