"""The clock of a drive: what shapes tell of it, which of several offsets is taken, and when its rounds end."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import roadfiber as rf
from solver.drive import aside, rounds
from solver.drive.car import car_of
from solver.drive.channel_fit import gauge_in, likeliest
from solver.drive.coarse import LEAD, looks
from solver.drive.loudness import loudness
from solver.drive.path import path_of
from solver.drive.picks import passing
from solver.drive.response import Clock, Responses, legs_of
from solver.drive.rounds import LATER, ROUNDS, Settled, one_round, responses, settled
from solver.drive.timing import clock_of_shapes


@pytest.mark.parametrize("off", [-0.6, 0.4])
def test_shapes_tell_the_clock(drive: rf.Drive, run: rf.DriveRun, truth: dict[str, Any], off: float) -> None:
    quiet, path = drive.quiet(), path_of(drive.vertices)
    car, cell = car_of(drive.tracks, quiet.start), run.arrays["along"] + path.first
    polarity = int(run.facts["parameters"]["polarity"]["value"])
    one = one_round(drive, quiet, path, car, Clock(truth["clock_offset"]), cell, polarity, LATER)
    clock = Clock(truth["clock_offset"] + off)
    legs = legs_of(quiet, path, car, clock)
    floor, _ = loudness(quiet, responses(quiet, path, car, legs), legs, cell, polarity)
    picks = replace(one.picks, cell=one.picks.cell - off * one.picks.speed)
    told, sigma = clock_of_shapes(quiet, path, car, legs, clock, picks, polarity, floor)
    assert 0.1 < sigma < 0.4
    assert abs(told + off) < 2 * sigma < abs(off) + 0.3


def test_offsets_that_score_alike_are_told_apart(drive: rf.Drive) -> None:
    quiet, path = drive.quiet(), path_of(drive.vertices)
    car = car_of(drive.tracks, quiet.start)
    right = looks(quiet, path, car, 1.0)[0]
    wrong = replace(right, clock_offset=right.clock_offset + 40.0)
    found = likeliest(drive, quiet, car, [wrong, right])
    assert found.clock_offset == right.clock_offset
    assert found.lead > LEAD and found.told_apart
    assert not replace(found, lead=LEAD / 2).told_apart
    assert likeliest(drive, quiet, car, [wrong]) is wrong


@pytest.mark.parametrize(
    ("moves", "count", "still"),
    [
        ((0.3, 0.001, 0.0), 3, True),
        ((0.3, 0.001, 0.1, 0.1, 0.01, 0.0), 6, True),  # it halts once on its way
        ((0.3, 0.05, -0.05, 0.05), 3, True),  # to and fro
        ((0.1,) * ROUNDS, ROUNDS, False),
    ],
)
def test_rounds_end_when_the_clock_stands_still(
    monkeypatch: pytest.MonkeyPatch, moves: tuple[float, ...], count: int, still: bool
) -> None:
    left = iter(moves)

    def made(*_: Any) -> Any:
        return SimpleNamespace(along=SimpleNamespace(clock=next(left), clock_sigma=0.05, drift=0.0, cell=np.zeros(3)))

    monkeypatch.setattr(rounds, "one_round", made)
    monkeypatch.setattr(rounds, "check_found", lambda *_: None)
    drive, quiet = SimpleNamespace(effects=()), SimpleNamespace(time=np.arange(10.0))
    coarse: Any = SimpleNamespace(path=None, polarity=1)
    done = settled(drive, quiet, coarse, None, Clock(1.0), np.zeros(3), 5, lambda _: None)  # type: ignore[arg-type]
    assert (done.count, done.still) == (count, still)
    assert done.clock.offset == pytest.approx(1.0 + sum(moves[:count]))


def test_picks_move_with_the_clock_as_fast_as_the_car_is_heard(
    drive: rf.Drive, run: rf.DriveRun, truth: dict[str, Any]
) -> None:
    quiet, path = drive.quiet(), path_of(drive.vertices)
    car, cell = car_of(drive.tracks, quiet.start), run.arrays["along"] + path.first
    polarity = int(run.facts["parameters"]["polarity"]["value"])
    right, late = (
        one_round(drive, quiet, path, car, Clock(truth["clock_offset"] + off), cell, polarity, LATER)
        for off in (0.0, 0.2)
    )
    moved = (right.picks.cell - late.picks.cell) / 0.2
    passes = np.stack([passing(right.legs, leg, np.nan_to_num(right.picks.cell[leg]))[1] for leg in range(len(moved))])
    slow = np.isfinite(moved) & (np.abs(passes) < 5)
    heard, passed = (float(np.median(np.abs(moved - one)[slow])) for one in (right.picks.speed, passes))
    assert slow.sum() >= 5
    assert heard < 0.6 * passed


def test_picks_are_as_sharp_as_they_are_off(drive: rf.Drive, run: rf.DriveRun, truth: dict[str, Any]) -> None:
    """From neighbor to neighbor: what the GPS is off is the same for both."""
    quiet, path = drive.quiet(), path_of(drive.vertices)
    car, cell = car_of(drive.tracks, quiet.start), run.arrays["along"] + path.first
    polarity = int(run.facts["parameters"]["polarity"]["value"])
    picks = one_round(drive, quiet, path, car, Clock(truth["clock_offset"]), cell, polarity, LATER).picks
    real = path.nearest(np.array(truth["route_xyz"])[:, :2])[0]
    off = np.diff(picks.cell - real, axis=1) / np.hypot(picks.sigma[:, 1:], picks.sigma[:, :-1])
    assert 0.5 < np.nanmedian(np.abs(off)) / 0.6745 < 1.3


def test_gauges_are_compared_where_each_leg_puts_a_channel_and_on_the_same_samples(
    drive: rf.Drive, run: rf.DriveRun, truth: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not where channels lie: where the GPS is off the car passes elsewhere. One that looks farther explains more."""
    quiet, path = drive.quiet(), path_of(drive.vertices)
    car, cell = car_of(drive.tracks, quiet.start), run.arrays["along"] + path.first
    polarity = int(run.facts["parameters"]["polarity"]["value"])
    one = one_round(drive, quiet, path, car, Clock(truth["clock_offset"]), cell, polarity, LATER)
    coarse: Any = SimpleNamespace(path=path, polarity=polarity)
    samples = set()

    def counted(*asked: Any) -> Responses:
        found = responses(*asked)
        samples.add(int(found.size.sum()))
        return found

    monkeypatch.setattr(aside, "responses", counted)
    moved = [replace(one, along=replace(one.along, cell=one.along.cell + off)) for off in (0.0, 4.0)]
    found = [gauge_in(quiet, coarse, car, Settled(last, Clock(0.0), 1, True)) for last in moved]
    assert len(samples) == 1
    assert found[0] == found[1]
    assert abs(found[0].value) < 3 * found[0].sigma < 0.3
