"""First look at a drive: the clock, the direction of the map, and about which channel lies where.

What a matched filter hears on each few channels is compared with when the car was where. For each clock offset a
monotone path through that comparison is found by dynamic programming: its score is highest where the clock is right.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from solver.drive.car import Car
from solver.drive.path import BESIDE, STEP, Path
from solver.drive.quiet import Quiet
from solver.ground.boussinesq import displacement_rate
from solver.ground.compiled import compiled

Array = NDArray[np.float64]

#: s, about the length of a bin of time, and the offsets that are tried.
BIN, WINDOW = 0.5, 120.0
#: m of cable that are looked at as one at least, and how many such pieces there are at most.
PIECE, PIECES = 10.0, 1500
#: Matched filter: speeds, m/s, distance and depth of the fiber, reach along it, m.
SPEEDS, ASIDE, DEPTH, REACH = (3.5, 7.0, 12.0, 20.0), 4.5, 0.9, 22.0
#: Output, noise sigmas, that is typical of noise in a bin.
TYPICAL = 1.3
#: What noise scores, and the bounds of a score: a companion is as loud as the car, and louder on a stretch, but not all
#: the way; what is heard a little everywhere must outweigh it.
COST, LEAST, MOST = 4.0, -1.0, 2.0
#: Score of a loop's begin, of each piece in it, and of a piece left out.
LOOP, INSIDE, SKIP = -12.0, -0.3, -10.0
#: m/s; slower, the car strains nothing.
SLOW = 1.0


@dataclass(frozen=True)
class Coarse:
    """What a first look tells.

    Parameters
    ----------
    clock_offset : the record's clock less the GPS's, s
    path : turned as the channels run
    cell : [channel], about which cell of the path each lies at
    score : of the best offset, per piece that the car passed
    rival : score of the best offset 3 s or more away
    reversed : whether the map runs against the channels
    polarity : 1, or -1 where the record has the opposite sign
    """

    clock_offset: float
    path: Path
    cell: Array
    score: float
    rival: float
    reversed: bool
    polarity: int


@dataclass(frozen=True)
class Passages:
    """When the car was in each piece of the path: `bins` of time and their `share` of a visit, CSR by piece."""

    begin: NDArray[np.int64]
    bins: NDArray[np.int64]
    share: Array


def piece_of(quiet: Quiet) -> int:
    """Channels that are looked at as one."""
    total = quiet.channel_spacing * len(quiet.channel)
    return max(1, round(max(PIECE, total / PIECES) / quiet.channel_spacing))


def shapes(quiet: Quiet) -> list[Array]:
    """Whitened strain rate of a car that goes by at each of `SPEEDS`, of unit energy, [sample] each.

    It is the same for both directions: strain is even in the distance along the fiber.
    """
    half = quiet.gauge_length / 2
    found = []
    for speed in SPEEDS:
        steps = int(np.ceil((REACH + half) / speed * quiet.rate))
        x = speed * np.arange(-steps - len(quiet.whitener), steps + 1) / quiet.rate
        velocity = torch.tensor([speed, 0.0], dtype=torch.float64).expand(len(x), 2)
        rate = np.zeros(len(x))
        for sign in (1, -1):
            offset = np.column_stack([sign * half - x, np.full(len(x), ASIDE), np.full(len(x), DEPTH)])
            rate += sign * displacement_rate(torch.from_numpy(offset), velocity.contiguous(), 0.25).numpy()[:, 0]
        white = np.convolve(rate, quiet.whitener)[len(quiet.whitener) : len(rate)]
        found.append(white / np.linalg.norm(white))
    return found


def matched(quiet: Quiet, rows: slice, kernels: list[Array]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Highest and lowest output of the matched filters, noise sigmas [channel, time]."""
    from scipy.signal import oaconvolve

    values = quiet.values[rows]
    high, low = np.zeros_like(values), np.zeros_like(values)
    for kernel in kernels:
        out = oaconvolve(values, kernel[None, ::-1].astype(np.float32), mode="same", axes=1)
        np.maximum(high, out, out=high)
        np.minimum(low, out, out=low)
    return high, -low


def match_scores(quiet: Quiet, count: int) -> tuple[Array, int]:
    """Score [piece, bin] of a car going by, bounded so that traffic counts no more than the car; and the polarity."""
    per = bin_of(quiet.rate)
    pieces, bins = len(quiet.channel) // count, quiet.values.shape[1] // per
    both, kernels = np.zeros((2, pieces, bins)), shapes(quiet)
    weight = np.zeros(2)
    for piece in range(pieces):
        part = slice(piece * count, (piece + 1) * count)
        live = ~quiet.dead[part]
        if not live.any():
            continue
        for sign, out in enumerate(matched(quiet, part, kernels)):
            top = out[live, : bins * per].reshape(live.sum(), bins, per).max(2)
            top /= max(1.0, float(np.median(top)) / TYPICAL)
            # The loudest moment of a channel has the right sign, be it of the car or of another vehicle.
            weight[sign] += float(np.log(np.maximum(top.max(1), 1.0)).sum())
            both[sign, piece] = np.clip(0.5 * (top**2).mean(0) - COST, LEAST, MOST)
    polarity = 1 if weight[0] >= weight[1] else -1
    return both[0 if polarity > 0 else 1], polarity


def bin_of(rate: float) -> int:
    """Samples in a bin of time, at a sampling rate, Hz."""
    return max(1, round(BIN * rate))


