"""Effects outside the catalogue, stage by stage."""

import numpy as np
from numpy.typing import NDArray

from solver.simulator.buried_route import Route
from solver.simulator.effects import effect_rng
from solver.simulator.fiber_motion import smooth
from solver.simulator.instrument import relaxed
from solver.simulator.scenario import Scenario
from solver.simulator.vehicle import Vehicle

Array = NDArray[np.float64]
LARGE = 5.0  # m; vehicles longer than this have a wake
WAKE_POINTS = 8


def load_factor(scenario: Scenario, vehicle: Vehicle, time: Array) -> Array:
    """Load [time] by the road's profile and by the speed, relative to the weight."""
    factor = np.ones(len(time))
    if sd := scenario.effect("unknown_road_profile"):
        x = vehicle.position(time)[:, 0]
        wavelengths = tuple(scenario.effect(f"unknown_road_profile_{end}") for end in ("shortest", "longest"))
        span = np.linspace(*scenario.view, 500)
        rng = effect_rng(scenario.seed, "unknown_road_profile")
        factor += sd * smooth(rng, x, (wavelengths[0], wavelengths[1]), span=span)
    if growth := scenario.effect("unknown_speed_load"):
        faster = np.linalg.norm(vehicle.velocity(time), axis=1) / np.mean(scenario.speeds) * 3.6 - 1
        factor += growth * faster
    return factor


def wake(scenario: Scenario, vehicle: Vehicle, time: Array) -> tuple[Array, Array]:
    """Points [time, point, 2], m, behind a large vehicle, and the share [point] of its load that pulls there."""
    amount = scenario.effect("unknown_wake") * (vehicle.length > LARGE)
    if not amount:
        return np.empty((len(time), 0, 2)), np.empty(0)
    ahead, _ = vehicle.axes(time)
    spread = (np.arange(WAKE_POINTS) + 0.5) / WAKE_POINTS
    behind = vehicle.length / 2 + scenario.effect("unknown_wake_length") * spread
    share = 1 - spread
    return vehicle.position(time)[:, None] - behind[:, None] * ahead[:, None], -amount * share / share.sum()


def packet(
    scenario: Scenario, route: Route, arc: Array, vehicles: tuple[Vehicle, ...], time: Array, rate: Array
) -> Array:
    """Strain rate [time, channel] of a wave packet that travels with each vehicle; parameters as for `surface_wave`."""
    points, tangents = route.position(arc), route.tangent(arc)
    heaviest = max(vehicle.mass for vehicle in vehicles)
    k = 2 * np.pi / scenario.effect("unknown_wave_packet_wavelength")
    middle, width = scenario.effect("unknown_wave_packet_behind"), scenario.effect("unknown_wave_packet_width")
    wave = np.zeros((len(time), len(arc)))
    for vehicle in vehicles:
        first, last = vehicle.times_within(scenario.view[0] - 80, scenario.view[1] + 80, 0.05)
        rows = slice(int(np.searchsorted(time, first)), int(np.searchsorted(time, last)))
        behind = vehicle.direction * (vehicle.position(time[rows])[:, :1] - points[:, 0])
        across = np.abs(points[:, 1] - vehicle.lane)
        bell = np.exp(-(((behind - middle) / width) ** 2) / 2 - across / 15.0) * tangents[:, 0] ** 2
        wave[rows] += vehicle.mass / heaviest * vehicle.direction * bell * np.cos(k * (behind - middle))
    return scenario.effect("unknown_wave_packet") * np.abs(rate).max() * wave


def strained(scenario: Scenario, strain: Array) -> Array:
    """Strain [time, channel] of a ground that softens, or has internal friction."""
    largest = np.abs(strain).max()
    if share := scenario.effect("unknown_softening"):
        strain = strain * (1 + share * np.abs(strain) / largest)
    if share := scenario.effect("unknown_hysteresis"):
        strain = strain + share * play(strain, scenario.effect("unknown_hysteresis_play") * largest)
    return strain


def play(drive: Array, slack: float) -> Array:
    """Response of a part that a drive [time, ...] moves with slack (backlash).

    >>> import numpy as np
    >>> play(np.array([0.0, 1.0, 3.0, 2.0, -1.0]), 1.0)
    array([0., 0., 2., 2., 0.])
    """
    out = np.empty_like(drive)
    pulled = np.zeros_like(drive[0])
    for row, now in enumerate(drive):
        out[row] = pulled = np.clip(pulled, now - slack, now + slack)
    return out


def tails(scenario: Scenario) -> tuple[Array, Array]:
    """Shifts [k] along the fiber, m, and their weights [k], of a one-sided kernel."""
    share = scenario.effect("unknown_skewed_kernel")
    if not share:
        return np.zeros(1), np.ones(1)
    shift, weight = np.polynomial.laguerre.laggauss(8)
    return np.append(0.0, shift * scenario.effect("unknown_skewed_kernel_tail")), np.append(1 - share, share * weight)


def exhausted(scenario: Scenario, rate: Array, step: float) -> Array:
    """Reduce the gain of each channel of a rate [time, channel] after strong recent signals."""
    lost = scenario.effect("unknown_exhaustion")
    if not lost:
        return rate
    borne = relaxed(np.abs(rate), scenario.effect("unknown_exhaustion_time") / step)
    return np.asarray(rate * (1 - lost * borne / borne.max()))


def read(scenario: Scenario, rate: Array, every: int, sampling_rate: float) -> Array:
    """Every `every`-th row of a rate [time, channel], each channel a little later than the one before."""
    delay = scenario.effect("unknown_channel_delay")
    if not delay:
        return rate[::every]
    row = np.arange(0.0, len(rate), every)
    late = delay / 100 * np.arange(rate.shape[1]) * sampling_rate * every
    place = np.minimum(row[:, None] + late, len(rate) - 1.001)
    low = place.astype(int)
    column = np.arange(rate.shape[1])
    return np.asarray((1 - (place - low)) * rate[low, column] + (place - low) * rate[low + 1, column])


def amplified(scenario: Scenario, rate: Array, time: Array) -> Array:
    """Apply echo, quadratic response and oscillating gain to a sampled rate [time, channel]."""
    if share := scenario.effect("unknown_echo"):
        farther = round(scenario.effect("unknown_echo_channels"))
        rate = rate + share * np.pad(rate, ((0, 0), (0, farther)))[:, farther:]
    if bend := scenario.effect("unknown_quadratic"):
        rate = rate + bend * rate**2 / np.abs(rate).max()
    if swing := scenario.effect("unknown_gain_drift"):
        omega = 2 * np.pi / scenario.effect("unknown_gain_drift_period")
        phase = effect_rng(scenario.seed, "unknown_gain_drift").uniform(0, 2 * np.pi)
        rate = rate * (1 + swing * np.sin(omega * time + phase))[:, None]
    return rate


def handled(scenario: Scenario, record: Array) -> Array:
    """Difference the channels, or equalize the samples, of a record [time, channel]."""
    if share := scenario.effect("unknown_difference"):
        record = record - share * np.concatenate([record[:, :1], record[:, :-1]], axis=1)
    if power := scenario.effect("unknown_equalized"):
        rms = np.sqrt((record**2).mean(axis=1, keepdims=True))
        record = record / (rms / np.median(rms)) ** power
    return record


def misplaced(scenario: Scenario, vehicle: Vehicle) -> float:
    """How much farther to the right a vehicle is than reported, m."""
    tall = {"truck": 1.0, "bus": 1.0, "van": 0.5}.get(vehicle.vehicle_class, 0.0)
    return tall * scenario.effect("unknown_tall_vehicles")
