"""Gauges of 50 m sense where the fiber turns off the road beyond the channels that are fitted."""

from pathlib import Path

import numpy as np
import pytest

from solver import simulator
from solver.run.locate import locate
from solver.run.run import Run
from solver.simulator.scenario import Scenario
from solver.simulator.simulated_survey import Survey as Made
from solver.survey.survey import Survey

STREET = Scenario(seed=4, passes=3, gauge_length=50.0, channel_spacing=2.0, channels=150, view=(0.0, 60.0), snr_db=18.0)


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> tuple[Made, Run]:
    made = simulator.simulate(STREET)
    folder: Path = tmp_path_factory.mktemp("long_gauges")
    return made, locate(Survey.read(simulator.write_survey(made, folder / "survey")))


def test_the_route_beyond_its_channels_may_turn_within_meters(both: tuple[Made, Run]) -> None:
    made, run = both
    result = run.result
    here = np.isin(result.channel, result.fitted_channel)
    error = result.route - made.route[result.channel]
    assert np.abs(error[here]).max() < 0.1
    assert np.abs(error).max() < 1.0
    assert result.chi2_per_dof < 1.02


def test_vehicles_are_followed_as_far_as_long_gauges_sense_them(both: tuple[Made, Run]) -> None:
    _, run = both
    first, last = run.problem.start[[0, -1], 0]
    beyond = [max(first - one.position[:, 0].min(), one.position[:, 0].max() - last) for one in run.problem.passes]
    assert 45.0 < max(beyond) < 55.0
