"""The fiber's signal before noise: gauge-averaged strain under every wheel, and its rate."""

import numpy as np
from numpy.typing import NDArray

from solver.simulator.axle_forces import contact
from solver.simulator.buried_route import Route
from solver.simulator.elastic import extension, gauge_nodes, gauge_weights, tangential_extension
from solver.simulator.fiber_motion import arc_of, sense
from solver.simulator.instrument import IN_TIME, clipped, creep, filtered, rate_of
from solver.simulator.layered_elastic import Table, layers_of
from solver.simulator.moving_source import Inertia
from solver.simulator.outside import amplified, exhausted, packet, read, strained, tails
from solver.simulator.recording import low_pass_decimate
from solver.simulator.scenario import Scenario
from solver.simulator.surface_wave import surface_wave
from solver.simulator.vehicle import Vehicle

Array = NDArray[np.float64]
PANEL = 0.5  # m of fiber per four Gauss-Legendre nodes
REACH = 150.0  # m beyond the view where vehicles appear and vanish; the strain rate there is 1e-4 of its peak
STENCIL = 0.01  # s; step of the central difference
FINE_RATE = 100.0  # Hz, about; rate at which strain is computed if an effect acts in time
BLOCK = 40_000  # times x nodes at once, so that the work stays in the cache


def listen(
    scenario: Scenario,
    route: Route,
    distance: Array,
    vehicles: tuple[Vehicle, ...],
    time: Array,
    seen: Array,
) -> Array:
    """Strain rate [time, channel], 1/s, without noise, at `time` [time], s, hidden effects included.

    Parameters
    ----------
    scenario, route, vehicles : what is where
    distance : [channel] m along the light path; middle of each gauge
    seen : [channel] m; those in view
    """
    fiber = Fiber(scenario, route, distance, seen)
    if scenario.sampling == "instant" and not any(map(scenario.effect, IN_TIME)):
        rate = _instant(fiber, vehicles, time)
    else:
        every = max(1, round(FINE_RATE / scenario.sampling_rate))
        rate = _stepwise(fiber, vehicles, time, every)
        filters = scenario.sampling == "filtered"
        rate = low_pass_decimate(rate, every) if filters else read(scenario, rate, every, scenario.sampling_rate)
    for name, wave in (("rayleigh_wave", surface_wave), ("unknown_wave_packet", packet)):
        if scenario.effect(name):
            rate = rate + wave(scenario, route, arc_of(scenario, distance, distance), vehicles, time, rate)
    return clipped(scenario, amplified(scenario, rate, time))


def _instant(fiber: "Fiber", vehicles: tuple[Vehicle, ...], time: Array) -> Array:
    """Strain rate at each sample by a fourth-order central difference."""
    rate = np.zeros((len(time), fiber.channels))
    lag = STENCIL * np.array([-2, -1, 1, 2])
    weight = np.array([1, -8, 8, -1]) / (12 * STENCIL)
    for vehicle in vehicles:
        rows = _present(fiber, vehicle, time)
        strain = fiber.strain(vehicle, (time[rows, None] + lag).ravel())
        rate[rows] += np.einsum("tlc,l->tc", strain.reshape(-1, 4, fiber.channels), weight)
    return rate


