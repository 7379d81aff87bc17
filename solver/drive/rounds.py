"""Rounds of a drive's fit: channel map, picks and smoother in turn, until the clock stands still."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from solver.drive.along import QUARTZ, Along, bends_of, smoothed_along, steps_of
from solver.drive.anchored import anchored, with_anchors
from solver.drive.car import Car
from solver.drive.channel_map import ChannelMap, against_traffic, map_channels
from solver.drive.coarse import Coarse
from solver.drive.drive import Drive
from solver.drive.likelihood import heard
from solver.drive.loops import Loop, flags_of, loops_of, sure
from solver.drive.loudness import loudness
from solver.drive.misstated import DRIFT, SPACING, TOLD
from solver.drive.path import BESIDE, STEP, Path
from solver.drive.picks import Picks, pick
from solver.drive.quiet import Quiet
from solver.drive.response import Clock, Legs, legs_of, responses
from solver.drive.timing import clock_of_shapes
from solver.drive.waterfall import SeenDrive
from solver.start.alignment import NotFollowingError
from vision.contract import InputError

Array = NDArray[np.float64]
Advance = Callable[[int], None]

#: Cells to either side of where a channel is expected: in the first round, when a first look may have followed another
#: vehicle for some loops' lengths, and later.
FIRST, LATER = 700, 40
#: Rounds at most; s, or of its standard deviation, by which the clock moves in the last two: it may halt once where
#: loops change, and may go to and fro between two ways to have them.
ROUNDS, STILL, SHARE = 12, 0.02, 0.3
#: Share of the channels beside which the car drove that hear it; below it, the drive is not found.
FOUND = 0.2
#: The same where another clock offset explains the record nearly as well.
UNSURE = 0.45
#: Probability of another vehicle beyond which a channel has no pick.
OTHER = 0.5


@dataclass(frozen=True)
class Round:
    """One round of a fit; `told` is what shapes of picks say of the clock, and the standard deviation of that, s."""

    legs: Legs
    channels: ChannelMap
    picks: Picks
    along: Along
    loops: list[Loop]
    told: tuple[float, float]


@dataclass(frozen=True)
class Settled:
    """The last round of a fit whose clock stands still, or whose rounds ended; `count` of them."""

    last: Round
    clock: Clock
    count: int
    still: bool


def settled(
    drive: Drive, quiet: Quiet, coarse: Coarse, car: Car, clock: Clock, expected: Array, side: int, advance: Advance
) -> Settled:
    """Rounds from a clock and expected cells [channel], sought within `side` at first, until the clock stands still."""
    half, rounds, still = quiet.time[-1] / 2, 0, False
    last = (np.inf, np.inf)
    while rounds < ROUNDS and not still:
        one = one_round(drive, quiet, coarse.path, car, clock, expected, coarse.polarity, side)
        check_found(drive, quiet, coarse, one)
        along, drifts = one.along, DRIFT in drive.effects
        expected, side = along.cell, LATER
        clock = Clock(clock.offset + along.clock, clock.drift + along.drift * drifts)
        still = abs(last[0] + along.clock) <= max(STILL, SHARE * along.clock_sigma)
        if drifts:
            still &= abs(last[1] + along.drift) <= max(STILL / half, SHARE * along.drift_sigma)
        last = along.clock, along.drift
        rounds += 1
        advance(1)
    return Settled(one, clock, rounds, bool(still))


def one_round(
    drive: Drive, quiet: Quiet, path: Path, car: Car, clock: Clock, expected: Array, polarity: int, side: int
) -> Round:
    """Map the channels with one clock, and find the offset that is left."""
    spacing, factor, factor_sigma = quiet.channel_spacing, drive.length_factor[0], length_sigma_of(drive)
    drift = TOLD[DRIFT].parameters[0].plausible if DRIFT in drive.effects else QUARTZ
    legs = legs_of(quiet, path, car, clock)
    if not legs.near.any():
        raise InputError(
            f"route: the car is never within {BESIDE:.0f} m of the map while the record runs; check the map and the "
            "coordinate systems"
        )
    of = responses(quiet, path, car, legs)
    low = np.round(expected).astype(np.int64) - side
    floor, usual = loudness(quiet, of, legs, expected, polarity)
    found = heard(quiet, of, low, 2 * side + 1, polarity, floor, usual=usual)
    found = with_anchors(replace(found, ratio=against_traffic(found.ratio)), drive.anchors, quiet, path)
    bend = bends_of(path, expected, spacing, drive.sigma)
    channels = map_channels(found, quiet.dead, spacing, factor, bend)
    flags, middle = sure(channels), channels.likeliest.astype(float)
    for again in range(2):
        silent = quiet.dead | flags | (channels.other > OTHER)
        picks = pick(quiet, of, legs, middle, polarity, floor, silent)
        picks = beside_loops(picks, flags, quiet.gauge_length, spacing)
        if not again:
            # Heard both ways, places tell the clock so much better that shapes are not worth their time.
            shapes = (0.0, np.inf) if picks.both_ways else None
            told = shapes or clock_of_shapes(quiet, path, car, legs, clock, picks, polarity, floor)
        picks = anchored(picks, drive.anchors, quiet, path)
        steps = steps_of(path, middle, flags, channels.in_loop, spacing, factor, drive.sigma)
        along = smoothed_along(picks, legs, steps, factor_sigma, (car.memory, car.sigma), spacing, drift, told)
        loops = loops_of(channels, along, spacing, factor, quiet.gauge_length)
        flags = flags_of(loops, len(flags))
    return Round(legs, channels, picks, along, loops, told)


def length_sigma_of(drive: Drive) -> float:
    """Standard deviation of the length factor, with that of the channel spacing if it is fitted."""
    factor, sigma = drive.length_factor
    if SPACING not in drive.effects:
        return sigma
    return float(np.hypot(sigma, factor * TOLD[SPACING].parameters[0].plausible))


def beside_loops(picks: Picks, flags: NDArray[np.bool_], gauge_length: float, spacing: float) -> Picks:
    """Picks next to loops are less sure: part of their gauge lies in the loop."""
    reach = int(np.ceil(gauge_length / 2 / spacing))
    near = np.convolve(flags, np.ones(2 * reach + 1), "same") > 0
    return replace(picks, sigma=np.where(near, np.hypot(picks.sigma, gauge_length / 4 / STEP), picks.sigma))


def driven_beside(path: Path, legs: Legs) -> NDArray[np.bool_]:
    """Whether the car drove beside each cell [cell]."""
    driven = np.zeros(len(path.points), bool)
    driven[np.unique(legs.cell[legs.near])] = True
    # At 30 m/s it is beside every thirtieth cell or so at each sample.
    return np.asarray(np.convolve(driven, np.ones(21), "same") > 0)


def beside_car(path: Path, legs: Legs, cell: Array) -> NDArray[np.bool_]:
    """Whether the car drove beside a channel [channel]."""
    return driven_beside(path, legs)[np.clip(np.round(cell).astype(np.int64), 0, len(path.points) - 1)]


def channels_beside(drive: Drive, quiet: Quiet, path: Path, legs: Legs) -> int:
    """Channels that the car drove beside, by the map: as many as its way takes, of those that there are.

    A fit that hears little may lay all the rest of the cable into loops, and be right of what is left.
    """
    inside = slice(path.first, path.first + round(path.length / STEP) + 1)
    way = float(driven_beside(path, legs)[inside].sum()) * STEP * drive.length_factor[0]
    return min(round(way / quiet.channel_spacing * float((~quiet.dead).mean())), int((~quiet.dead).sum()))


def check_found(drive: Drive, quiet: Quiet, coarse: Coarse, one: Round) -> None:
    """Raise NotFollowingError where too few of the channels beside which the car drove hear it."""
    there = beside_car(coarse.path, one.legs, one.along.cell) & ~quiet.dead & ~one.channels.loop
    count = int(one.picks.audible[: one.legs.count, there].any(0).sum())
    beside = max(int(there.sum()), channels_beside(drive, quiet, coarse.path, one.legs))
    share, needed = count / max(beside, 1), FOUND if coarse.told_apart else UNSURE
    if share >= needed:
        return
    why = "" if coarse.told_apart else ", as another clock offset explains the record nearly as well"
    words = (
        f"{count} of the {beside} channels beside which the car drove hear it, "
        f"{100 * needed:.0f} % are needed{why}; the car as expected with the best clock offset, "
        f"{coarse.clock_offset:+.1f} s, is the line"
    )
    raise NotFollowingError(
        f"{drive.name}: only {100 * share:.0f} % of the channels beside which the car drove hear it "
        f"({100 * needed:.0f} % are needed{why}): the record does not follow this drive; check the times, the map, and "
        "which cable is recorded",
        SeenDrive.of(words, quiet, one.legs, coarse.cell),
    )
