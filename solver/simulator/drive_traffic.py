"""How the GPS car and the other traffic of a simulated drive move along the road."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.simulator.drive_road import Road
from solver.simulator.drive_scenario import DriveScenario
from solver.simulator.vehicle import FLEET, GRAVITY

Array = NDArray[np.float64]

TICK = 0.1  # s between points of a motion
LANE = 1.75  # m from the middle of the road
DETOUR, WIDE = 400.0, 75.0  # m, length of a detour and its distance from the road
TURNING = 2.5  # m/s, speed at a U-turn
SPEED_UP, SLOW_DOWN = 1.6, 2.0  # m/s^2


@dataclass(frozen=True)
class Motion:
    """A vehicle's way: s [tick], position of the middle of its wheelbase [tick, 2], unit heading [tick, 2], weight."""

    time: Array
    position: Array
    heading: Array
    weight: float  # N
    wheelbase: float  # m
    front_share: float

    def at(self, time: Array) -> tuple[Array, Array]:
        """Position and heading [time, 2]; held at the ends."""
        place = np.stack([np.interp(time, self.time, column) for column in self.position.T], -1)
        heading = np.stack([np.interp(time, self.time, column) for column in self.heading.T], -1)
        return place, heading / np.maximum(np.linalg.norm(heading, axis=1, keepdims=True), 1e-9)


def speed_along(way: Array, wanted: Array, halts: Array) -> Array:
    """Speed [point], m/s, along a way, m: as wanted, but still at `halts`, within what brakes and engine can do."""
    speed = wanted.copy()
    for halt in halts:
        ahead = halt - way
        brake = np.sqrt(2 * SLOW_DOWN * np.clip(ahead, 0, None))
        start = np.sqrt(2 * SPEED_UP * np.clip(-ahead, 0, None))
        speed = np.minimum(speed, np.where(ahead >= 0, brake, start))
    step = float(way[1] - way[0])
    for index in range(1, len(speed)):
        speed[index] = min(speed[index], np.sqrt(speed[index - 1] ** 2 + 2 * SPEED_UP * step))
    for index in range(len(speed) - 2, -1, -1):
        speed[index] = min(speed[index], np.sqrt(speed[index + 1] ** 2 + 2 * SLOW_DOWN * step))
    return np.maximum(speed, 0.3)


def driven(rng: np.random.Generator, s: DriveScenario, length: float, stops: float) -> tuple[Array, Array]:
    """Time and distance gone [tick] of a vehicle over `length` m, with `stops` per km."""
    way = np.arange(0, length + 0.5, 0.5)
    pieces = rng.uniform(*s.speeds, size=int(length / 350) + 2) / 3.6
    wanted = np.interp(way, np.arange(len(pieces)) * 350.0, pieces)
    halts = rng.uniform(20, max(21, length - 20), rng.poisson(stops * length / 1000))
    speed = speed_along(way, wanted, halts)
    time = np.concatenate([[0.0], np.cumsum(0.5 / ((speed[1:] + speed[:-1]) / 2))])
    for halt in np.sort(halts):
        time[way > halt] += rng.uniform(5, 60)
    ticks = np.arange(0, time[-1], TICK)
    return ticks, np.interp(ticks, time, way)


def leg_places(rng: np.random.Generator, road: Road, u_turns: int) -> list[tuple[float, float]]:
    """Legs of a drive, from and to places on the road: forth, at each U-turn some hundred meters back, and on."""
    legs, begin = list[tuple[float, float]](), 15.0
    for place in np.sort(rng.uniform(0.35, 0.9, u_turns)) * road.length:
        back = max(begin + 20, place - rng.uniform(0.15, 0.3) * min(road.length, 3000))
        if place - back < 100:
            continue
        legs += [(begin, float(place)), (float(place), float(back))]
        begin = float(back)
    return [*legs, (begin, road.length - 15.0)]


