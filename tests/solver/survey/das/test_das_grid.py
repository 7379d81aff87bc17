from pathlib import Path

import numpy as np
import pytest

from solver.survey.das.das_files import Block
from solver.survey.das.grid import Segment, assemble, on_grid, sampling_interval, segments_of
from vision.contract import InputError

INTERVAL = 200_000_000


def block(start, rows, interval=INTERVAL, name="a.h5", jump=0):
    time = start + np.round(np.arange(rows) * interval).astype(np.int64)
    time[rows // 2 :] += jump
    return Block(Path(name), "test", np.zeros((rows, 2)), time, None, 0, None, None, "")


def test_adjoining_files_tell_the_true_rate():
    true = INTERVAL * (1 + 1e-5)
    blocks = [block(round(number * 1000 * true), 1000) for number in range(5)]
    assert sampling_interval(blocks) == pytest.approx(true, rel=1e-9)


def test_files_apart_do_not():
    assert sampling_interval([block(0, 100), block(30_000_000_000, 100)]) == INTERVAL


def test_other_rates_are_refused():
    with pytest.raises(InputError, match=r"slow.h5: 4 samples/s, but 5 in a.h5"):
        sampling_interval([block(0, 50), block(10**11, 50), block(2 * 10**11, 50, 250_000_000, "slow.h5")])


def test_times_must_increase():
    with pytest.raises(InputError, match="its times run backwards at sample"):
        sampling_interval([block(0, 10, jump=-2_000_000_000)])
    with pytest.raises(InputError, match="a single sample has no rate"):
        sampling_interval([block(0, 1)])


def test_a_jump_inside_a_file_splits_it():
    values = np.arange(20.0).reshape(10, 2)
    segments = segments_of(block(0, 10, jump=3 * INTERVAL), values, INTERVAL)
    assert [(segment.start, len(segment.values)) for segment in segments] == [(0, 5), (8 * INTERVAL, 5)]
    whole, gaps = assemble(segments, INTERVAL)
    assert np.isnan(whole[:, 0]).tolist() == [False] * 5 + [True] * 3 + [False] * 5
    assert gaps == ((pytest.approx(1.0), pytest.approx(1.4)),)


@pytest.mark.parametrize("shift", [-0.4, 0.3])
def test_samples_off_the_grid_are_moved_onto_it(shift):
    start = round((100 + shift) * INTERVAL)
    time = (start + np.arange(50) * INTERVAL) * 1e-9
    row, values = on_grid(Segment(Path("a"), np.sin(time)[:, None], start), 0, INTERVAL)
    assert len(values) == 49
    assert np.abs(values[:, 0] - np.sin((row + np.arange(49)) * 0.2)).max() < 1e-4


def test_samples_near_the_grid_stay():
    values = np.ones((5, 1))
    row, placed = on_grid(Segment(Path("a"), values, 10 * INTERVAL + 1_900_000), 0, INTERVAL)
    assert row == 10
    assert placed is values


def test_overlap_is_refused():
    segments = [Segment(Path("a.h5"), np.ones((10, 1)), 0), Segment(Path("b.h5"), np.ones((10, 1)), 9 * INTERVAL)]
    with pytest.raises(InputError, match=r"b.h5: overlaps a.h5 in time"):
        assemble(segments, INTERVAL)


def test_parts_days_apart_are_refused():
    segments = [Segment(Path("a.h5"), np.ones((50, 1)), 0), Segment(Path("b.h5"), np.ones((50, 1)), 86_400 * 10**9)]
    with pytest.raises(InputError, match=r"20 s of samples spread over 24.0 h"):
        assemble(segments, INTERVAL)