def _stepwise(fiber: "Fiber", vehicles: tuple[Vehicle, ...], time: Array, every: int) -> Array:
    """Rate [time * every, channel] from strain at `every` times per sample, with the effects in time."""
    step = (time[1] - time[0]) / every
    edges = time[0] + step * (np.arange(len(time) * every + 1) - 0.5)
    strain = np.zeros((len(edges), fiber.channels))
    for vehicle in vehicles:
        rows = _present(fiber, vehicle, edges)
        strain[rows] += fiber.strain(vehicle, edges[rows])
    strain = creep(fiber.scenario, strained(fiber.scenario, strain), step)
    rate = exhausted(fiber.scenario, rate_of(fiber.scenario, strain, step), step)
    return filtered(fiber.scenario, rate, step)


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
    distance : [channel] m along the light path; middle of each gauge
    seen : [channel] m; those in view, if not all
    """

    def __init__(self, scenario: Scenario, route: Route, distance: Array, seen: Array | None = None):
        gauge = scenario.gauge_length * (1.0 + scenario.effect("gauge_length"))
        tail = scenario.effect("unknown_skewed_kernel_tail") * bool(scenario.effect("unknown_skewed_kernel"))
        spare = 5.0 * (scenario.effect("pulse_width") + scenario.effect("shear_lag")) + 25.0 * tail
        span = (float(distance[0] - gauge / 2 - spare), float(distance[-1] + gauge / 2 + spare), PANEL)
        light = gauge_nodes(*span)
        _, quadrature = np.polynomial.legendre.leggauss(4)
        measure = np.resize(quadrature, len(light)) * (span[1] - span[0]) / 2 / (len(light) / 4)
        average = _average(scenario, distance, gauge, span)
        average = sense(scenario, average, light, measure, distance, distance if seen is None else seen)
        arc = arc_of(scenario, light, distance)
        self.scenario = scenario
        self.channels = len(distance)
        self.points = route.position(arc).T.copy()
        buried = self.points[2] > 0  # no ground stretches what has come up a riser
        self.points[2] = np.where(buried, self.points[2], 1.0)
        self.tangents = route.tangent(arc).T.copy()
        away = np.sign(self.points[1] - np.mean(scenario.lanes)) * np.array([[0.0], [1.0], [0.0]])
        self.twin = self.points + scenario.effect("unknown_twin_path_aside") * away
        self.poisson_ratio = _poisson_ratio(scenario, self.points[0])
        layers = layers_of(scenario)
        self.layered = Table(layers, self.points[2], self.tangents) if layers else None
        self.inertia = Inertia(scenario, self.points, self.tangents) if scenario.effect("moving_load") else None
        softness = _softness(scenario, self.points[0]) / (4 * np.pi * scenario.shear_modulus)
        self.average = (average * softness * buried).T.copy()

    def strain(self, vehicle: Vehicle, time: Array) -> Array:
        """Strain [time, channel] under a vehicle at `time` [time], s."""
        field = np.empty((len(time), self.points.shape[1]))
        block = max(1, BLOCK // self.points.shape[1])
        for start in range(0, len(time), block):
            rows = slice(start, start + block)
            field[rows] = self._under(vehicle, time[rows], self.points)
            if share := self.scenario.effect("unknown_twin_path"):
                field[rows] += share * (self._under(vehicle, time[rows], self.twin) - field[rows])
        # One product for all blocks: many small ones would spend their time on waking threads.
        return np.asarray(field @ self.average)

    def _under(self, vehicle: Vehicle, time: Array, points: Array) -> Array:
        """Extension [time, node] times 4 pi G, N/m^2, at `points` [3, node]."""
        place, force = contact(self.scenario, vehicle, time)
        x, y, z = points
        stretch = 1.0 + self.scenario.effect("unknown_anisotropy")
        total = np.zeros((len(time), len(x)))
        for wheel in range(place.shape[1]):
            offset = (x - place[:, wheel, :1], stretch * (y - place[:, wheel, 1:]), z)
            under = self.layered.extension(*offset[:2]) if self.layered else self._uniform(offset)
            total += force[:, wheel, 2:] * under
            sideways = (force[:, wheel, :1], force[:, wheel, 1:2])
            if any(part.any() for part in sideways):
                total += tangential_extension(offset, self.tangents, sideways, self.poisson_ratio)
        return total + self.inertia.extension(vehicle, time) if self.inertia else total

    def _uniform(self, offset: tuple[Array, Array, Array]) -> Array:
        return extension(offset, self.tangents, self.poisson_ratio)


def _average(scenario: Scenario, distance: Array, gauge: float, span: tuple[float, float, float]) -> Array:
    """Weights [channel, node] of the interrogator's average: its gauge, smeared by its pulse."""
    shifts, weights = _pulse(scenario)
    later, shares = tails(scenario)
    every = zip(np.add.outer(shifts, later).ravel(), np.outer(weights, shares).ravel(), strict=True)
    return sum((w * gauge_weights(distance + s, gauge, *span) for s, w in every), start=np.zeros(1))


def _pulse(scenario: Scenario) -> tuple[Array, Array]:
    """Shifts [k] along the fiber, m, and weights [k] of the average that the pulse takes."""
    width = scenario.effect("pulse_width")
    if not width:
        return np.zeros(1), np.ones(1)
    if scenario.effect("pulse_width_gaussian"):
        shift, weight = np.polynomial.hermite_e.hermegauss(9)
        shift = shift * width / np.sqrt(12)
    else:
        shift, weight = np.polynomial.legendre.leggauss(9)
        shift = shift * width / 2
    return shift, weight / weight.sum()


def _step(scenario: Scenario, name: str, x: Array) -> Array:
    """-1 before, +1 beyond the place that an effect's settings name; a tanh."""
    first, last = scenario.view
    middle = first + scenario.effect(f"{name}_at") * (last - first)
    return np.tanh((x - middle) / scenario.effect(f"{name}_width"))


def _softness(scenario: Scenario, x: Array) -> Array:
    """G before the step / G here, at x [node], m."""
    amount = scenario.effect("stiffness_contrast")
    return np.exp(-amount * 0.5 * (1 + _step(scenario, "stiffness_contrast", x)))


def _poisson_ratio(scenario: Scenario, x: Array) -> Array:
    """[node] at x [node], m."""
    uniform = scenario.poisson_ratio + scenario.effect("poisson_ratio")
    ratio = uniform + scenario.effect("poisson_gradient") * _step(scenario, "poisson_gradient", x)
    return np.asarray(ratio)
