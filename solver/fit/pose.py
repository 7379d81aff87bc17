"""The fitting problem of a survey that has been read, smoothed and matched."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch

from solver.fit.map_fit import SPLINE_VARIANCE
from solver.fit.prior import Prior
from solver.fit.problem import Problem
from solver.fit.result import FitResult
from solver.fit.stretches import TAIL, around, is_long, nearby
from solver.noise.law import NoiseLaw
from solver.noise.quiet_windows import noise_level, quiet, rounded_level
from solver.noise.whitening import noise_law
from solver.signal_path.traffic import Traffic
from solver.start.rough_route import TYPICAL
from solver.survey.anchors import Anchor
from solver.survey.das.record import DASRecord
from solver.survey.das.rounding import Rounding
from solver.survey.das.time_windows import jumps
from solver.survey.limits import vehicle_reach
from solver.trajectory.trajectory_effects import COMMON_ERRORS, SLOW_ERROR
from solver.trajectory.vehicle_pass import Pass, track_sigma
from vision.contract import InputError

#: An end where the route turns by more than this over a gauge length, rad, and vehicles leave more than chance does in
#: a thousand, in standard deviations, is a bend that the model does not hold for.
TURN, BEYOND = 0.2, 3.09

#: Channels without which there is no route to speak of: a cubic spline has four coefficients.
FEWEST = 4

#: Positions out of view go on from the last ones in view: they err alike over many samples, which weigh as one.
UNSEEN = 3.0

#: Where tracks in view are this uncertain, m, their slow errors are fitted too; of so many passes they are where tracks
#: are less uncertain, too: with errors of positions a smoother model fits best, that of a deeper fiber, however many
#: passes there are, while the sigmas fall with their number.
UNCERTAIN, MANY, LESS = 0.05, 20, 0.01


def guessed_less(one: Pass) -> Pass:
    """The pass with its positions out of view weighing less."""
    return replace(one, sigma=np.where(one.in_view[:, None], 1.0, UNSEEN) * one.sigma)


def pose(
    record: DASRecord,
    passes: Sequence[Pass],
    anchors: Sequence[Anchor],
    route: np.ndarray,
    channel: np.ndarray,
    prior: Prior,
    dead: Sequence[int] | np.ndarray = (),
) -> Problem:
    """State the fitting problem over the active `channel` numbers but for `dead` ones, from `route` [channel, 3] on."""
    column = np.searchsorted(record.channel, channel)
    whole = column[-1] - column[0] == len(column) - 1
    # A view where it can be: on a long fiber, or in hours of record, a copy is a large part of the memory.
    strain_rate = record.strain_rate[:, slice(column[0], column[-1] + 1) if whole else column]
    still = quiet(len(strain_rate), route, passes, record.gauge_length)
    rounding = record.rounding and record.rounding.at(column)
    noise = rounded_level(noise_level(strain_rate, still), strain_rate, still, rounding)
    alive = np.isfinite(noise) & (noise > 0) & ~np.isin(channel, dead)
    if alive.sum() < FEWEST:
        raise InputError(
            f"DAS record: vehicles are told from noise in {alive.sum()} channels only, too few for a route; give "
            "more and heavier vehicles, or a record with more digits (roadfiber locate --filter fk finds fainter ones)"
        )
    kept = strain_rate if alive.all() else strain_rate[:, alive]
    reach = vehicle_reach(record.gauge_length)
    passes = [guessed_less(part) for one in passes if (part := nearby(one, route, reach)) is not None]
    if not passes:
        raise InputError(
            f"trajectories: no vehicle comes within {reach:g} m of channels {channel[0]} to {channel[-1]}, "
            "where the DAS records vehicles; check the frame (origin, x_azimuth) and the clocks"
        )
    traffic = Traffic.of(passes, around(passes, len(strain_rate), round(TAIL * record.sampling_rate)))
    return Problem(
        record=kept,
        noise=torch.from_numpy(noise[alive]),
        channel=channel[alive],
        recorded=record.recorded.channels,
        zero_distance=float(record.distance[0] - record.channel[0] * record.channel_spacing),
        channel_spacing=record.channel_spacing,
        gauge_length=record.gauge_length,
        passes=passes,
        traffic=traffic,
        anchors=anchors,
        start=route[alive],
        prior=prior,
        sampling_rate=record.sampling_rate,
        law=law_of(record, kept, still[:, alive], noise[alive], rounding and rounding.at(alive)),
        windows=jumps(record.time, record.sampling_rate),
    )


def law_of(
    record: DASRecord, strain_rate: np.ndarray, still: np.ndarray, noise: np.ndarray, rounding: Rounding | None
) -> NoiseLaw:
    """Law of the noise, learned in the middle of the fitted channels.

    Parameters
    ----------
    strain_rate, still : [sample, channel], of the fitted channels, see `noise_law`
    noise, rounding : of the same channels
    """
    count = len(noise)
    middle = slice(max(0, (count - TYPICAL) // 2), (count + TYPICAL) // 2)
    gauge = record.gauge_length / record.channel_spacing
    error = None if rounding is None else float(np.median(rounding.deviation / noise)) ** 2 * rounding.law
    return noise_law(strain_rate[:, middle] / noise[middle], still[:, middle], record.sampling_rate, gauge, error)


def with_slow_errors(problem: Problem, many: float = MANY) -> Problem:
    """The problem with each track's slow error among what is fitted, where the tracks are uncertain enough.

    On a long fiber each track has a shift of its own every few seconds already. `many` is how many passes are many.
    """
    sigma, least = track_sigma(problem.passes), UNCERTAIN if len(problem.passes) < many else LESS
    if is_long(problem) or sigma < least or any(one.slow_error for one in problem.effects):
        return problem
    return with_slow_errors_of(problem, sigma)


def with_slow_errors_of(problem: Problem, sigma: float) -> Problem:
    """The problem with each track's slow error, of standard deviation `sigma`, m, among what is fitted."""
    prior = replace(problem.prior, jitter=sigma / SPLINE_VARIANCE**0.5)
    return replace(problem, effects=(*problem.effects, SLOW_ERROR), prior=prior)


