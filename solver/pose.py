"""From a survey that is read, smoothed and matched to the problem that a fit is given."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch

from solver.anchors import Anchor
from solver.das import DASRecord
from solver.das.rounding import Rounding
from solver.effects.trajectory import EFFECTS as TRAJECTORY
from solver.extension import SLOW_ERROR
from solver.fit import FitResult, Prior, Problem
from solver.fit.map_fit import SPLINE_VARIANCE
from solver.fit.windows import is_long, nearby
from solver.limits import FELT
from solver.matched_filter import Initialization
from solver.noise import noise_level, quiet, rounded_level
from solver.traffic import Traffic
from solver.trajectory import Pass
from solver.whitening import NoiseLaw, noise_law
from vision.contract import InputError

#: Channels that the noise's law is learned from, in the middle of a long fiber.
TYPICAL = 400
#: How long before and after each pass the record is looked at, s: what filters leave behind shows there.
TAIL = 4.0
#: An end where the route turns by more than this over a gauge length, rad, and the misfit exceeds this many times
#: that of the other channels, is a bend that the model does not hold for.
TURN, EXCESS = 0.2, 1.2

#: Channels without which there is no route to speak of: a cubic spline has four coefficients.
FEWEST = 4
#: An anchor farther along the road from the matched filter's line, m, is around a bend, or wrong.
OFF_LINE = 5.0
#: Positions out of view go on from the last ones in view: they err alike over many samples, which weigh as one.
UNSEEN = 3.0
#: Where tracks in view are this uncertain, m, their slow errors are fitted too.
UNCERTAIN = 0.05


def view_of(rough: Initialization, passes: Sequence[Pass]) -> np.ndarray:
    """First and last channel [2] in view, by the matched filter's line."""
    x = np.concatenate([one.position[one.in_view, 0] for one in passes])
    x0, slope = rough.x_of_channel
    return np.asarray(np.sort((np.array([x.min(), x.max()]) - x0) / slope))


