"""First look at a drive: the clock, the direction of the map, and about which channel lies where.

What a matched filter hears on each few channels is compared with when the car was where. For each clock offset a
monotone path through that comparison is found by dynamic programming: its score is highest where the clock is right.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from solver.drive.car import Car
from solver.drive.monotone_path import NEVER, Passages, dynamic_program, passages, traced
from solver.drive.path import STEP, Path
from solver.drive.quiet import Quiet
from solver.ground.boussinesq import displacement_rate

Array = NDArray[np.float64]

#: s, about the length of a bin of time, and the offsets that are tried.
BIN, WINDOW = 0.5, 120.0
#: m of cable that are looked at as one at least, and how many such pieces there are at most; pieces that tell polarity.
PIECE, PIECES, ASKED = 10.0, 5000, 400
#: Matched filter: speeds, m/s, distance and depth of the fiber, reach along it, m.
SPEEDS, ASIDE, DEPTH, REACH = (3.5, 7.0, 12.0, 20.0), 4.5, 0.9, 22.0
#: Output, noise sigmas, that is typical of noise in a bin.
TYPICAL = 1.3
#: What noise scores, and the bounds of a score: a companion is as loud as the car, and louder on a stretch, but not all
#: the way; what is heard a little everywhere must outweigh it.
COST, LEAST, MOST = 4.0, -1.0, 2.0
#: Pieces of map that clock offsets are told by, in so many stretches of a longer drive; how many offsets are then tried
#: on all of it; and s apart from which they are others.
TOLD, STRETCHES, TRIED, APART = 400, 2, 6, 3.0
#: Offsets that are looked at closely at most, and by how much less than the best, per piece, others score that are.
MOST_LOOKS, NEARLY = 3, 0.15
#: By how much more probable, as log likelihood, one of them is that is told apart from the others.
LEAD = 25.0


@dataclass(frozen=True)
class Coarse:
    """What a first look tells.

    Parameters
    ----------
    clock_offset : the record's clock less the GPS's, s
    path : turned as the channels run
    cell : [channel], about which cell of the path each lies at
    reversed : whether the map runs against the channels
    polarity : 1, or -1 where the record has the opposite sign
    lead : how much more probable a close look makes it than the next that was looked at, as log likelihood; infinite
        where none was
    """

    clock_offset: float
    path: Path
    cell: Array
    reversed: bool
    polarity: int
    lead: float = np.inf

    @property
    def told_apart(self) -> bool:
        """Whether no other clock offset explains the record nearly as well."""
        return self.lead >= LEAD


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


def tops(quiet: Quiet, rows: slice, kernels: list[Array]) -> list[Array]:
    """Highest output of the matched filters, noise sigmas, of either sign [channel, bin]; channels that live."""
    per = bin_of(quiet.rate)
    bins = quiet.values.shape[1] // per
    live = ~quiet.dead[rows]
    found = []
    for out in matched(quiet, rows, kernels):
        top = out[live, : bins * per].reshape(live.sum(), bins, per).max(2)
        found.append(top / max(1.0, float(np.median(top)) / TYPICAL))
    return found


def match_scores(quiet: Quiet, count: int) -> tuple[NDArray[np.float32], int]:
    """Score [piece, bin] of a car going by, bounded so that traffic counts no more than the car; and the polarity."""
    pieces, kernels = len(quiet.channel) // count, shapes(quiet)
    parts = [slice(piece * count, (piece + 1) * count) for piece in range(pieces)]
    alive = [piece for piece in range(pieces) if not quiet.dead[parts[piece]].all()]
    weight = np.zeros(2)
    for piece in alive[:: -(-len(alive) // ASKED)]:
        # The loudest moment of a channel has the right sign, be it of the car or of another vehicle.
        weight += [np.log(np.maximum(top.max(1), 1.0)).sum() for top in tops(quiet, parts[piece], kernels)]
    sign = int(weight[1] > weight[0])
    scores = np.zeros((pieces, quiet.values.shape[1] // bin_of(quiet.rate)), np.float32)
    for piece in alive:
        top = tops(quiet, parts[piece], kernels)[sign]
        scores[piece] = np.clip(0.5 * (top**2).mean(0) - COST, LEAST, MOST)
    return scores, 1 - 2 * sign


def bin_of(rate: float) -> int:
    """Samples in a bin of time, at a sampling rate, Hz."""
    return max(1, round(BIN * rate))


@dataclass(frozen=True)
class Way:
    """The path in one of its directions, when the car was where on it, and the score of each clock offset [shift].

    Scores are of the whole drive; `NEVER` where an offset was not tried.
    """

    path: Path
    visits: Passages
    scores: Array

    @property
    def arrays(self) -> tuple[NDArray[Any], ...]:
        """Arguments of the dynamic program."""
        return self.visits.begin, self.visits.bins, self.visits.share


def tried(
    scores: NDArray[np.float32], ways: list[Passages], shifts: NDArray[np.int64], apart: int
) -> NDArray[np.bool_]:
    """Which offsets are worth a look at the whole drive [way, shift]: all of a short one.

    Else those that explain stretches of it best, be they where they may along the cable: at a cost that grows with its
    length, not with its square.
    """
    found = np.ones((len(ways), len(shifts)), bool)
    if max(int((np.diff(one.begin) > 0).sum()) for one in ways) <= TOLD:
        return found
    best, nothing = dynamic_program(), np.zeros((0, 1, 2), np.int8)
    told = np.zeros(found.shape)
    for number, one in enumerate(ways):
        passed = np.flatnonzero(np.diff(one.begin) > 0)
        for middle in (np.arange(STRETCHES) + 0.5) / STRETCHES * len(passed):
            first = max(0, round(middle) - TOLD // STRETCHES // 2)
            last = min(len(passed), first + TOLD // STRETCHES)
            begin = one.begin[passed[first] : passed[last - 1] + 2]
            told[number] += [best(scores, begin, one.bins, one.share, int(at), 0.0, nothing)[0] for at in shifts]
    found[:] = False
    for _ in range(TRIED):
        way, index = divmod(int(told.argmax()), len(shifts))
        found[way, max(0, index - 1) : index + 2] = True
        told[way, max(0, index - apart) : index + apart + 1] = NEVER
    return found


def looks(quiet: Quiet, path: Path, car: Car, factor: float) -> list[Coarse]:
    """Clock offsets within `WINDOW`, with the map's direction and about where each channel lies; the best first.

    Others follow that score so nearly as well that they are to be told apart by more than scores.

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
    first, last = car.time[0], car.time[-1]
    offset = round(first / step)
    shifts = np.arange(-round(WINDOW / step), round(WINDOW / step) + 1)
    apart = int(np.ceil(APART / step))
    best, nothing = dynamic_program(), np.zeros((0, 1, 2), np.int8)
    both = [path, path.turned()]
    visits = [passages(one, car, offset * step, last, width, step) for one in both]
    worth = tried(scores, visits, shifts + offset, apart)
    ways = []
    for one, when, some in zip(both, visits, worth, strict=True):
        each = np.full(len(shifts), NEVER)
        arrays = (when.begin, when.bins, when.share)
        each[some] = [best(scores, *arrays, int(at) + offset, NEVER, nothing)[0] for at in shifts[some]]
        ways.append(Way(one, when, each))
    passed = max(1, int((np.diff(ways[0].visits.begin) > 0).sum()))
    tops = peaks_of(np.stack([one.scores for one in ways]) / passed, apart)
    found = []
    for number, (turned, index, _) in enumerate(tops[:MOST_LOOKS]):
        way = ways[turned]
        trace = np.zeros((len(scores), len(way.visits.begin) - 1, 2), np.int8)
        _, end, mode = best(scores, *way.arrays, int(shifts[index]) + offset, NEVER, trace)
        found.append(
            Coarse(
                clock_offset=float(shifts[index] * step),
                path=way.path,
                cell=cells_of(quiet, traced(trace, end, mode), count, width, factor),
                reversed=bool(turned),
                polarity=polarity,
            )
        )
        if tops[number + 1][2] < tops[0][2] - NEARLY:
            break
    return found


