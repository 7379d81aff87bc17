from pathlib import Path

import numpy as np
import pytest

from solver.survey.das.block import Block
from solver.survey.das.grid import Grid, on_grid, part_of, sampling_interval
from vision.contract import InputError

INTERVAL = 200_000_000


def part(start, rows, interval=INTERVAL, name="a.h5", jump=0, values=None):
    time = start + np.round(np.arange(rows) * interval).astype(np.int64)
    time[rows // 2 :] += jump
    values = np.zeros((rows, 2)) if values is None else values
    return part_of(Block(Path(name), "test", values, time, None, 0, None, None, ""))


def grid_of(*parts):
    return Grid(parts[0].runs[0][2], INTERVAL, tuple(on_grid(parts, INTERVAL)))


def read(one):
    return one.values(one.row, one.stop, slice(0, 2))


def test_adjoining_files_tell_the_true_rate():
    true = INTERVAL * (1 + 1e-5)
    parts = [part(round(number * 1000 * true), 1000) for number in range(5)]
    assert sampling_interval(parts) == pytest.approx(true, rel=1e-9)


def test_files_apart_do_not():
    assert sampling_interval([part(0, 100), part(30_000_000_000, 100)]) == INTERVAL


def test_times_must_increase():
    with pytest.raises(InputError, match="its times run backwards at sample"):
        sampling_interval([part(0, 10, jump=-2_000_000_000)])
    with pytest.raises(InputError, match="holds a single sample, whose rate nothing tells"):
        sampling_interval([part(0, 1)])


def test_a_jump_inside_a_file_splits_it():
    values = np.arange(20.0).reshape(10, 2)
    grid = grid_of(part(0, 10, jump=3 * INTERVAL, values=values))
    assert [(one.row, one.rows) for one in grid.placed] == [(0, 5), (8, 5)]
    assert (grid.rows, grid.holes, grid.measured(0, 13)) == (13, [(5, 7)], 10)
    assert np.array_equal(read(grid.placed[1]), values[5:])


def test_a_part_holds_no_times():
    """A day is more than a thousand files, each of thousands of samples."""
    time = part(0, 1000).block.time
    assert len(time) == 0 and time.base is None


@pytest.mark.parametrize("shift", [-0.4, 0.3])
def test_samples_off_the_grid_are_moved_onto_it(shift):
    start = round((150 + shift) * INTERVAL)
    time = (start + np.arange(50) * INTERVAL) * 1e-9
    moved = part(start, 50, values=np.sin(time)[:, None] * [1.0, 2.0])
    one = grid_of(part(0, 100), moved).placed[1]
    assert one.rows == 49
    truth = np.sin((one.row + np.arange(49)) * 0.2)[:, None] * [1.0, 2.0]
    assert np.abs(read(one) - truth).max() < 2e-4
    # A few rows of it are what they are among all.
    assert np.allclose(one.values(one.row + 25, one.row + 27, slice(1, 2)), read(one)[25:27, 1:], atol=1e-9)


def test_samples_near_the_grid_stay():
    values = np.ones((5, 2))
    one = grid_of(part(0, 10), part(20 * INTERVAL + 1_900_000, 5, values=values)).placed[1]
    assert (one.row, one.ahead) == (20, 0.0)
    assert np.array_equal(read(one), values)


def test_parts_days_apart_are_refused():
    grid = grid_of(part(0, 50), part(86_400 * 10**9, 50))
    with pytest.raises(InputError, match=r"20 s of samples spread over 24.0 h"):
        grid.check_dense([(0, grid.rows)])
    grid.check_dense([(0, 100)])
