"""The fit of a drive: clock, polarity, channel map and loops in turn, until the clock stands still."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from solver.drive.along import Along, bends_of, smoothed_along, steps_of
from solver.drive.aside import Aside, beside
from solver.drive.car import Car, car_of
from solver.drive.channel_map import ChannelMap, against_traffic, map_channels
from solver.drive.coarse import Coarse, first_look
from solver.drive.drive import Drive
from solver.drive.likelihood import LEAST, Heard, heard
from solver.drive.loops import Loop, confirmed, flags_of, loops_of, sure
from solver.drive.path import BESIDE, STEP, Path, path_of
from solver.drive.picks import AUDIBLE, Picks, pick
from solver.drive.quiet import Quiet
from solver.drive.response import Legs, Responses, legs_of, responses
from solver.survey.anchors import Anchor
from vision.contract import InputError, progress

Array = NDArray[np.float64]

#: Cells to either side of where a channel is expected: in the first round, when a first look may have followed another
#: vehicle for some loops' lengths, and later.
FIRST, LATER = 700, 40
#: Rounds at most; s, or of its standard deviation, by which the clock moves in the last.
ROUNDS, STILL, SHARE = 8, 0.01, 0.25
#: Cells to either side in which the car's loudness is looked for.
LOOKED = 25
#: Channels over which an amplitude is typical.
NEIGHBORS = 40
#: Share of the channels beside which the car drove that hear it; below it, the drive is not found.
FOUND = 0.2
#: The same where another clock offset explains the record nearly as well, and how much better is clear.
UNSURE, CLEAR = 0.45, 1.15
#: Probability of another vehicle beyond which a channel has no pick.
OTHER = 0.5
#: Channels that hear the car go either way, from which on a drive checks its clock; and how much less sure the clock of
#: another is than its model has it, on simulated drives.
ENOUGH, ONCE = 5, 2.3
#: m, standard deviation that every channel has at least: load of the car off its middle, bends of the map.
FINEST = 0.4
#: m, spread of the channel map beyond which it holds more than one place.
SEVERAL = 3.0


@dataclass(frozen=True)
class Fit:
    """A drive, fitted.

    Parameters
    ----------
    quiet, path, car, legs : what was fitted
    coarse : the first look
    channels : posterior of the channel map
    picks, along : peaks, and their smoothing
    loops : of slack
    polarity : 1, or -1 where the record has the opposite sign
    clock_offset, clock_sigma : the record's clock less the GPS's, s
    cell, sigma : of each channel along the path, cells [channel]
    aside : of each channel
    beside : whether the car drove beside a channel [channel]
    rounds : until the clock stood still; `converged` whether it did
    """

    quiet: Quiet
    path: Path
    car: Car
    legs: Legs
    coarse: Coarse
    channels: ChannelMap
    picks: Picks
    along: Along
    loops: list[Loop]
    polarity: int
    clock_offset: float
    clock_sigma: float
    cell: Array
    sigma: Array
    aside: Aside
    beside: NDArray[np.bool_]
    rounds: int
    converged: bool

    @property
    def audible(self) -> NDArray[np.bool_]:
        """Whether a channel hears the car on any leg [channel]."""
        return np.asarray(self.picks.audible[: self.legs.count].any(0))

    @property
    def both_ways(self) -> bool:
        """Whether the car was heard both ways, so that the clock is told from a shift along the path."""
        return heard_both_ways(self.picks)


def heard_both_ways(picks: Picks) -> bool:
    """Whether enough channels hear the car go either way."""
    ways = (picks.audible & (picks.speed > 0)).sum(), (picks.audible & (picks.speed < 0)).sum()
    return bool(min(ways) >= ENOUGH)


@dataclass(frozen=True)
class Round:
    """One round of a fit."""

    legs: Legs
    channels: ChannelMap
    picks: Picks
    along: Along
    loops: list[Loop]


def fit_drive(drive: Drive) -> Fit:
    """Fit a drive.

    Raises
    ------
    InputError
        If clocks do not overlap, the map is of another place, or the car is not heard.
    """
    drive.check_clocks()
    drive.check_near()
    quiet = drive.quiet()
    car = car_of(drive.tracks, quiet.start)
    with progress("locating channels", ROUNDS + 2) as advance:
        coarse = first_look(quiet, path_of(drive.vertices), car, drive.length_factor[0])
        advance(1)
        offset, expected, side = coarse.clock_offset, coarse.cell, FIRST
        rounds, polarity, still = 0, coarse.polarity, False
        while rounds < ROUNDS and not still:
            one = one_round(drive, quiet, coarse.path, car, offset, expected, polarity, side)
            check_found(drive, quiet, coarse, one)
            expected, side = one.along.cell, LATER
            offset += one.along.clock
            still = abs(one.along.clock) <= max(STILL, SHARE * one.along.clock_sigma)
            rounds += 1
            advance(1)
    legs = one.legs
    aside = beside(
        quiet, coarse.path, car, legs, one.along.cell, one.picks.audible[: legs.count], polarity, drive.sigma
    )
    several = np.where(one.channels.spread * STEP > SEVERAL, one.channels.spread, 0.0)
    # Where the map bends the cable's heading is not sure, nor what lies square to the car.
    number = np.clip(np.round(one.along.cell).astype(np.int64), 0, len(coarse.path.points) - 1)
    heading = coarse.path.spread_of_heading(drive.sigma)[number]
    askew = heading * np.hypot(aside.far, aside.sigma) / STEP
    less_sure = 1.0 if heard_both_ways(one.picks) else ONCE
    clock = np.sqrt(less_sure**2 - 1) * one.along.clock_sigma * one.along.lean
    return Fit(
        quiet=quiet,
        path=coarse.path,
        car=car,
        legs=legs,
        coarse=coarse,
        channels=one.channels,
        picks=one.picks,
        along=one.along,
        loops=confirmed(one.loops, np.asarray(one.picks.audible.any(0)), quiet.channel_spacing),
        polarity=polarity,
        clock_offset=offset,
        clock_sigma=less_sure * one.along.clock_sigma,
        cell=one.along.cell,
        sigma=np.sqrt(one.along.sigma**2 + clock**2 + several**2 + askew**2 + (FINEST / STEP) ** 2),
        aside=aside,
        beside=beside_car(coarse.path, legs, one.along.cell),
        rounds=rounds,
        converged=still,
    )


def one_round(
    drive: Drive, quiet: Quiet, path: Path, car: Car, offset: float, expected: Array, polarity: int, side: int
) -> Round:
    """Map the channels with one clock offset, and find the offset that is left."""
    spacing, factor = quiet.channel_spacing, drive.length_factor[0]
    legs = legs_of(quiet, path, car, offset)
    if not legs.near.any():
        raise InputError(
            f"route: the car is never within {BESIDE:.0f} m of the map while the record runs; check the map and the "
            "coordinate systems"
        )
    of = responses(quiet, path, car, legs)
    low = np.round(expected).astype(np.int64) - side
    floor = loudness(quiet, of, legs, expected, polarity)
    found = heard(quiet, of, low, 2 * side + 1, polarity, floor)
    found = with_anchors(replace(found, ratio=against_traffic(found.ratio)), drive.anchors, quiet, path)
    bend = bends_of(path, expected, spacing, drive.sigma)
    channels = map_channels(found, quiet.dead, spacing, factor, bend)
    flags, middle = sure(channels), channels.best.astype(float)
    for _ in range(2):
        picks = pick(quiet, of, legs, middle, polarity, floor, quiet.dead | flags | (channels.other > OTHER))
        picks = beside_loops(picks, flags, quiet.gauge_length, spacing)
        picks = anchored(picks, drive.anchors, quiet, path)
        steps = steps_of(path, middle, flags, channels.in_loop, spacing, factor, drive.sigma)
        along = smoothed_along(picks, legs, steps, drive.length_factor[1], (car.memory, car.sigma), spacing)
        loops = loops_of(channels, along, spacing, factor, quiet.gauge_length)
        flags = flags_of(loops, len(flags))
    return Round(legs, channels, picks, along, loops)


def loudness(quiet: Quiet, of: Responses, legs: Legs, expected: Array, polarity: int) -> Array:
    """Least amplitude [channel, leg] of the car on a channel, from what is heard near where it is expected."""
    nothing = np.zeros((len(quiet.channel), legs.count))
    low = np.round(expected).astype(np.int64) - LOOKED
    floor = nothing.copy()
    for leg in range(legs.count):
        one = heard(quiet, of, low, 2 * LOOKED + 1, polarity, nothing, leg)
        best = one.ratio.argmax(1)
        loud = one.amplitude[np.arange(len(best)), best].astype(float)
        loud[(one.ratio.max(1) < AUDIBLE) | quiet.dead] = np.nan
        floor[:, leg] = LEAST * typical(loud)
    return floor


def typical(values: Array) -> Array:
    """Median of neighbors [channel], NaN left out; 0 where fewer than a third are numbers."""
    size = 2 * NEIGHBORS + 1
    padded = np.pad(values, NEIGHBORS, constant_values=np.nan)
    windows = np.lib.stride_tricks.sliding_window_view(padded, size)
    known = np.isfinite(windows).sum(1)
    found = np.zeros(len(values))
    some = known >= size // 3
    if some.any():
        found[some] = np.nanmedian(windows[some], axis=1)
    return found


def place_of(anchor: Anchor, quiet: Quiet, path: Path) -> tuple[float, int, float]:
    """Index of an anchor's channel, its cell, and its sigma along the path, cells."""
    cell, _ = path.nearest(np.array([[anchor.x, anchor.y]]))
    return anchor.channel - float(quiet.channel[0]), int(cell[0]), anchor.sigma_xy / STEP


