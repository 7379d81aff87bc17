"""A wheelbase that was measured goes from the trajectory table into the load and its prior."""

import numpy as np
import pandas as pd
import pytest
from drives import a_record, fixes

from solver.load.wheel_layout import LAYOUTS, POINT, layout_of
from solver.run.problem_arrays import pass_arrays, passes_from
from solver.signal_path.traffic import Vehicles
from solver.trajectory.passes import smooth_passes

TIME = 20.0 + np.arange(60) * 0.08


def passes_with(**columns):
    """Passes of three cars, the second of which brings a wheelbase."""
    tables = [fixes(TIME + 9 * k, 12 * (TIME - 20.0), -1.0, seed=k, track_id=str(k)) for k in range(3)]
    tables[1] = tables[1].assign(**columns)
    return smooth_passes(pd.concat(tables), a_record())


def test_it_is_the_mean_and_the_prior_of_its_pass():
    passes = passes_with(wheelbase=2.48, sigma_wheelbase=0.06)
    assert [one.wheelbase for one in passes] == [None, (2.48, 0.06), None]
    usual = LAYOUTS["car"].wheelbase
    assert Vehicles.of(passes).wheelbase.tolist() == [usual, 2.48, usual]
    own = layout_of("car", passes[1].wheelbase)
    assert (own.wheelbase_sd, own.track, own.front_share) == (0.06, LAYOUTS["car"].track, LAYOUTS["car"].front_share)


@pytest.mark.parametrize("columns", [{}, {"wheelbase": np.nan, "sigma_wheelbase": np.nan}, {"length": 4.8}])
def test_without_it_the_class_counts(columns):
    assert all(one.wheelbase is None for one in passes_with(**columns))


def test_a_point_load_has_none():
    assert layout_of("vehicle", (2.6, 0.1)) is POINT


def test_runs_keep_it():
    passes = passes_with(wheelbase=2.48, sigma_wheelbase=0.06)
    assert [one.wheelbase for one in passes_from(pass_arrays(passes))] == [None, (2.48, 0.06), None]