def passages(path: Path, car: Car, first: float, last: float, width: float, step: float) -> Passages:
    """When the car, by the GPS, was in each piece of the path of `width` m, in bins of `step` s since `first`."""
    time = np.arange(first, last, step)
    driven = car.at(time)
    cell, far = path.nearest(driven.position)
    there = driven.known & (far < BESIDE) & (driven.speed > SLOW)
    piece = np.floor(cell * STEP / width).astype(np.int64)
    rows = np.flatnonzero(there)
    if not len(rows):
        count = int(len(path.points) * STEP / width) + 1
        return Passages(np.zeros(count + 1, np.int64), np.zeros(0, np.int64), np.zeros(0))
    # A visit is a run of bins in one piece; each counts once, however long it lasts.
    fresh = np.concatenate([[True], (np.diff(rows) > 20) | (np.diff(piece[rows]) != 0)])
    visit = np.cumsum(fresh) - 1
    share = 1.0 / np.bincount(visit)[visit]
    order = np.argsort(piece[rows], kind="stable")
    count = int(len(path.points) * STEP / width) + 1
    begin = np.searchsorted(piece[rows][order], np.arange(count + 1))
    return Passages(begin, rows[order], share[order])


@cache
def dynamic_program() -> Any:
    """`best(scores, begin, bins, share, shift, trace)`: score of the best monotone path, and where it runs."""

    def best(scores: Any, begin: Any, bins: Any, share: Any, shift: int, trace: Any) -> tuple[float, int, int]:
        pieces, length = scores.shape
        places = len(begin) - 1
        straight = np.zeros(places)
        loop = np.full(places, -1e9)
        following, looping = np.empty(places), np.empty(places)
        keep = trace.shape[0] > 0
        for piece in range(pieces):
            for place in range(places):
                heard = 0.0
                for index in range(begin[place], begin[place + 1]):
                    at = bins[index] + shift
                    if 0 <= at < length:
                        heard += share[index] * scores[piece, at]
                if piece == 0:
                    following[place], looping[place] = heard, LOOP
                    continue
                if place >= 1:
                    value, how = straight[place - 1], 0
                    if loop[place - 1] > value:
                        value, how = loop[place - 1], 1
                    if place >= 2 and straight[place - 2] + SKIP > value:
                        value, how = straight[place - 2] + SKIP, 2
                else:
                    value, how = -1e9, 0
                following[place] = value + heard
                stay, begun = loop[place] + INSIDE, straight[place] + LOOP
                looping[place] = max(stay, begun)
                if keep:
                    trace[piece, place, 0] = how
                    trace[piece, place, 1] = 1 if stay >= begun else 0
            straight, following = following, straight
            loop, looping = looping, loop
        end = 0
        for place in range(places):
            if straight[place] > straight[end]:
                end = place
        last = 0
        for place in range(places):
            if loop[place] > loop[last]:
                last = place
        if loop[last] > straight[end]:
            return loop[last], last, 1
        return straight[end], end, 0

    return compiled(best)


def traced(trace: NDArray[np.int8], end: int, mode: int) -> NDArray[np.int64]:
    """Place of each piece [piece] along the best path."""
    found = np.zeros(len(trace), np.int64)
    place = end
    for piece in range(len(trace) - 1, -1, -1):
        found[piece] = place
        if mode == 1:
            mode = int(trace[piece, place, 1])
            continue
        how = int(trace[piece, place, 0])
        place = max(0, place - (2 if how == 2 else 1))
        mode = 1 if how == 1 else 0
    return found


def first_look(quiet: Quiet, path: Path, car: Car, factor: float) -> Coarse:
    """Find the clock offset within `WINDOW`, the map's direction, and about where each channel lies.

    Parameters
    ----------
    quiet : the whitened record
    path : the map
    car : the GPS car
    factor : meters of cable per meter of map
    """
    count = piece_of(quiet)
    scores, polarity = match_scores(quiet, count)
    width = count * quiet.channel_spacing / factor
    step = bin_of(quiet.rate) / quiet.rate
    shifts = np.arange(-round(WINDOW / step), round(WINDOW / step) + 1)
    first, last = car.time[0], car.time[-1]
    offset = round(first / step)
    best, nothing = dynamic_program(), np.zeros((0, 1, 2), np.int8)
    found = []
    for turned in (False, True):
        way = path.turned() if turned else path
        visits = passages(way, car, offset * step, last, width, step)
        arrays = (visits.begin, visits.bins, visits.share)
        each = np.array([best(scores, *arrays, int(shift) + offset, nothing)[0] for shift in shifts])
        found.append((each, way, arrays, int((np.diff(visits.begin) > 0).sum())))
    turned = bool(found[1][0].max() > found[0][0].max())
    each, way, arrays, passed = found[turned]
    index = int(each.argmax())
    trace = np.zeros((len(scores), len(arrays[0]) - 1, 2), np.int8)
    _, end, mode = best(scores, *arrays, int(shifts[index]) + offset, trace)
    place = traced(trace, end, mode)
    middle = (np.arange(len(place)) + 0.5) * count - 0.5
    cell = np.interp(np.arange(len(quiet.channel)), middle, (place + 0.5) * width / STEP)
    beyond = np.arange(len(quiet.channel)) - np.clip(np.arange(len(quiet.channel)), middle[0], middle[-1])
    cell = cell + beyond * quiet.channel_spacing / factor / STEP
    away = np.abs(shifts - shifts[index]) * step >= 3
    rival = max(float(each[away].max()), float(found[not turned][0].max()))
    return Coarse(
        clock_offset=float(shifts[index] * step),
        path=way,
        cell=cell,
        score=float(each[index]) / max(1, passed),
        rival=rival / max(1, passed),
        reversed=turned,
        polarity=polarity,
    )