def silent(record: DASRecord, ends: np.ndarray) -> str | None:
    """Say which channels between `ends` [2] record nothing; None where all do.

    What a channel repeats for more than half of the time is nothing; of gaps nothing is said.
    """
    inside = (record.channel >= ends[0]) & (record.channel <= ends[1])
    columns = np.flatnonzero(inside)
    # Block by block: of a long fiber every copy is a large part of the memory.
    blocks = np.array_split(columns, max(1, len(columns) // TYPICAL))
    told = record.measured[1:] & record.measured[:-1]
    changing = [(np.abs(np.diff(record.strain_rate[:, block], axis=0)[told]) > 0).mean(0) for block in blocks]
    dead = record.channel[columns][~(np.concatenate(changing) > 0.5)]
    if not len(dead):
        return None
    runs = np.split(dead, np.flatnonzero(np.diff(dead) != 1) + 1)
    names = ", ".join(str(run[0]) if len(run) == 1 else f"{run[0]} to {run[-1]}" for run in runs)
    return f"channels {names} record nothing; the route there hangs on their neighbors"


def straight_part(rough: Initialization, passes: Sequence[Pass], gauge: int, recorded: tuple[int, int]) -> slice:
    """Active channels to fit: without the last gauge length where the fiber leaves the road before the view ends.

    A gauge across a sharp bend feels both legs; the end-point difference of the base model does not hold there. Where
    the record ends within a gauge length of the active channels, nothing shows that the fiber leaves.

    Parameters
    ----------
    gauge : gauge length, channels
    recorded : first and last channel of the record
    """
    ends = view_of(rough, passes)
    first, last = max(ends[0], recorded[0] + gauge / 2), min(ends[1], recorded[1] - gauge / 2)
    leaves = (rough.active[0] - first > gauge / 2, last - rough.active[1] > gauge / 2)
    start, stop = gauge * leaves[0], len(rough.channel) - gauge * leaves[1]
    return slice(start, stop) if stop - start > 2 * gauge else slice(None)


def guessed_less(one: Pass) -> Pass:
    """The pass with its positions out of view weighing less."""
    return replace(one, sigma=np.where(one.in_view[:, None], 1.0, UNSEEN) * one.sigma)


def start_route(rough: Initialization, lateral: np.ndarray, anchors: Sequence[Anchor]) -> np.ndarray:
    """Rough route [channel, 3] through the matched filter's line, moved onto the anchors where there are any."""
    route = np.column_stack([rough.route[:, 0], lateral, rough.route[:, 2]])
    if not anchors:
        return route
    at = np.array([a.channel for a in anchors])
    # Lateral position and depth of the anchors are better than any start; x keeps the slope of the line.
    for axis, name in enumerate("yz", 1):
        route[:, axis] = np.interp(rough.channel, at, [getattr(a, name) for a in anchors])
    x0, slope = rough.x_of_channel
    miss = np.array([a.x for a in anchors]) - (x0 + slope * at)
    on_line = np.abs(miss) < OFF_LINE
    if on_line.any():
        route[:, 0] += miss[on_line].mean()
    return route


def pose(
    record: DASRecord,
    passes: Sequence[Pass],
    anchors: Sequence[Anchor],
    route: np.ndarray,
    channel: np.ndarray,
    prior: Prior,
    deaf: Sequence[int] | np.ndarray = (),
) -> Problem:
    """State the fitting problem over the active `channel` numbers but for `deaf` ones, from `route` [channel, 3] on."""
    column = np.searchsorted(record.channel, channel)
    whole = column[-1] - column[0] == len(column) - 1
    # A view where it can be: on a long fiber a copy is a large part of the memory.
    strain_rate = record.strain_rate[:, slice(column[0], column[-1] + 1) if whole else column]
    still = quiet(len(strain_rate), route, passes)
    rounding = record.rounding and record.rounding.at(column)
    noise = rounded_level(noise_level(strain_rate, still), strain_rate, still, rounding)
    alive = np.isfinite(noise) & (noise > 0) & ~np.isin(channel, deaf)
    if alive.sum() < FEWEST:
        raise InputError(
            f"DAS record: vehicles are told from noise in {alive.sum()} channels only, too few for a route; give "
            "more and heavier vehicles, or a record with more digits (roadfiber locate --filter fk finds fainter ones)"
        )
    kept = strain_rate if alive.all() else strain_rate[:, alive]
    passes = [guessed_less(part) for one in passes if (part := nearby(one, route)) is not None]
    if not passes:
        raise InputError(
            f"trajectories: no vehicle comes within {FELT:g} m of channels {channel[0]} to {channel[-1]}, "
            "where the DAS feels vehicles; check the frame (origin, x_azimuth) and the clocks"
        )
    traffic = Traffic.of(passes, around(passes, len(strain_rate), round(TAIL * record.sampling_rate)))
    return Problem(
        record=kept,
        noise=torch.from_numpy(noise[alive]),
        channel=channel[alive],
        recorded=len(record.channel),
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


def track_sigma(passes: Sequence[Pass]) -> float:
    """Uncertainty of the tracks in view by their own account, m: the median over passes."""
    spread = [float(np.sqrt((one.sigma[one.in_view] ** 2).mean())) for one in passes if one.in_view.any()]
    return float(np.median(spread)) if spread else 0.0


def with_slow_errors(problem: Problem) -> Problem:
    """The problem with each track's slow error among what is fitted, where the tracks are uncertain enough.

    On a long fiber each track has a shift of its own every few seconds already.
    """
    sigma = track_sigma(problem.passes)
    if is_long(problem) or sigma < UNCERTAIN or any(one.name == SLOW_ERROR for one in problem.effects):
        return problem
    effect = next(one for one in TRAJECTORY if one.name == SLOW_ERROR)
    prior = replace(problem.prior, jitter=sigma / SPLINE_VARIANCE**0.5)
    return replace(problem, effects=(*problem.effects, effect), prior=prior)


def around(passes: Sequence[Pass], samples: int, margin: int) -> np.ndarray:
    """Rows up to `margin` before and after each pass, within a record of so many samples.

    >>> around([], 10, 2)
    array([], dtype=int64)
    """
    rows = [np.arange(one.rows[0] - margin, one.rows[-1] + margin + 1) for one in passes]
    every = np.unique(np.concatenate(rows)) if rows else np.empty(0, np.int64)
    return every[(every >= 0) & (every < samples)]


def mean_square(result: FitResult, block: np.ndarray) -> np.ndarray:
    """Mean square of the residual of some fitted channels [channel], in noise units; NaN where nothing is fitted."""
    weight = result.weight[:, block]
    residual = (result.measured[:, block] - result.model[:, block]) / result.noise[block]
    total = weight.sum(0)
    return np.asarray(
        np.divide(np.nansum(weight * residual**2, 0), total, np.full(len(block), np.nan), where=total > 0)
    )


def bent_ends(result: FitResult, gauge: int) -> slice:
    """Fitted channels to keep: without the last gauge length where the fiber turns off and the model fails.

    Parameters
    ----------
    gauge : gauge length, channels
    """
    whole = slice(0, len(result.fitted_channel))
    if whole.stop <= 2 * gauge:
        return whole
    blocks = np.array_split(np.arange(whole.stop), max(1, whole.stop // TYPICAL))
    square = np.concatenate([mean_square(result, block) for block in blocks])
    route = result.route[np.isin(result.channel, result.fitted_channel)]
    direction = np.gradient(route, axis=0)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)

    def bent(inner: int, end: slice) -> bool:
        turn = np.arccos(np.clip(direction[end] @ direction[inner], -1, 1)).max()
        return bool(turn > TURN and np.nanmean(square[end]) > EXCESS * np.nanmedian(square))

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
