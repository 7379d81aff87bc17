import numpy as np

from solver.processing.gaps import interpolated, runs


def test_interpolated_holds_the_ends():
    assert interpolated(np.array([[np.nan, 1.0, np.nan, 3.0, np.nan]])).tolist() == [[1.0, 1.0, 2.0, 3.0, 3.0]]


def test_rows_without_any_sample_become_zero():
    assert interpolated(np.full((1, 3), np.nan)).tolist() == [[0.0, 0.0, 0.0]]


def test_runs_reach_both_ends():
    assert runs(np.array([True, False, False, True, True])) == [slice(0, 1), slice(3, 5)]
    assert runs(np.ones(4, bool)) == [slice(0, 4)]
    assert runs(np.zeros(4, bool)) == []