def peaks_of(scores: Array, apart: int) -> list[tuple[int, int, float]]:
    """Way, index and score of the highest scores [way, shift], each `apart` shifts from those before; the best first.

    >>> peaks_of(np.array([[0.0, 5.0, 4.0, 0.0, 3.0], [1.0, 0.0, 0.0, 0.0, 2.0]]), 2)[:3]
    [(0, 1, 5.0), (0, 4, 3.0), (1, 4, 2.0)]
    """
    left, found = scores.copy(), []
    for _ in range(MOST_LOOKS + 1):
        way, index = divmod(int(left.argmax()), left.shape[1])
        found.append((way, index, float(left[way, index])))
        left[way, max(0, index - apart + 1) : index + apart] = NEVER
    return found


def cells_of(quiet: Quiet, place: NDArray[np.int64], count: int, width: float, factor: float) -> Array:
    """About the cell of each channel [channel], from the place of each piece [piece] of `count` channels."""
    number = np.arange(len(quiet.channel))
    middle = (np.arange(len(place)) + 0.5) * count - 0.5
    cell = np.interp(number, middle, (place + 0.5) * width / STEP)
    beyond = number - np.clip(number, middle[0], middle[-1])
    return np.asarray(cell + beyond * quiet.channel_spacing / factor / STEP)
