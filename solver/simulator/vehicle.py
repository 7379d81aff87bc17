"""Vehicles that drive by: their weight, wheels and motion."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
GRAVITY = 9.81  # m/s^2


class Make(NamedTuple):
    """What vehicles of one class have in common: means, and the sds by which they differ."""

    wheelbase: tuple[float, float]  # m
    track: float  # m between left and right wheels
    front_share: tuple[float, float]  # of the load, on the front axle
    mass: tuple[float, float]  # kg, and relative sd
    overhang: float  # m that the body is longer than the wheelbase
    width: float  # m
    share: float  # of the traffic


FLEET = {
    "car": Make((2.65, 0.12), 1.55, (0.56, 0.02), (1400.0, 0.15), 1.85, 1.8, 0.50),
    "van": Make((3.40, 0.20), 1.70, (0.52, 0.02), (2300.0, 0.20), 2.10, 2.0, 0.25),
    "truck": Make((4.60, 0.40), 1.90, (0.42, 0.03), (8000.0, 0.30), 3.20, 2.4, 0.15),
    "bus": Make((5.90, 0.20), 2.05, (0.38, 0.02), (13000.0, 0.15), 6.10, 2.5, 0.10),
}


@dataclass(frozen=True)
class Vehicle:
    """One vehicle and its way past the camera.

    Attributes
    ----------
    track_id, vehicle_class : as a tracker would call it
    mass : kg
    wheelbase, track : m; `point` loads have both 0
    front_share : of the load, on the front axle
    length, width : m, of the body
    direction : +1 along x, -1 against it
    lane : m; mean y
    time_at : s; when the middle of the wheelbase passes `x_at`, m
    speed : m/s, mean
    surge : [k, 3]; amplitude m, angular frequency 1/s, phase of sines added to its progress
    weave : [k, 3]; amplitude m, wavenumber 1/m, phase of its lateral wander
    brakes : [k, 4]; when it begins to brake, s, for how long, s, the largest deceleration, m/s^2, and how long, s, that
        takes to come and to go
    axles : [k, 2]; m ahead of the middle of the wheelbase, share of the load; () for the two axles of its class

    >>> steady = ((0.0, 1.0, 0.0),)
    >>> car = Vehicle("1", "car", 1400, 2.65, 1.55, 0.56, 4.5, 1.8, 1, 0.0, 10.0, 50.0, 15.0, steady, steady)
    >>> car.position([10.0, 12.0])
    array([[50.,  0.],
           [80.,  0.]])
    """

    track_id: str
    vehicle_class: str
    mass: float
    wheelbase: float
    track: float
    front_share: float
    length: float
    width: float
    direction: int
    lane: float
    time_at: float
    x_at: float
    speed: float
    surge: tuple[tuple[float, float, float], ...]
    weave: tuple[tuple[float, float, float], ...]
    brakes: tuple[tuple[float, float, float, float], ...] = ()
    axles: tuple[tuple[float, float], ...] = ()

    def position(self, time: ArrayLike) -> Array:
        """Ground point under the middle of the wheelbase, [n, 2] m, at `time` [n], s."""
        since = np.asarray(time, float) - self.time_at
        amplitude, omega, phase = np.array(self.surge).T[:, :, None]
        surge = (amplitude * (np.sin(omega * since + phase) - np.sin(phase))).sum(0)
        x = self.x_at + self.direction * (self.speed * since + surge - self._braked(time)[2])
        return np.stack([x, self.lane + self._wander(x)], axis=-1)

    def velocity(self, time: ArrayLike) -> Array:
        """[n, 2] m/s at `time` [n], s."""
        since = np.asarray(time, float) - self.time_at
        amplitude, omega, phase = np.array(self.surge).T[:, :, None]
        forward = self.speed + (amplitude * omega * np.cos(omega * since + phase)).sum(0) - self._braked(time)[1]
        x = self.position(time)[:, 0]
        amplitude, k, phase = np.array(self.weave).T[:, :, None]
        slope = (amplitude * k * np.cos(k * x + phase)).sum(0)
        return self.direction * forward[:, None] * np.stack([np.ones_like(slope), slope], axis=-1)

    def deceleration(self, time: ArrayLike) -> Array:
        """By its brakes, [n] m/s^2, at `time` [n], s."""
        return self._braked(time)[0]

    def _braked(self, time: ArrayLike) -> tuple[Array, Array, Array]:
        """Deceleration, lost speed and lost distance [n] by brakes that come and go as sin^2."""
        time = np.asarray(time, float)
        sums = np.zeros((3, *time.shape))
        for begin, duration, most, ramp in self.brakes:
            # What comes is kept for ever, less the same that comes where it goes.
            for sign, since in ((1, time - begin), (-1, time - begin - duration + ramp)):
                coming, turn, kept = np.clip(since, 0.0, ramp), np.pi / ramp, np.maximum(since - ramp, 0.0)
                share = np.sin(turn * coming / 2) ** 2
                lost = (coming - np.sin(turn * coming) / turn) / 2 + kept
                way = (coming**2 / 2 + (np.cos(turn * coming) - 1) / turn**2) / 2 + kept * (ramp + kept) / 2
                sums += sign * most * np.stack([share, lost, way])
        return sums[0], sums[1], sums[2]

    def _wander(self, x: Array) -> Array:
        amplitude, k, phase = np.array(self.weave).T[:, :, None]
        return (amplitude * np.sin(k * x + phase)).sum(0)

    def axes(self, time: ArrayLike) -> tuple[Array, Array]:
        """Unit vectors [n, 2] ahead and to the right, at `time` [n], s."""
        velocity = self.velocity(time)
        ahead = velocity / np.linalg.norm(velocity, axis=1, keepdims=True)
        return ahead, np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)

    @property
    def wheels_ahead(self) -> Array:
        """How far [wheel] each stands ahead of the middle of the wheelbase, m."""
        return np.repeat([ahead for ahead, _ in self._axles()], 2)

    def _axles(self) -> tuple[tuple[float, float], ...]:
        half = self.wheelbase / 2
        return self.axles or ((half, self.front_share), (-half, 1.0 - self.front_share))

    def wheels(self, time: ArrayLike) -> tuple[Array, Array]:
        """Contact points [n, wheel, 2] m at `time` [n], s, and each one's share of the load [wheel]."""
        ahead, right = self.axes(time)
        forward = self.wheels_ahead[:, None]
        lateral = np.resize([-0.5, 0.5], len(forward))[:, None] * self.track
        shares = np.repeat([share for _, share in self._axles()], 2) / 2
        place = self.position(time)[:, None, :] + forward * ahead[:, None, :] + lateral * right[:, None, :]
        return place, shares

    def time_when_at(self, x: float) -> float:
        """When the middle of the wheelbase passes `x`, m; s."""
        reach = (abs(x - self.x_at) + 20.0) / self.speed
        time = self.time_at + np.linspace(-self._slack * reach, self._slack * reach, 4001)
        return float(np.interp(self.direction * x, self.direction * self.position(time)[:, 0], time))

    @property
    def _slack(self) -> float:
        """How much longer than at mean speed a distance may take."""
        return 3.5 if self.brakes else 1.2

    def times_within(self, first: float, last: float, step: float) -> tuple[float, float]:
        """When it enters and leaves the stretch of x from `first` to `last`, m; s, to `step`."""
        reach = (max(abs(first - self.x_at), abs(last - self.x_at)) + 20.0) / self.speed
        time = self.time_at + np.arange(-self._slack * reach, self._slack * reach, step)
        x = self.position(time)[:, 0]
        inside = time[(x >= first) & (x <= last)]
        return float(inside[0]), float(inside[-1])