def with_anchors(found: Heard, anchors: list[Anchor], quiet: Quiet, path: Path) -> Heard:
    """Likelihoods with those of anchors."""
    ratio = found.ratio.copy()
    for anchor in anchors:
        at, cell, sigma = place_of(anchor, quiet, path)
        index = round(at)
        if 0 <= index < len(ratio):
            cells = found.low[index] + np.arange(ratio.shape[1])
            spread = np.hypot(sigma, quiet.channel_spacing / STEP / 2)
            ratio[index] += np.maximum(30.0 - 0.5 * ((cells - cell) / spread) ** 2, -30.0)
    return replace(found, ratio=ratio)


def anchored(picks: Picks, anchors: list[Anchor], quiet: Quiet, path: Path) -> Picks:
    """Picks with a leg of anchors behind the car's, without clock or error of the car; none where there are none."""
    if not anchors:
        return picks
    shape = (1, picks.cell.shape[1])
    cell, sigma = np.full(shape, np.nan), np.full(shape, np.nan)
    for anchor in anchors:
        at, where, spread = place_of(anchor, quiet, path)
        index = round(at)
        if 0 <= index < shape[1]:
            cell[0, index] = where + (index - at) * quiet.channel_spacing / STEP
            sigma[0, index] = max(spread, 0.3)
    nothing = np.zeros(shape)
    return Picks(
        cell=np.concatenate([picks.cell, cell]),
        sigma=np.concatenate([picks.sigma, sigma]),
        speed=np.concatenate([picks.speed, nothing]),
        row=np.concatenate([picks.row, np.full(shape, -1)]),
        amplitude=np.concatenate([picks.amplitude, nothing]),
        ratio=np.concatenate([picks.ratio, nothing]),
    )


