"""Vehicles that nobody listed are followed by what the fiber heard of them, and carried by the fit."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from solver import simulator
from solver.fit.result import FitResult, Parameter
from solver.run.heard_passes import weighs
from solver.run.locate import locate
from solver.simulator.scenario import read_scenario
from solver.start.free_tracks import (
    NO_LANE,
    OFFSET,
    REACH,
    Unlisted,
    free_track,
    is_heard,
    is_listed,
    lane,
    ridge,
    unlisted_line,
)
from solver.start.heard import Heard, Hearing
from solver.survey.survey import Survey
from solver.trajectory.vehicle_pass import Pass

TIME = np.arange(0.0, 40.0, 0.2)


def driven(speed: float, at: float, y: float, name: str = "7") -> Pass:
    """A vehicle that goes by the middle, x = 50, at a time."""
    rows = np.flatnonzero(np.abs(speed * (TIME - at)) < 60)
    x = 50 + speed * (TIME[rows] - at)
    position = np.column_stack([x, np.full(len(x), y)])
    velocity = np.tile([speed, 0.0], (len(x), 1))
    return Pass(name, "car", rows, position, velocity, np.full((len(x), 2), 0.05), np.ones(len(x), bool))


@pytest.fixture
def hearing() -> Hearing:
    """A vehicle that goes along +x and brakes: 12 m/s in the middle, at 20 s."""
    x, frames = np.linspace(0, 100, 80), np.arange(400)[:, None]
    rng = np.random.default_rng(0)
    passing = 25 - 4 * np.abs(frames / 10 - 20 - (x - 50) / 12 - 3e-4 * (x - 50) ** 2) + rng.normal(0, 0.3, (400, 80))
    return Hearing({1: passing, -1: np.zeros((400, 80))}, x, 10.0)


def test_a_ridge_is_followed_from_a_rough_time_and_speed(hearing: Hearing) -> None:
    line = ridge(hearing, Heard(20.4, 10.5, 20.0, 1.0))
    assert line is not None
    found = free_track(line, hearing, 3, [driven(11.0, 12.0, 1.8), driven(-9.0, 19.0, -1.7)], TIME)
    assert found is not None
    assert (found.track_id, found.vehicle_class, found.offset) == ("heard#3", "unknown", OFFSET)
    ahead = found.position[:, 0] - 50
    inner = np.abs(ahead) < 50
    late = TIME[found.rows] - 20 - ahead / 12 - 3e-4 * ahead**2
    assert np.abs(late[inner]).max() < 0.06
    # Beyond the channels it goes on; its lane is that of the vehicle that goes the same way, though another is nearer.
    assert found.position[0, 0] < 50 - 50 - 0.8 * REACH and found.position[-1, 0] > 50 + 50 + 0.8 * REACH
    assert found.position[:, 1] == pytest.approx(1.8)
    assert found.velocity[np.abs(ahead).argmin(), 0] == pytest.approx(12.0, abs=0.4)
    assert is_heard(found) and not is_heard(driven(11.0, 12.0, 1.8))


def test_what_is_too_faint_is_not_followed(hearing: Hearing) -> None:
    assert ridge(replace(hearing, snr_db={1: hearing.snr_db[1] - 30}), Heard(20.0, 12.0, 9.0, 0.6)) is None
    assert ridge(hearing, Heard(20.0, -12.0, 9.0, 0.6)) is None


def test_a_lane_that_nobody_drives_is_uncertain() -> None:
    y, sigma = lane(np.array([40.0, 60.0]), -1, 19.0, [driven(11.0, 12.0, 1.8)], TIME)
    assert y.tolist() == [1.8, 1.8] and sigma == NO_LANE


def test_what_goes_along_with_a_listed_vehicle_is_that_vehicle() -> None:
    listed = [driven(12.0, 20.0, 1.8)]
    assert is_listed(driven(12.5, 20.5, 1.0), listed, 0.0)
    assert not is_listed(driven(-12.5, 20.5, 1.0), listed, 0.0)
    assert not is_listed(driven(12.5, 23.0, 1.0), listed, 0.0)
    # The clock of the tracks is 3 s behind.
    assert is_listed(driven(12.5, 23.0, 1.0), listed, 15.0)
    # One that only catches up with it is another.
    assert not is_listed(driven(24.0, 22.0, 1.0), listed, 0.0)


def test_what_is_said_of_them() -> None:
    found = Unlisted([driven(12.0, 20.0 + i, 1.8, f"heard#{i}") for i in range(8)], 0, 2)
    line = unlisted_line(found, TIME)
    assert "8 fitted beside the others, their tracks free (heard#0 at 20 s, heard#1 at 21 s, " in line
    assert "heard#5 at 25 s, ...); 2 too faint to be followed, which stay in the residual" in line
    assert unlisted_line(Unlisted([], 0, 0), TIME) == ""


def test_what_has_no_weight_is_no_vehicle() -> None:
    listed = [driven(12.0, 20.0, 1.8, name) for name in ("1", "2", "3")]
    sizes = {"1": 2.0, "2": 1.0, "3": 8.0, "heard#1": 0.5, "heard#2": 0.1, "heard#3": -3.0}
    fitted = {f"amplitude[{name}]": Parameter(size, 0.01, "m^2", True) for name, size in sizes.items()}
    fitted["amplitude[heard#4]"] = Parameter(0.5, 0.2, "m^2", True)
    result = cast(FitResult, SimpleNamespace(parameters=fitted))
    heard = [driven(12.0, 25.0, 1.8, f"heard#{number}") for number in range(1, 6)]
    assert [weighs(result, one, listed) for one in heard] == [True, False, False, False, False]
    # On a long fiber a vehicle has an amplitude in each stretch.
    legs = {
        f"amplitude[{name} at x {x} m]": Parameter(size, 0.01, "m^2", True)
        for name, size in sizes.items()
        for x in (30, 90)
    }
    along = cast(FitResult, SimpleNamespace(parameters=legs))
    assert [weighs(along, one, listed) for one in heard] == [True, False, False, False, False]


def test_vehicles_close_behind_louder_ones_are_heard_in_what_a_fit_leaves(tmp_path: Path) -> None:
    """Twelve vehicles 2 to 7 s apart, every second of them not in the trajectories: one was heard before."""
    small = {"view": (0.0, 80.0), "channels": 201, "passes": 12, "headway": (2.0, 7.0), "snr_db": 18.0}
    made = simulator.simulate(read_scenario("street", seed=901, laid="winding", **small))
    survey = Survey.read(simulator.write_survey(made, tmp_path / "survey"))
    assert survey.tracks is not None
    gone = made.vehicles[1::2]
    some = survey.with_tracks(survey.tracks[~survey.tracks["track_id"].isin([one.track_id for one in gone])])
    run = locate(some, unlisted=True)
    time, heard = some.record.time, [one for one in run.passes if is_heard(one)]
    nearest = []
    for one in heard:
        inside = (one.position[:, 0] > 0) & (one.position[:, 0] < 80)
        off = [one.position[inside, 0] - each.position(time[one.rows[inside]])[:, 0] for each in gone]
        nearest.append(int(np.argmin([np.abs(each).mean() for each in off])))
        assert min(np.abs(each).mean() for each in off) < 1.5
    assert sorted(nearest) == list(range(6)) and run.result.chi2_per_dof < 1.05
    assert [line for line in run.warnings if line.endswith("at 61 s)")]


def test_a_fit_carries_vehicles_that_nobody_listed(tmp_path: Path) -> None:
    """On a street of seven vehicles, close together, of which three are not in the trajectories."""
    small = {"view": (0.0, 80.0), "channels": 201, "passes": 7, "headway": (4.0, 9.0), "snr_db": 18.0}
    made = simulator.simulate(read_scenario("street", seed=801, laid="winding", **small))
    survey = Survey.read(simulator.write_survey(made, tmp_path / "survey"))
    assert survey.tracks is not None
    gone = {made.vehicles[i].track_id for i in (1, 3, 5)}
    some = survey.with_tracks(survey.tracks[~survey.tracks["track_id"].isin(gone)])
    run = locate(some, unlisted=True)
    heard = [one for one in run.passes if is_heard(one)]
    assert len(heard) == 3 and [one.track_id for one in heard] == ["heard#1", "heard#2", "heard#3"]
    assert [line for line in run.warnings if "3 fitted beside the others, their tracks free" in line]
    time = some.record.time
    for one in heard:
        inside = (one.position[:, 0] > 0) & (one.position[:, 0] < 80)
        place = one.position[inside, 0]
        off = [place - v.position(time[one.rows[inside]])[:, 0] for v in made.vehicles if v.track_id in gone]
        assert min(np.abs(each).mean() for each in off) < 1.0
    without = locate(some)
    assert not [one for one in without.passes if is_heard(one)]
    assert run.result.chi2_per_dof < without.result.chi2_per_dof - 0.05
    known = run.route["constrained"]
    truth = made.route[run.route["channel"][known].to_numpy()]
    off = np.abs(run.route.loc[known, ["y", "z"]].to_numpy() - truth[:, 1:])
    assert (off < 3 * run.route.loc[known, ["sigma_y", "sigma_z"]].to_numpy()).mean() > 0.9
