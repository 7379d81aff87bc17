"""What the fiber records, before noise: gauge-averaged strain under every wheel, and its rate."""

import numpy as np
from numpy.typing import NDArray

from solver.simulator.elastic import extension, gauge_nodes, gauge_weights
from solver.simulator.recording import high_pass, low_pass_decimate
from solver.simulator.route import Route
from solver.simulator.scenario import Scenario
from solver.simulator.vehicle import Vehicle

Array = NDArray[np.float64]
GRAVITY = 9.81  # m/s^2
PANEL = 0.5  # m of fiber per four Gauss-Legendre nodes
REACH = 150.0  # m beyond the view where vehicles appear and vanish; the strain rate there is 1e-4 of its peak
STENCIL = 0.01  # s; step of the central difference
FINE_RATE = 100.0  # Hz, about, at which a "filtered" survey computes strain
BLOCK = 40_000  # times x nodes at once, so that the work stays in the cache


def listen(
    scenario: Scenario,
    route: Route,
    distance: Array,
    vehicles: tuple[Vehicle, ...],
    time: Array,
    rng: np.random.Generator,
) -> Array:
    """Strain rate [time, channel], 1/s, without noise, at `time` [time], s, hidden effects included."""
    fiber = Fiber(scenario, route, distance)
    if scenario.sampling == "instant":
        rate = _instant(fiber, vehicles, time)
        every = 1
    else:
        every = max(1, round(FINE_RATE / scenario.sampling_rate))
        rate = _stepwise(fiber, vehicles, time, every)
    if corner := scenario.effect("highpass"):
        rate = high_pass(rate, corner, every * scenario.sampling_rate)
    if scenario.sampling == "filtered":
        rate = low_pass_decimate(rate, every)
    return rate * coupling(rng, distance, scenario.effect("channel_coupling"))


def _instant(fiber: "Fiber", vehicles: tuple[Vehicle, ...], time: Array) -> Array:
    """Fourth-order central difference of the strain at each sample."""
    rate = np.zeros((len(time), fiber.channels))
    lag = STENCIL * np.array([-2, -1, 1, 2])
    weight = np.array([1, -8, 8, -1]) / (12 * STENCIL)
    for vehicle in vehicles:
        rows = _present(fiber, vehicle, time)
        strain = fiber.strain(vehicle, (time[rows, None] + lag).ravel())
        rate[rows] += np.einsum("tlc,l->tc", strain.reshape(-1, 4, fiber.channels), weight)
    return rate


def _stepwise(fiber: "Fiber", vehicles: tuple[Vehicle, ...], time: Array, every: int) -> Array:
    """Strain `every` times per sample, differenced as an interrogator does; [time * every, channel]."""
    step = (time[1] - time[0]) / every
    fine = time[0] + step * np.arange(len(time) * every)
    rate = np.zeros((len(fine), fiber.channels))
    for vehicle in vehicles:
        rows = _present(fiber, vehicle, fine)
        edges = np.append(fine[rows], fine[rows][-1] + step) - step / 2
        rate[rows] += np.diff(fiber.strain(vehicle, edges), axis=0) / step
    return rate


def _present(fiber: "Fiber", vehicle: Vehicle, time: Array) -> slice:
    """Rows of `time` when a vehicle is near enough to matter."""
    view = fiber.scenario.view
    first, last = vehicle.times_within(view[0] - REACH, view[1] + REACH, 0.05)
    return slice(int(np.searchsorted(time, first)), int(np.searchsorted(time, last)))


class Fiber:
    """The fiber as the interrogator senses it: nodes along it, and the gauge average over them.

    Parameters
    ----------
    scenario : ground, gauge length and hidden effects
    route : where it lies
    distance : [channel] m; middle of each gauge
    """

    def __init__(self, scenario: Scenario, route: Route, distance: Array):
        gauge = scenario.gauge_length * (1.0 + scenario.effect("gauge_length"))
        span = (float(distance[0]) - gauge / 2, float(distance[-1]) + gauge / 2, PANEL)
        nodes = gauge_nodes(*span)
        self.scenario = scenario
        self.channels = len(distance)
        self.points = route.position(nodes).T.copy()
        self.tangents = route.tangent(nodes).T.copy()
        softness = _softness(scenario, self.points[0]) / (4 * np.pi * scenario.shear_modulus)
        self.average = (gauge_weights(distance, gauge, *span) * softness).T.copy()

    def strain(self, vehicle: Vehicle, time: Array) -> Array:
        """Strain [time, channel] under a vehicle at `time` [time], s."""
        field = np.empty((len(time), self.points.shape[1]))
        block = max(1, BLOCK // self.points.shape[1])
        for start in range(0, len(time), block):
            rows = slice(start, start + block)
            field[rows] = self._under(vehicle, time[rows])
        # One product for all blocks: many small ones spend their time on waking threads.
        return np.asarray(field @ self.average)

    def _under(self, vehicle: Vehicle, time: Array) -> Array:
        """Extension [time, node] times 4 pi G, N/m^2."""
        place, shares = vehicle.wheels(time)
        if self.scenario.effect("point_load"):
            place, shares = vehicle.position(time)[:, None, :], np.ones(1)
        nu = self.scenario.poisson_ratio
        x, y, z = self.points
        total = np.zeros((len(time), len(x)))
        for wheel, share in enumerate(shares):
            dx, dy = x - place[:, wheel, :1], y - place[:, wheel, 1:]
            total += share * extension((dx, dy, z), self.tangents, nu)
        return vehicle.mass * GRAVITY * total


def coupling(rng: np.random.Generator, distance: Array, sd: float) -> Array:
    """Gain [channel] = exp(g), g smooth along the fiber (sines of 20 to 80 m), of standard deviation `sd`.

    >>> import numpy as np
    >>> coupling(np.random.default_rng(0), np.arange(3.0), 0.0)
    array([1., 1., 1.])
    """
    wavelength, phase = rng.uniform(20, 80, 12), rng.uniform(0, 2 * np.pi, 12)
    waves = np.sin(2 * np.pi * distance[:, None] / wavelength + phase).sum(1)
    return np.exp(sd * (waves - waves.mean()) / waves.std())


def _softness(scenario: Scenario, x: Array) -> Array:
    """G before the step / G here, at x [node], m; the step is in the middle of the view and 2 m wide."""
    amount, middle = scenario.effect("stiffness_contrast"), sum(scenario.view) / 2
    return np.exp(-amount * 0.5 * (1 + np.tanh((x - middle) / 2.0)))