def beside_loops(picks: Picks, flags: NDArray[np.bool_], gauge_length: float, spacing: float) -> Picks:
    """Picks next to loops are less sure: part of their gauge lies in the loop."""
    reach = int(np.ceil(gauge_length / 2 / spacing))
    near = np.convolve(flags, np.ones(2 * reach + 1), "same") > 0
    return replace(picks, sigma=np.where(near, np.hypot(picks.sigma, gauge_length / 4 / STEP), picks.sigma))


def beside_car(path: Path, legs: Legs, cell: Array) -> NDArray[np.bool_]:
    """Whether the car drove beside a channel [channel]."""
    driven = np.zeros(len(path.points) + 1, bool)
    driven[np.unique(legs.cell[legs.near])] = True
    # At 30 m/s it is beside every thirtieth cell or so at each sample.
    wide = np.convolve(driven, np.ones(21), "same") > 0
    return np.asarray(wide[np.clip(np.round(cell).astype(np.int64), 0, len(path.points) - 1)])


def check_found(drive: Drive, quiet: Quiet, coarse: Coarse, one: Round) -> None:
    """Raise InputError where too few of the channels beside which the car drove hear it."""
    there = beside_car(coarse.path, one.legs, one.along.cell) & ~quiet.dead & ~one.channels.best_loop
    share = float(one.picks.audible[: one.legs.count, there].any(0).mean()) if there.any() else 0.0
    if share < FOUND or (share < UNSURE and coarse.score < CLEAR * coarse.rival):
        raise InputError(
            f"{drive.name}: only {100 * share:.0f} % of the channels beside which the car drove hear it: the record "
            "does not follow this drive; check the times, the map, and which cable is recorded"
        )
