"""Faults of a survey that change no stage: a vehicle the trajectories lack, jumped samples, dead channels.

Each is searched for in the residual, and mended in the survey itself: a pass more, samples or channels taken out.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.fft import next_fast_len
from scipy.optimize import minimize

from solver.cable.fiber import Fiber
from solver.criticism.fault import Fault
from solver.criticism.left_out import find_cycle_skips, find_faded_channels
from solver.fit.carried import carried
from solver.fit.least_squares import Solution, solve
from solver.fit.map_fit import MapFit
from solver.fit.problem import Problem
from solver.fit.state import State
from solver.noise.whitening import Whitener
from solver.signal_path.traffic import Traffic, Vehicles
from solver.trajectory.vehicle_pass import Pass

Array = NDArray[np.float64]

#: Speeds that an unseen vehicle is searched at, m/s, and bounds of the speed of the best match.
SPEEDS = (6.0, 8.0, 10.0, 12.0, 14.0, 17.0, 20.0)
SLOWEST, FASTEST = SPEEDS[0] / 2, 2 * SPEEDS[-1]
#: How far from the middle of the view it is followed, m.
REACH = 90.0
#: m; uncertainty of the track of an unseen vehicle, which drives straight on, and by how much all of it may be off.
GUESSED, OFFSET = 0.3, 1.5
#: How far from the known vehicles' course an unseen one may drive, m.
LANE = 1.0
#: Share of a vehicle's signal that must be measured, and certain, for it to be found.
LEAST = 0.1
#: s; a vehicle of the trajectories that passes the middle within this time is not unseen.
KNOWN = 1.5


def unexplained(fit: MapFit, state: State) -> Array:
    """Measured less model [row, channel] over the whole record, 1/s; spikes and what was not measured are 0."""
    rest = np.nan_to_num(fit.problem.record.astype(np.float64))
    rest[fit.problem.traffic.samples] = fit.unexplained(fit.model(state)).numpy()
    return np.where(np.abs(rest) < 50 * fit.problem.noise.numpy(), rest, 0.0)


def certain(fit: MapFit, state: State) -> Array:
    """Share of the noise in the variance of each sample [row, channel] of the whole record; 0 where not measured.

    Less than 1 where a known vehicle's track is uncertain: out of view the rest of a heavy one is no other vehicle.
    """
    counts = np.isfinite(fit.problem.record).astype(float)
    evaluation = fit.glance(state)
    variance = 1 + fit.added_variance(evaluation.local, evaluation.model)
    counts[fit.problem.traffic.samples] /= variance.numpy()
    return counts


def straight(problem: Problem, speed: float, way: int, y: float, start: float, rows: int) -> Pass:
    """A car at constant speed, m/s, that passes the middle of the channels `start` s of rows after the first one."""
    time = np.arange(rows) / problem.sampling_rate - start
    x = float(problem.start[:, 0].mean()) + way * speed * time
    keep = np.flatnonzero(np.abs(speed * time) <= REACH)
    position = np.column_stack([x[keep], np.full(len(keep), y)])
    velocity = np.tile([way * speed, 0.0], (len(keep), 1))
    sigma = np.full((len(keep), 2), GUESSED)
    return Pass("unseen", "car", keep, position, velocity, sigma, np.ones(len(keep), bool), offset=OFFSET)


def lanes(problem: Problem) -> list[tuple[int, float]]:
    """Directions (+1, -1 along x) and lateral positions, m, that the known vehicles drive at."""
    found: dict[int, list[float]] = {}
    for one in problem.passes:
        found.setdefault(1 if one.speed > 0 else -1, []).append(float(np.median(one.position[:, 1])))
    return [(way, float(np.median(y))) for way, y in found.items()]


def half_rows(problem: Problem, speed: float) -> int:
    """How many rows a vehicle is followed for before the middle, and after it."""
    return int(np.ceil(REACH / speed * problem.sampling_rate))


def template(fit: MapFit, state: State, speed: float, way: int, y: float) -> Array:
    """Strain rate [row, channel] of a typical car that passes the middle in the middle of the rows, 1/s."""
    problem = fit.problem
    half = half_rows(problem, speed)
    one = straight(problem, speed, way, y, half / problem.sampling_rate, 2 * half + 1)
    traffic = Traffic.of([one])
    path = replace(fit.path, traffic=traffic, extension=type(fit.extension)())
    ends = fit.problem.ends(fit.basis)
    car = Vehicles.of([one])
    typical = state.vehicles.amplitude.abs().median()
    car = replace(car, amplitude=typical.reshape(1))
    out = np.zeros((2 * half + 1, len(problem.channel)))
    fiber = Fiber.of(ends, state.coefficients)
    out[traffic.samples] = replace(path, curved=False).strain_rate(fiber, car, state.poisson_ratio).numpy()
    return out


def passing_times(problem: Problem) -> list[tuple[int, float]]:
    """Direction and time, s of rows since the first, at which known vehicles pass the middle of the channels."""
    middle = float(problem.start[:, 0].mean())
    times = []
    for one in problem.passes:
        near = int(np.abs(one.position[:, 0] - middle).argmin())
        times.append((1 if one.speed > 0 else -1, float(one.rows[near]) / problem.sampling_rate))
    return times


class Peak(NamedTuple):
    """A match.

    Parameters
    ----------
    snr : sigmas
    weight, sigma : relative to a typical car
    time : of passing the middle of the channels, s of rows since the first, without the jumps between windows
    way, speed, y : direction (+1, -1 along x), m/s, lateral position, m
    free : moments at which no known vehicle passes
    """

    snr: float
    weight: float
    sigma: float
    time: float
    way: int
    speed: float
    y: float
    free: int


def find_unseen_vehicle(fit: MapFit, state: State) -> Fault | None:
    """Search the whole record for one more vehicle: matched filter over speed, direction, lane and time."""
    problem = fit.problem
    rest = unexplained(fit, state)
    rows = len(rest)
    whiten = Whitener(problem.noise, np.arange(rows), problem.channel, problem.law)
    white = whiten(torch.from_numpy(rest)).numpy()
    counts = certain(fit, state)
    white = np.clip(white, -8, 8) * counts
    known = passing_times(problem)
    longest = 2 * half_rows(problem, SLOWEST) + 1
    along_white, along_counts = correlation_with(white, longest), correlation_with(counts, longest)

    def match(speed: float, way: int, y: float) -> Peak:
        shape = template(fit, state, speed, way, y)
        shape = replace(whiten, samples=np.arange(len(shape)))(torch.from_numpy(shape)).numpy()
        product, energy = along_white(shape), along_counts(shape**2).clip(LEAST * (shape**2).sum())
        time = (np.arange(len(product)) - (len(shape) - 1) + len(shape) // 2) / problem.sampling_rate
        free = (time > 0) & (time < rows / problem.sampling_rate)
        for other, at in known:
            free &= (np.abs(time - at) > KNOWN) | (other != way)
        snr = np.where(free, product / np.sqrt(energy), -np.inf)
        peak = int(snr.argmax())
        size, sigma = float(product[peak] / energy[peak]), float(energy[peak]) ** -0.5
        return Peak(float(snr[peak]), size, sigma, float(time[peak]), way, speed, y, int(free.sum()))

    coarse = [match(speed, way, y) for way, y in lanes(problem) for speed in SPEEDS]
    if not coarse:
        return None
    found = refined(max(coarse), match)

    def mend(survey: Problem) -> Problem:
        return with_pass(survey, straight(survey, found.speed, found.way, found.y, found.time, len(survey.record)))

    speed_x = found.way * found.speed * 3.6
    when = float(problem.time_of(found.time * problem.sampling_rate))
    words = f"a vehicle the trajectories lack passes the middle at {when:.1f} s, {speed_x:+.0f} km/h along x"
    fall, least = max(found.snr, 0.0) ** 2, 6 * found.sigma
    trials = sum(one.free for one in coarse)
    return Fault("unseen_vehicle", "load", fall, 4, trials, found.weight, found.sigma, "1", least, words, mend)


def refined(coarse: Peak, match: Callable[[float, int, float], Peak]) -> Peak:
    """The best match at any speed near that of the coarse search, and in any part of the lane."""

    def miss(at: Array) -> float:
        return -match(float(at[0]), coarse.way, float(at[1])).snr

    corners = [[coarse.speed, coarse.y], [coarse.speed * 1.08, coarse.y], [coarse.speed, coarse.y + LANE / 2]]
    bounds = [(SLOWEST, FASTEST), (coarse.y - LANE, coarse.y + LANE)]
    options = {"initial_simplex": corners, "xatol": 0.02, "fatol": 0.05, "maxfev": 60}
    best = minimize(miss, corners[0], method="Nelder-Mead", bounds=bounds, options=options).x
    return match(float(best[0]), coarse.way, float(best[1]))


def correlation_with(values: Array, longest: int) -> Callable[[Array], Array]:
    """Sum over channels of the correlation in time of values [row, channel], as a function of a shape [row, channel].

    `longest` is how many rows a shape has at most: the spectrum of the values is computed once for all shapes.

    >>> along = correlation_with(np.array([[0.0], [1.0], [3.0]]), 2)
    >>> along(np.array([[1.0], [2.0]])).round(6).tolist()
    [0.0, 2.0, 7.0, 3.0]
    """
    size = next_fast_len(len(values) + longest - 1, real=True)
    spectrum = np.fft.rfft(values, size, axis=0)

    def along(shape: Array) -> Array:
        both = np.einsum("fc,fc->f", spectrum, np.fft.rfft(shape[::-1], size, axis=0))
        return np.asarray(np.fft.irfft(both, size)[: len(values) + len(shape) - 1])

    return along


def with_pass(problem: Problem, one: Pass) -> Problem:
    """The same survey with one more vehicle."""
    number = sum(other.track_id.startswith("unseen") for other in problem.passes)
    named = replace(one, track_id=f"unseen#{number + 1}")
    passes = [*problem.passes, named]
    return replace(problem, passes=passes, traffic=Traffic.of(passes, problem.traffic.samples))


#: How to look for each fault, by its name in the catalogue.
SEARCHES: Mapping[str, Callable[[MapFit, State], Fault | None]] = {
    "unseen_vehicle": find_unseen_vehicle,
    "cycle_skips": find_cycle_skips,
    "faded_channels": find_faded_channels,
}
#: Those that are mended by leaving out what was measured.
TAKEN_OUT = ("cycle_skips", "faded_channels")


def mended(fit: MapFit, state: State, fault: Fault) -> tuple[MapFit, Solution]:
    """The survey with a fault mended, fitted again."""
    new = MapFit(fault.mend(fit.problem))
    return new, solve(new, carried((fit, state), new))
