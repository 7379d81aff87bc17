"""Coarse channels and long gauges are looked at by their own measure."""

from dataclasses import replace

import numpy as np
import pytest

from solver import simulator
from solver.simulator.scenario import read_scenario
from solver.start.alignment import FEWEST, enough
from solver.start.fiber_line import ransac_line
from solver.start.initialization import initialize
from solver.start.regauge import shorter_gauges
from solver.survey.survey import Survey
from solver.trajectory.passes import smooth_passes


def test_detections_between_coarse_channels_are_near_their_line() -> None:
    """Each is told to the nearest of channels 5.1 m apart, and some to the next but one."""
    x = np.random.default_rng(0).uniform(0, 100, 200)
    channel = np.rint(x / 5.1 + np.random.default_rng(1).normal(0, 0.15, 200))
    line, inliers = ransac_line(x, np.full(200, 12.0), channel, 5.1)
    assert line is not None and abs(line.slope - 5.1) < 0.2
    assert inliers.mean() > 0.95


def test_noise_on_coarse_channels_follows_no_line() -> None:
    for seed in range(5):
        rng = np.random.default_rng(seed)
        x, channel = rng.uniform(0, 100, 400), rng.integers(0, 60, 400).astype(float)
        speed = np.where(rng.random(400) > 0.5, 12.0, -12.0)
        _, inliers = ransac_line(x, speed, channel, 5.1)
        assert inliers.sum() < FEWEST + enough(5.1, 306.0) * 400


def test_gauges_of_fifty_meters_are_taken_apart_for_the_first_look(tmp_path) -> None:
    scenario = read_scenario("street", seed=1, passes=3, gauge_length=50.0, channel_spacing=2.0, channels=130)
    made = simulator.simulate(scenario)
    survey = Survey.read(simulator.write_survey(made, tmp_path / "survey"))
    record = survey.record
    shorter = shorter_gauges(record)
    assert (shorter.gauge_length, record.gauge_length) == (10.0, 50.0)
    assert shorter.strain_rate.shape == record.strain_rate.shape
    assert shorter_gauges(shorter) is shorter
    assert shorter_gauges(replace(record, gauge_length=16.0)).gauge_length == 16.0
    found = initialize(shorter, smooth_passes(survey.tracks, record))
    here = np.isin(found.channel, np.arange(made.active[0], made.active[1] + 1))
    off = found.route[here, 0] - made.route[found.channel[here], 0]
    assert here.sum() > 30 and np.abs(off).max() < 3.0
    assert float(np.median(np.abs(off))) == pytest.approx(0.0, abs=1.5)