def draw_class(rng: np.random.Generator, classes: Mapping[str, float]) -> str:
    """Draw a class of vehicles, by the share of each.

    >>> draw_class(np.random.default_rng(1), {"car": 0.0, "bus": 2.0})
    'bus'
    """
    names, shares = list(classes), np.array(list(classes.values()))
    return names[rng.choice(len(names), p=shares / shares.sum())]


def draw_vehicle(
    rng: np.random.Generator,
    track_id: str,
    vehicle_class: str,
    *,
    direction: int,
    lane: float,
    time_at: float,
    x_at: float,
    speed: float,
) -> Vehicle:
    """Draw a vehicle of a class, with random size, weight and driving.

    >>> import numpy as np
    >>> rng = np.random.default_rng(1)
    >>> bus = draw_vehicle(rng, "1", "bus", direction=-1, lane=-3.5, time_at=20.0, x_at=50.0, speed=12.0)
    >>> 5 < bus.wheelbase < 7
    True
    """
    make = FLEET[vehicle_class]
    wheelbase = make.wheelbase[0] + make.wheelbase[1] * float(np.clip(rng.normal(), -2.5, 2.5))
    mass = make.mass[0] * float(np.exp(make.mass[1] * rng.normal()))
    share = make.front_share[0] + make.front_share[1] * float(np.clip(rng.normal(), -2.5, 2.5))
    period, wavelength = rng.uniform(8, 25, 2), rng.uniform(60, 200, 2)
    # Speed varies by some 2 %: amplitude of progress = relative speed change * speed / angular frequency.
    surge = tuple(
        (
            0.02 * speed * float(rng.normal()) * p / (2 * np.pi),
            2 * np.pi / p,
            float(rng.uniform(0, 2 * np.pi)),
        )
        for p in period.tolist()
    )
    weave = tuple(
        (0.05 * float(rng.normal()), 2 * np.pi / w, float(rng.uniform(0, 2 * np.pi))) for w in wavelength.tolist()
    )
    return Vehicle(
        track_id,
        vehicle_class,
        mass,
        wheelbase,
        make.track,
        share,
        round(wheelbase + make.overhang, 1),
        make.width,
        direction,
        lane + float(rng.normal(0, 0.15)),
        time_at,
        x_at,
        speed,
        surge,
        weave,
    )
