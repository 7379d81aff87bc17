"""The vehicles of a planned survey, against what a hand would draw."""

import numpy as np
import pandas as pd
import pytest

from solver.criticism.planning.planned_drives import BEYOND, EPOCH, HEADWAY, SURGE, WEAVE, Drive, drives, fixes, times
from solver.survey.plan_section import LaneSection, PlanSection

LANES = [
    {"y": 0.0, "toward": "+x", "vehicles": {"car": 2, "truck": 1}},
    {"y": -3.5, "toward": "-x", "vehicles": {"bus": 1}},
]


@pytest.fixture
def plan() -> PlanSection:
    return PlanSection.model_validate({"length": 40.0, "offset": 4.0, "noise": 2e-8, "lanes": LANES})


def test_classes_take_turns_and_speeds_are_spread(plan: PlanSection) -> None:
    made = drives(plan)
    assert [one.vehicle_class for one in made] == ["car", "truck", "car", "bus"]
    low, high = plan.speeds
    assert [3.6 * one.speed for one in made[:3]] == pytest.approx([low + (high - low) * k / 6 for k in (1, 3, 5)])
    assert 3.6 * made[3].speed == pytest.approx((low + high) / 2), "each lane by itself"


def test_nobody_is_near_while_another_is(plan: PlanSection) -> None:
    made = drives(plan)
    spans = list(times(plan, made))
    now = 0.0
    for (begin, end), one in zip(spans, made, strict=True):
        assert begin - BEYOND / one.speed == pytest.approx(now + HEADWAY)
        assert end - begin == pytest.approx(plan.length / one.speed)
        now = end + BEYOND / one.speed


@pytest.mark.parametrize("toward", ["+x", "-x"])
def test_a_drive_is_seen_from_one_end_of_the_view_to_the_other(plan: PlanSection, toward: str) -> None:
    """At the frames of the video, as fast as told but for the driver's surging, where the lane is."""
    exact = plan.model_copy(update={"fix_sigma": 1e-9})
    lane = LaneSection(y=-1.5, toward=toward)
    table = fixes(exact, 3, Drive("car", lane, 10.0), (20.0, 24.0))
    seconds = (table["time"] - pd.Timestamp(EPOCH, tz="UTC")).dt.total_seconds().to_numpy()
    assert seconds[0] >= 20 and seconds[-1] <= 24
    np.testing.assert_allclose(np.diff(seconds), 1 / plan.frame_rate, atol=1e-8)
    ends = (0.0, plan.length) if toward == "+x" else (plan.length, 0.0)
    assert table["x"].iloc[0] == pytest.approx(ends[0], abs=1.5)
    assert table["x"].iloc[-1] == pytest.approx(ends[1], abs=1.5)
    speed = np.diff(table["x"]) * plan.frame_rate * lane.direction
    assert (np.abs(speed / 10 - 1) <= SURGE + 1e-3).all()
    assert (np.abs(table["y"] + 1.5) <= WEAVE + 1e-6).all()
    assert set(table["track_id"]) == {"3"} and set(table["class"]) == {"car"}


def test_fixes_scatter_as_much_as_the_plan_says_and_the_same_each_time(plan: PlanSection) -> None:
    drive = Drive("car", LaneSection(y=0.0, toward="+x"), 0.5)
    rough, smooth = (
        fixes(plan.model_copy(update={"fix_sigma": sigma}), 1, drive, (0.0, 80.0)) for sigma in (0.2, 1e-9)
    )
    for axis in ("x", "y"):
        assert (rough[axis] - smooth[axis]).std() == pytest.approx(0.2, rel=0.1)
        assert (rough[f"sigma_{axis}"] == 0.2).all()
    again = fixes(plan.model_copy(update={"fix_sigma": 0.2}), 1, drive, (0.0, 80.0))
    pd.testing.assert_frame_equal(rough, again)
