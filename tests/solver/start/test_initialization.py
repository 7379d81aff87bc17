import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from drive_by import DEPTH, SPACING, TWO_LANES, VIEW, a_street, record_of
from simulated import record_of as record_of_survey

from solver.simulator import Scenario, simulate
from solver.start.initialization import Initialization, initialize
from solver.survey.das import DASRecord, read_das
from solver.survey.site import read_site
from solver.trajectory.passes import smooth_passes
from solver.trajectory.vehicle_pass import Pass
from vision.contract import InputError, read_trajectories


def in_view(route: np.ndarray) -> tuple[int, int]:
    """First and last channel of a route [channel, 3] in view."""
    inside = np.flatnonzero((route[:, 0] >= VIEW[0]) & (route[:, 0] <= VIEW[1]))
    return int(inside[0]), int(inside[-1])


def check(found: Initialization, route: np.ndarray, aside: float = 1.2) -> None:
    """The range within 3 channels, x within 0.7 m, the lateral position within `aside`."""
    first, last = in_view(route)
    assert abs(found.active[0] - first) <= 3
    assert abs(found.active[1] - last) <= 3
    error = found.route - route[found.channel]
    assert np.abs(error[:, 0]).max() < 0.7
    assert np.median(np.abs(error[:, 1])) < aside


@pytest.mark.parametrize("y", [4.5, -8.0])
@pytest.mark.parametrize("reverse", [False, True])
def test_straight_street(y: float, reverse: bool):
    record, passes, route = a_street(y, reverse=reverse)
    found = initialize(record, passes)
    check(found, route)
    assert found.direction == (-1 if reverse else 1)
    assert found.x_of_channel[1] == pytest.approx(found.direction * SPACING, rel=0.01)
    assert found.side_evidence > 3
    assert abs(found.clock_ahead) < 0.05
    assert (found.snr_db > 7).all()
    assert (found.route[:, 2] == DEPTH).all()
    middle = -1.75
    assert (np.sign(found.mirror - middle) == -np.sign(found.lateral - middle)).all()
    # The width of each pass alone says how far its lane is, roughly.
    lanes = np.array([lane for _, _, lane in TWO_LANES])
    np.testing.assert_allclose(found.offset, np.abs(y - lanes), atol=2.0)


def test_detections_say_where_and_how_strong():
    record, passes, _ = a_street()
    found = initialize(record, passes)
    assert len(found.detections) == len(passes)
    x0, slope = found.x_of_channel
    for one, seen in zip(passes, found.detections, strict=True):
        np.testing.assert_allclose(np.interp(seen.row, one.rows, one.position[:, 0]), seen.x)
        assert np.abs(x0 + slope * seen.channel - seen.x).max() < 3
        assert (seen.snr_db > 7).all()
        assert (seen.scale >= 2).all()


def test_channel_numbers_need_not_begin_at_zero():
    record, passes, _ = a_street()
    here = initialize(record, passes)
    there = initialize(record_of(record.strain_rate, first=1000), passes)
    assert there.active == (here.active[0] + 1000, here.active[1] + 1000)
    np.testing.assert_allclose(there.route, here.route)
    x0, slope = there.x_of_channel
    np.testing.assert_allclose(x0 + slope * there.channel, there.route[:, 0])


@pytest.mark.parametrize("rate", [2.0, 25.0])
def test_other_sampling_rates(rate: float):
    record, passes, route = a_street(rate=rate)
    check(initialize(record, passes), route)


def test_sign_convention_of_the_maker_does_not_matter():
    record, passes, route = a_street()
    check(initialize(replace(record, strain_rate=-record.strain_rate), passes), route)


def test_soft_ground_on_one_side_does_not_turn_the_sign():
    """Its outer lobes are louder than all that is recorded elsewhere."""
    effects = {"stiffness_contrast": -1.6, "braking": 0.3}
    survey = simulate(Scenario(seed=5, passes=5, snr_db=15.0, effects=effects))
    record = record_of_survey(survey)
    found = initialize(record, smooth_passes(survey.trajectories, record))
    assert found.coil is None
    assert np.abs(found.route[:, 0] - survey.route[found.channel, 0]).max() < 2.5


def test_vehicles_that_meet_and_follow_closely():
    record, passes, route = a_street(vehicles=TWO_LANES + TWO_LANES, headway=3.0)
    check(initialize(record, passes), route, aside=2.0)


def test_gaps_dead_and_mad_channels():
    record, passes, route = a_street()
    strain_rate, rng = record.strain_rate.copy(), np.random.default_rng(0)
    strain_rate[:, 60] = 30 * strain_rate.std() * rng.normal(size=len(strain_rate))
    strain_rate[rng.random(strain_rate.shape) < 0.001] = 1e-3
    strain_rate[:, [30, 31, 50]] = np.nan
    strain_rate[passes[1].rows[12:16]] = np.nan
    check(initialize(replace(record, strain_rate=strain_rate), passes), route, aside=1.5)


def test_fiber_that_ends_in_view_ends_the_range():
    record, passes, route = a_street()
    strain_rate = record.strain_rate.copy()
    quiet = strain_rate[-20:].std()
    strain_rate[:, 45:] = quiet * np.random.default_rng(0).normal(size=strain_rate[:, 45:].shape)
    found = initialize(replace(record, strain_rate=strain_rate), passes)
    assert abs(found.active[1] - 44) <= 6
    assert abs(found.active[0] - in_view(route)[0]) <= 3


