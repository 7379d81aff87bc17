"""The fit of a drive: clock, polarity, channel map and loops in turn, until the clock stands still."""

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from solver.drive.along import Along, smoothed_along, steps_of
from solver.drive.aside import Aside, beside
from solver.drive.car import Car, car_of
from solver.drive.channel_map import ChannelMap
from solver.drive.coarse import Coarse, looks
from solver.drive.drive import Drive
from solver.drive.loops import Loop, confirmed, flags_of
from solver.drive.misstated import DRIFT, GAUGE, SPACING, TOLD, Estimate, Misstated, gauge_of, misstated, sized
from solver.drive.path import STEP, Path, path_of
from solver.drive.picks import Picks
from solver.drive.quiet import Quiet
from solver.drive.response import Clock, Legs
from solver.drive.rounds import (
    FIRST,
    LATER,
    ROUNDS,
    Advance,
    Round,
    Settled,
    beside_car,
    length_sigma_of,
    one_round,
    settled,
)
from solver.start.alignment import NotFollowingError
from vision.contract import progress

Array = NDArray[np.float64]

#: m, standard deviation that every channel has at least: load of the car off its middle, bends of the map.
FINEST = 0.4
#: m, spread of the channel map, or its distance from the smoothed place, beyond which it holds more than one place.
SEVERAL = 3.0
#: Fits with a gauge length that is part of the model, each with the one that the fit before tells.
GAUGE_FITS = 2
#: Standard deviations of length factor and drift that leave them to the data.
FREE_LENGTH, FREE_DRIFT = 0.2, 0.02


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
    clock, clock_sigma : of the record, and the standard deviation of its offset, s
    misstated : what files may state wrongly, the most probable first
    stated : gauge length and channel spacing as files have them, m, by the name of the effect
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
    clock: Clock
    clock_sigma: float
    misstated: list[Misstated]
    stated: dict[str, float]
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
        return self.picks.both_ways


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
    stated = {GAUGE: quiet.gauge_length, SPACING: quiet.channel_spacing}
    car = car_of(drive.tracks, quiet.start)
    fits = GAUGE_FITS if GAUGE in drive.effects else 0
    with progress("locating channels", (1 + fits) * (ROUNDS + 2)) as advance:
        several = looks(quiet, path_of(drive.vertices), car, drive.length_factor[0])
        coarse = likeliest(drive, quiet, car, several)
        advance(1)
        begun = Clock(coarse.clock_offset)
        done = settled(drive, quiet, coarse, car, begun, coarse.cell, FIRST, advance)
        for _ in range(fits):
            quiet, done = again(drive, quiet, coarse, car, done, advance)
        length_sigma = drive.length_factor[1] / drive.length_factor[0]
        wrong = misstated(estimates(drive, quiet, done, coarse, car, stated), length_sigma, drive.effects)
        named = tuple(one.effect for one in wrong if one.named)
        if named:
            other = replace(drive, effects=drive.effects + named)
            # The drive is located: where one of those effects leads astray, their sizes stay as they were told.
            with suppress(NotFollowingError):
                found = estimates(other, *again(other, quiet, coarse, car, done, advance), coarse, car, stated)
                wrong = sized(wrong, misstated(found, length_sigma, ()))
        advance(1)
    return fitted(drive, quiet, coarse, car, done, stated, wrong)


def again(
    drive: Drive, quiet: Quiet, coarse: Coarse, car: Car, done: Settled, advance: Advance
) -> tuple[Quiet, Settled]:
    """Rounds from where others ended, of a drive of other effects; the record with the gauge that these tell."""
    if GAUGE in drive.effects:
        quiet = replace(quiet, gauge_length=quiet.gauge_length * (1 + gauge_in(quiet, coarse, car, done).value))
    return quiet, settled(drive, quiet, coarse, car, done.clock, done.last.along.cell, LATER, advance)


def likeliest(drive: Drive, quiet: Quiet, car: Car, several: list[Coarse]) -> Coarse:
    """The look, of some that score alike, with which a round of the fit makes the record most probable."""
    if len(several) == 1:
        return several[0]
    evidence = np.array(
        [
            one_round(
                drive, quiet, one.path, car, Clock(one.clock_offset), one.cell, one.polarity, FIRST
            ).channels.evidence
            for one in several
        ]
    )
    second, first = np.argsort(evidence)[-2:]
    return replace(several[first], lead=float(evidence[first] - evidence[second]))