def car_motion(s: DriveScenario, road: Road) -> Motion:
    """The GPS car: all along the road, with its stops, U-turns and detours."""
    rng = s.rng("car")
    places, laterals, times, clock = [], [], [], 30.0
    for begin, end in leg_places(rng, road, s.u_turns):
        ticks, gone = driven(rng, s, abs(end - begin), s.stops_per_km)
        direction = np.sign(end - begin)
        places.append(begin + direction * gone)
        laterals.append(np.full(len(gone), LANE * direction))
        times.append(clock + ticks)
        clock = float(times[-1][-1]) + 4.0
    place, lateral, time = (np.concatenate(parts) for parts in (places, laterals, times))
    for middle in rng.uniform(0.2, 0.8, s.detours) * road.length:
        inside = np.clip((DETOUR / 2 - np.abs(place - middle)) / 60.0, 0, 1)
        lateral = lateral + WIDE * inside**2 * (3 - 2 * inside)
    fine = np.arange(time[0], time[-1], TICK)
    kernel = np.hanning(41)[1:-1]
    # A U-turn takes some seconds from lane to lane.
    sideways = np.convolve(np.pad(np.interp(fine, time, lateral), 19, "edge"), kernel / kernel.sum(), "valid")
    return moving(road, fine, np.interp(fine, time, place), sideways, "car", rng)


def moving(
    road: Road, time: Array, place: Array, lateral: Array, vehicle_class: str, rng: np.random.Generator
) -> Motion:
    """A motion along the road: place and lateral position [tick], m."""
    position = road.at(place, lateral)
    velocity = np.gradient(position, axis=0)
    still = np.linalg.norm(velocity, axis=1) < 1e-3
    index = np.where(still, 0, np.arange(len(velocity)))
    heading = velocity[np.maximum.accumulate(index)]
    make = FLEET[vehicle_class]
    weight = GRAVITY * make.mass[0] * np.exp(make.mass[1] * rng.normal())
    norm = np.maximum(np.linalg.norm(heading, axis=1, keepdims=True), 1e-9)
    wheelbase = float(make.wheelbase[0] + make.wheelbase[1] * rng.normal())
    return Motion(time, position, heading / norm, float(weight), wheelbase, make.front_share[0])


def other_motions(s: DriveScenario, road: Road, duration: float) -> list[Motion]:
    """Other vehicles: each on some stretch of the road, in either direction."""
    rng = s.rng("traffic")
    stretch = min(road.length, 1500.0)
    count = rng.poisson(2 * s.traffic * duration / 3600 * (road.length / stretch))
    names, shares = zip(*((name, make.share) for name, make in FLEET.items()), strict=True)
    found = []
    for _ in range(count):
        direction = rng.choice([-1, 1])
        begin = rng.uniform(-stretch, road.length) if direction > 0 else rng.uniform(0, road.length + stretch)
        ticks, gone = driven(rng, s, stretch * rng.uniform(0.5, 1.0), s.stops_per_km)
        place = begin + direction * gone
        inside = (place > 0) & (place < road.length)
        time = ticks + rng.uniform(-120, duration)
        inside &= (time > -10) & (time < duration + 10)
        if inside.sum() < 20:
            continue
        lateral = np.full(inside.sum(), LANE * direction + 0.2 * rng.normal())
        name = str(rng.choice(names, p=np.array(shares) / sum(shares)))
        found.append(moving(road, time[inside], place[inside], lateral, name, rng))
    return found


def gps_fixes(s: DriveScenario, car: Motion) -> tuple[Array, Array, float]:
    """Fixes of the car at 1 Hz: time, s, position [fix, 2], and the sigma that the receiver states, m.

    Seven tenths of the variance change from fix to fix, the rest over half a minute; some fixes are 10 to 40 m off.
    """
    rng = s.rng("gps")
    time = np.arange(np.ceil(car.time[0]), car.time[-1])
    sigma = s.drawn("gps_sigma")
    slow, decay = np.zeros((len(time), 2)), np.exp(-1 / 30)
    state = rng.normal(size=2)
    for index in range(len(time)):
        state = decay * state + np.sqrt(1 - decay**2) * rng.normal(size=2)
        slow[index] = state
    error = sigma * (np.sqrt(0.7) * rng.normal(size=slow.shape) + np.sqrt(0.3) * slow)
    out = rng.random(len(time)) < s.gps_outliers
    angle = rng.uniform(0, 2 * np.pi, len(time))
    error += (out * rng.uniform(10, 40, len(time)))[:, None] * np.stack([np.cos(angle), np.sin(angle)], -1)
    return time, car.at(time)[0] + error, sigma
