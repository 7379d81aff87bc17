"""Which clock offsets of a long drive are looked at with all of it."""

import numpy as np

from solver.drive.coarse import STRETCHES, TOLD, TRIED, tried
from solver.drive.monotone_path import NEVER, Passages, dynamic_program, traced

PLACES, SHIFTS, TRUE = 2 * TOLD, np.arange(-20, 21), 7


def drive(length: int) -> tuple[np.ndarray, list[Passages]]:
    """Scores [piece, bin] of cable with 30 pieces of lead and a loop, at an offset of `TRUE`; visits forth and back."""
    rng = np.random.default_rng(5)
    when = np.cumsum(rng.integers(1, 4, length)) + 30
    visits = Passages(np.arange(length + 1), when, np.ones(length))
    other = Passages(np.arange(length + 1), when[::-1].copy(), np.ones(length))
    place = np.concatenate([np.full(30, -1), np.arange(length // 2), np.full(12, -1), np.arange(length // 2, length)])
    scores = np.where(rng.random((len(place), when[-1] + 40)) < 0.05, 2.0, -1.0).astype(np.float32)
    piece = np.flatnonzero(place >= 0)
    scores[piece, when[place[piece]] + TRUE] = 1.5
    return scores, [visits, other]


def test_long_drive_is_told_by_stretches() -> None:
    scores, ways = drive(PLACES)
    found = tried(scores, ways, SHIFTS, 6)
    assert found[0, SHIFTS == TRUE].all()
    assert 0 < found.sum() <= 3 * TRIED
    assert STRETCHES * (TOLD // STRETCHES) == TOLD


def test_short_drive_is_looked_at_whole() -> None:
    assert tried(*drive(TOLD // 2), SHIFTS, 6).all()


def test_cable_that_hears_little_is_no_slack() -> None:
    """Forty pieces of each fifty do not hear the car; laid into loops they would not count against the path."""
    number = np.arange(250)
    scores = np.where(number[:, None] % 50 < 10, np.where(number[:, None] == number, 2.0, -1.0), -1.0)
    visits = Passages(np.arange(251), number, np.ones(250))
    trace = np.zeros((250, 250, 2), np.int8)
    arrays = visits.begin, visits.bins, visits.share
    _, end, mode = dynamic_program()(scores.astype(np.float32), *arrays, 0, NEVER, trace)
    assert (traced(trace, end, mode) == number).all()