def gauge_in(quiet: Quiet, coarse: Coarse, car: Car, done: Settled) -> Estimate:
    """The gauge length that a fit tells, relative to the one that it was made with."""
    one = done.last
    return gauge_of(quiet, coarse.path, car, one.legs, one.picks.cell[: one.legs.count], coarse.polarity)


def estimates(
    drive: Drive, quiet: Quiet, done: Settled, coarse: Coarse, car: Car, stated: dict[str, float]
) -> dict[str, Estimate]:
    """What a fit says of all that files may state wrongly, relative to what is stated, by the name of the effect."""
    one = done.last
    free = smoothed_again(drive, quiet, coarse, car, one, FREE_LENGTH, FREE_DRIFT)
    heard = np.flatnonzero(one.picks.audible[: one.legs.count].any(0))
    way = max(1.0, float(np.ptp(free.cell[heard])))
    stretch = float(free.stretch[heard].mean())
    gauge, longer = gauge_in(quiet, coarse, car, done), quiet.gauge_length / stated[GAUGE]
    return {
        GAUGE: Estimate(longer * (1 + gauge.value) - 1, longer * gauge.sigma),
        SPACING: Estimate(stretch, float(np.hypot(*free.sigma[heard[[0, -1]]])) / way),
        DRIFT: Estimate(done.clock.drift + free.drift, free.drift_sigma),
    }


def smoothed_again(
    drive: Drive, quiet: Quiet, coarse: Coarse, car: Car, one: Round, factor_sigma: float, drift_sigma: float
) -> Along:
    """A round's picks smoothed with other standard deviations of length factor and drift."""
    spacing, cell = quiet.channel_spacing, one.along.cell
    flags, factor = flags_of(one.loops, len(cell)), drive.length_factor[0]
    steps = steps_of(coarse.path, cell, flags, one.channels.in_loop, spacing, factor, drive.sigma)
    errors = (car.memory, car.sigma)
    return smoothed_along(one.picks, one.legs, steps, factor_sigma, errors, spacing, drift_sigma, one.told)


def may_drift(drive: Drive, quiet: Quiet, coarse: Coarse, car: Car, done: Settled, wrong: list[Misstated]) -> Array:
    """Variance [channel], squared cells, by a clock that may drift though that does not show enough to be named.

    Of two explanations, places as they are and places moved by d with a drift of probability p, the mixture has the
    variance p d^2 more, and p times that by which the moved ones are less sure.
    """
    along = done.last.along
    if DRIFT in drive.effects:
        return np.zeros(len(along.cell))
    probability = next(one.probability for one in wrong if one.effect == DRIFT)
    plausible = TOLD[DRIFT].parameters[0].plausible
    moved = smoothed_again(drive, quiet, coarse, car, done.last, length_sigma_of(drive), plausible)
    wider = np.maximum(moved.sigma**2 - along.sigma**2, 0)
    return np.asarray(probability * ((moved.cell - along.cell) ** 2 + wider))


def fitted(
    drive: Drive,
    quiet: Quiet,
    coarse: Coarse,
    car: Car,
    done: Settled,
    stated: dict[str, float],
    wrong: list[Misstated],
) -> Fit:
    """The fit that a last round ends with."""
    one = done.last
    legs, polarity = one.legs, coarse.polarity
    audible, depth = one.picks.audible[: legs.count], drive.ground.depth
    aside = beside(quiet, coarse.path, car, legs, one.along.cell, audible, polarity, drive.sigma, depth)
    # The two estimates of a place differ where a loop ends elsewhere than the smoother has it, or picks are of others.
    apart = np.abs(one.channels.cell - one.along.cell)
    several = np.hypot(*(np.where(size * STEP > SEVERAL, size, 0.0) for size in (one.channels.spread, apart)))
    # Where the map bends the cable's heading is not sure, nor what lies square to the car.
    number = np.clip(np.round(one.along.cell).astype(np.int64), 0, len(coarse.path.points) - 1)
    heading = coarse.path.spread_of_heading(drive.sigma)[number]
    askew = heading * np.hypot(aside.far, aside.sigma) / STEP
    drifted = may_drift(drive, quiet, coarse, car, done, wrong)
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
        clock=done.clock,
        clock_sigma=one.along.clock_sigma,
        misstated=wrong,
        stated=stated,
        cell=one.along.cell,
        sigma=np.sqrt(one.along.sigma**2 + several**2 + askew**2 + drifted + (FINEST / STEP) ** 2),
        aside=aside,
        beside=beside_car(coarse.path, legs, one.along.cell),
        rounds=done.count,
        converged=done.still,
    )
