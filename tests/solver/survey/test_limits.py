"""How far vehicles are sensed."""

import numpy as np
import pytest
import torch

from solver.load.wheel_layout import layout_of
from solver.start.straight_fiber import straight_strain_rate
from solver.survey.limits import vehicle_reach


@pytest.mark.parametrize("offset", [3.0, 5.0])
@pytest.mark.parametrize("gauge_length", [2.0, 10.0, 16.0, 50.0, 100.0])
def test_what_is_ignored_is_little_of_the_largest_response_whatever_the_gauge(
    gauge_length: float, offset: float
) -> None:
    along = np.linspace(0.0, 200.0, 801)
    one = torch.ones((), dtype=torch.float64)
    beside, places = torch.full((1,), offset, dtype=torch.float64), torch.from_numpy(along)
    rate = straight_strain_rate(beside, 0.9 * one, places, 0.25 * one, layout_of("car"), gauge_length).numpy()
    share = np.abs(rate[0]) / np.abs(rate[0]).max()
    reach = vehicle_reach(gauge_length)
    assert share[along > reach].max() < 0.042
    assert gauge_length < 10 or share[along > 0.8 * reach].max() > 0.03
