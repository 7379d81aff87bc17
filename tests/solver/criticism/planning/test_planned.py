"""A planned survey as a fitting problem, against what a hand would compute."""

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from solver.criticism.planning.planned import (
    GRAVITY,
    empty_record,
    expected_route,
    heard,
    loaded,
    noise_of,
    planned_anchor,
)
from solver.criticism.planning.planned_drives import HEADWAY, drives, times
from solver.criticism.planning.planned_site import PlannedSite, read_planned
from solver.survey.plan_section import MASSES

LANES = [
    {"y": 0.0, "toward": "+x", "vehicles": {"car": 2, "truck": 1}},
    {"y": -3.5, "toward": "-x", "vehicles": {"bus": 1}},
]


def site(**changes: Any) -> PlannedSite:
    plan = {"length": 40.0, "offset": 4.0, "noise": 2e-8, "sampling_rate": 5.0, "lanes": LANES} | changes
    return read_planned({"das": {"gauge_length": 10.0, "channel_spacing": 2.0}, "plan": plan})


@dataclass(frozen=True)
class Vehicles:
    """As much of vehicles as is heavy."""

    amplitude: torch.Tensor


@dataclass(frozen=True)
class State:
    """As much of a state as has vehicles."""

    vehicles: Vehicles


def test_the_record_holds_every_vehicle_and_all_of_the_fiber() -> None:
    planned = site()
    made = drives(planned.plan)
    record = empty_record(planned, made)
    last = list(times(planned.plan, made))[-1][1]
    assert record.time[-1] >= last + HEADWAY > record.time[-2]
    assert record.distance.tolist() == [2.0 * k for k in range(21)]
    assert record.strain_rate.shape == (len(record.time), 21) and not record.strain_rate.any()
    assert (record.gauge_length, record.channel_spacing, record.sampling_rate) == (10.0, 2.0, 5.0)


def test_the_expected_route_is_straight_and_anchors_lie_on_it() -> None:
    planned = site(anchor_sigma=0.07)
    route = expected_route(planned, np.array([0.0, 10.0, 40.0]))
    depth = planned.ground.depth[0]
    np.testing.assert_allclose(route, [[0, 4, depth], [10, 4, depth], [40, 4, depth]])
    one = planned_anchor(planned, 15.0, "here")
    assert (one.name, one.channel, one.x, one.y, one.z) == ("here", 7.5, 15.0, 4.0, depth)
    assert one.sigma_xy == one.sigma_z == 0.07


def test_loads_are_as_heavy_as_their_classes() -> None:
    """A weight m g on ground of shear modulus G moves it by m g / (4 pi G) (Boussinesq)."""
    planned = site()

    fit: Any = SimpleNamespace(start=lambda: State(Vehicles(torch.ones(4, dtype=torch.float64))))
    found = loaded(planned, fit, drives(planned.plan)).vehicles.amplitude
    each = GRAVITY / (4 * np.pi * planned.plan.shear_modulus)
    assert found.tolist() == pytest.approx([each * MASSES[name] for name in ("car", "truck", "car", "bus")])


def test_the_record_without_noise_is_the_models_where_vehicles_are() -> None:
    problem: Any = SimpleNamespace(record=np.ones((6, 2)), traffic=SimpleNamespace(samples=np.array([1, 2, 4])))
    signal = torch.arange(6.0).reshape(3, 2)
    assert heard(problem, signal).tolist() == [[0, 0], [0, 1], [2, 3], [0, 0], [4, 5], [0, 0]]


def test_the_noise_is_that_of_the_ratio_while_vehicles_are_in_view() -> None:
    """Power 25 over noise of 10 dB less, 2.5; what is out of view does not count."""
    one = SimpleNamespace(rows=np.array([3, 4, 5]), in_view=np.array([True, True, False]))
    problem: Any = SimpleNamespace(passes=[one], traffic=SimpleNamespace(samples=np.array([2, 3, 4, 5])))
    signal = torch.tensor([[99.0], [5.0], [-5.0], [99.0]])
    plan = site().plan
    told = plan.model_copy(update={"snr_db": 10.0})
    assert noise_of(told, problem, signal) == pytest.approx(2.5**0.5)
    quieter = plan.model_copy(update={"snr_db": 30.0})
    assert noise_of(quieter, problem, signal) == pytest.approx(0.025**0.5)