def test_one_lane_says_that_both_sides_are_possible():
    record, passes, route = a_street(5.0, (("car", 12.0, 0.0), ("car", 14.0, 0.0), ("van", 11.0, 0.0)))
    found = initialize(record, passes)
    first, last = in_view(route)
    assert abs(found.active[0] - first) <= 3 and abs(found.active[1] - last) <= 3
    assert found.side_evidence < 0.5
    assert set(found.direction_residual) == {1}
    assert np.median(np.abs(np.abs(found.lateral) - 5.0)) < 1.5
    np.testing.assert_allclose(found.mirror, -found.lateral, atol=0.5)


def test_point_loads_of_unknown_class():
    vehicles = tuple(("vehicle", speed, lane) for _, speed, lane in TWO_LANES)
    record, passes, route = a_street(vehicles=vehicles)
    check(initialize(record, passes), route)


def delayed(record: DASRecord, seconds: float) -> DASRecord:
    """The record with its signals later by that."""
    steps = round(seconds * record.sampling_rate)
    return replace(record, strain_rate=np.roll(record.strain_rate, steps, axis=0))


def test_clock_offset_is_found_and_does_not_move_the_fiber():
    record, passes, route = a_street()
    found = initialize(delayed(record, 0.4), passes)
    check(found, route)
    # The DAS hears them later than the trajectories say: their clock is behind.
    assert found.clock_ahead == pytest.approx(-0.4, abs=0.05)
    assert found.direction_residual[1] == pytest.approx(-found.direction_residual[-1], abs=1.5)
    assert found.direction_residual[1] > 3


def test_clocks_seconds_apart():
    record, passes, _ = a_street()
    with pytest.raises(InputError, match=r"their clock is 2\.\d s behind that of the DAS"):
        initialize(delayed(record, 2.6), passes)


def test_noise_alone():
    record, passes, _ = a_street()
    noise = np.random.default_rng(5).normal(0, 1e-9, record.strain_rate.shape)
    with pytest.raises(InputError, match="no vehicle is seen in it"):
        initialize(replace(record, strain_rate=noise), passes)


def test_nothing_at_all():
    record, passes, _ = a_street()
    with pytest.raises(InputError, match="no vehicle is seen in it"):
        initialize(replace(record, strain_rate=np.zeros_like(record.strain_rate)), passes)


def test_signals_that_do_not_follow_the_trajectories():
    record, passes, _ = a_street(noise=0.02)
    # Where a vehicle is told to drive one way, something goes by that stands still.
    standing = record.strain_rate.copy()
    for one in passes:
        shape = record.strain_rate[one.rows[len(one.rows) // 2]]
        standing[one.rows] = shape + 0.02 * np.abs(shape).max() * np.random.default_rng(1).normal(
            size=(len(one.rows), len(shape))
        )
    with pytest.raises(InputError, match=r"does not follow the trajectories|no channel sees|no vehicle is seen"):
        initialize(replace(record, strain_rate=standing), passes)


def test_a_machine_beside_the_fiber_is_not_taken_for_the_vehicles():
    record, passes, route = a_street()
    noise = np.random.default_rng(2).normal(size=(len(record.strain_rate), 12)) * 5 * np.abs(record.strain_rate).max()
    loud = record.strain_rate.copy()
    loud[:, :12] += noise
    check(initialize(replace(record, strain_rate=loud), passes), route, aside=2.0)


def test_passes_never_in_view_are_left_out():
    record, passes, route = a_street()
    away = replace(passes[1], in_view=np.zeros(len(passes[1].rows), bool))
    found = initialize(record, [passes[0], away, *passes[2:]])
    check(found, route, aside=2.0)
    assert len(found.detections[1]) == 0
    assert found.snr_db[1] == -np.inf
    assert np.isnan(found.offset[1])
    with pytest.raises(InputError, match="no vehicle is in view"):
        initialize(record, [away])


def test_a_handful_of_channels():
    record, passes, _ = a_street()
    with pytest.raises(InputError, match="5 channels are too few"):
        initialize(record_of(record.strain_rate[:, :5]), passes)


@pytest.fixture(scope="module")
def answers(shared_data: Path) -> dict[str, dict]:
    return json.loads((shared_data / "practice" / "answers.json").read_text())


def practice(folder: Path) -> tuple[DASRecord, list[Pass]]:
    """Record and passes of a practice survey."""
    site = read_site(folder / "site.toml")
    settings = {name: getattr(site.das, name) for name in ("gauge_length", "channel_spacing", "quantity", "channels")}
    record = read_das(site.das.files, **settings)
    assert site.trajectories is not None
    return record, smooth_passes(read_trajectories(site.trajectories.files, site.frame), record)


@pytest.mark.parametrize("number", [1, 3, 4, 7, 12, 14])
@pytest.mark.parametrize("reverse", [False, True])
def test_practice_surveys(number: int, reverse: bool, shared_data: Path, answers: dict[str, dict]):
    name = f"survey-{number:02d}"
    record, passes = practice(shared_data / "practice" / name)
    route = np.array(answers[name]["route_xyz"])
    first, last = answers[name]["active_channels"]
    if reverse:
        record = replace(record, strain_rate=record.strain_rate[:, ::-1])
        route, first, last = route[::-1], len(route) - 1 - last, len(route) - 1 - first
    found = initialize(record, passes)
    assert abs(found.active[0] - first) <= 3
    assert abs(found.active[1] - last) <= 3
    assert found.direction == (-1 if reverse else 1)
    error = found.route - route[found.channel]
    assert np.abs(error[:, 0]).max() < 0.6
    # Hidden effects widen the responses, so that the fiber looks farther away; the side is right all the same.
    assert np.median(np.abs(error[:, 1])) < 2.0
    assert np.median(found.lateral) > 0