def with_common_errors(problem: Problem) -> Problem:
    """The problem with what puts all tracks of one camera off alike among what is fitted: see `COMMON_ERRORS`.

    One calibration, and one detector whose boxes err alike, place all vehicles: what the tracks say of themselves, root
    mean square, counts for all of them together, at either end of the view by itself. Nothing of it is fitted on a long
    fiber, which no one camera sees.
    """
    if is_long(problem):
        return problem
    place = np.concatenate([one.position[one.in_view] for one in problem.passes])
    sigma = np.concatenate([one.sigma[one.in_view] for one in problem.passes])
    x, y = np.sqrt((sigma**2).mean(0)).tolist()
    half = float(np.linalg.norm(np.ptp(place, axis=0))) / 2
    turn = {"track_rotation.angle": float(np.degrees(y / half)), "track_scale.scale": x / half}
    prior = replace(problem.prior, effect_sd={"track_offset.x": x, "track_offset.y": y} | turn)
    added = (one for one in COMMON_ERRORS if one not in problem.effects)
    return replace(problem, effects=(*problem.effects, *added), prior=prior)


def left_by_vehicles(result: FitResult, problem: Problem, block: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sum of squares of the residual of some fitted channels, in noise units, and of weights, [channel], near vehicles.

    Samples that no vehicle reaches would hide what the model leaves of those that it does.
    """
    route = result.route[np.searchsorted(result.channel, result.fitted_channel[block])]
    near = ~quiet(len(problem.record), route, problem.passes, problem.gauge_length)[result.samples]
    weight = np.where(near, result.weight[:, block], 0.0)
    residual = np.nan_to_num(result.unexplained((slice(None), block)) / result.noise[block])
    return np.asarray((weight * residual**2).sum(0)), np.asarray(weight.sum(0))


def bent_ends(result: FitResult, problem: Problem, gauge: int) -> slice:
    """Fitted channels to keep: without the last gauge length where the fiber turns off and the model fails.

    Parameters
    ----------
    result, problem : the fit, and what was fitted
    gauge : gauge length, channels
    """
    whole = slice(0, len(result.fitted_channel))
    if whole.stop <= 2 * gauge:
        return whole
    blocks = np.array_split(np.arange(whole.stop), max(1, whole.stop // TYPICAL))
    square, count = np.concatenate([left_by_vehicles(result, problem, block) for block in blocks], axis=1)
    told = count > 0
    level = np.median(square[told] / count[told]) if told.any() else 1.0
    route = result.route[np.isin(result.channel, result.fitted_channel)]
    direction = np.gradient(route, axis=0)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)

    def bent(inner: int, end: slice) -> bool:
        turn = np.arccos(np.clip(direction[end] @ direction[inner], -1, 1)).max()
        # From the very end inward: a turn may begin anywhere within the gauge.
        more, number = (np.cumsum(part[end][:: 1 if inner > 0 else -1]) for part in (square - level * count, count))
        return bool(turn > TURN and (more > BEYOND * level * np.sqrt(2 * number)).any())

    first = gauge * bent(gauge, slice(None, gauge))
    stop = len(square) - gauge * bent(-gauge - 1, slice(-gauge, None))
    return slice(first, stop) if stop - first > 2 * gauge else whole


def shortened(problem: Problem, keep: slice, result: FitResult) -> Problem:
    """The problem with the channels `keep` only, beginning where a fit of all of them ended."""
    return replace(
        problem,
        record=problem.record[:, keep],
        noise=problem.noise[keep],
        channel=problem.channel[keep],
        start=result.route[np.isin(result.channel, problem.channel)][keep],
    )
