"""The generator of drives, against the signal path, from which it shares no code."""

import json
from dataclasses import replace

import numpy as np
import pytest

import roadfiber as rf
from solver.drive.path import STEP, path_of
from solver.drive.quiet import Quiet
from solver.drive.response import Legs, strain_rate
from solver.simulator.drive_record import record_drive
from solver.simulator.drive_road import Ground
from solver.simulator.drive_scenario import DriveScenario, read_drive
from solver.simulator.drive_traffic import gps_fixes

CLEAN = DriveScenario(
    length=600.0,
    sampling_rate=10.0,
    snr_db=80.0,
    traffic=0.0,
    loops_per_km=0.0,
    bad_channels=0.0,
    polarity=1,
    u_turns=0,
)


def test_strain_rate_is_what_the_signal_path_says() -> None:
    drive = record_drive(CLEAN)
    cable, distance, car = drive.ground.cable, drive.ground.distance, drive.car
    path = path_of(cable.points[:, :2])
    place = car.at(drive.time)[0]
    velocity = np.gradient(place, drive.time, axis=0)
    channel = int(np.argmin(np.abs(distance - cable.cable.mean())))
    where = cable.at(distance[channel : channel + 1])[0]
    cell, _ = path.nearest(where[:2])
    near = np.flatnonzero(np.linalg.norm(place - where[:2], axis=1) < 30)
    quiet = Quiet.__new__(Quiet)
    object.__setattr__(quiet, "gauge_length", CLEAN.gauge_length)

    class Known:
        vehicle_class = "car"

    legs = Legs.__new__(Legs)
    driven = type("Driven", (), {"position": place, "velocity": velocity})()
    object.__setattr__(legs, "driven", driven)
    lateral = (where[:2] - path.points[cell]) @ path.across[cell]
    cells = np.full(len(near), int(cell))
    model = strain_rate(quiet, path, Known(), legs, cells, np.full(len(near), lateral), near, depth=where[2])
    measured = drive.rate[near, channel].astype(float)
    assert np.corrcoef(model, measured)[0, 1] > 0.98
    assert STEP == 1.0


def test_loops_are_silent_and_longer_than_their_path() -> None:
    ground = Ground(replace(CLEAN, loops_per_km=6.0, length=1500.0, seed=2))
    loops, cable = ground.cable.loops, ground.cable
    assert len(loops) > 1
    extra = sum(one.end - one.begin for one in loops)
    stretched = (cable.cable[-1] - cable.cable[0] - extra) / cable.arc[-1]
    assert stretched == pytest.approx(1.0, abs=0.04)
    inside = np.array([(one.begin + one.end) / 2 for one in loops])
    assert cable.slack(inside).all()
    assert not cable.slack(inside + 200.0).all()


def test_the_same_seed_is_the_same_drive() -> None:
    one, other = (record_drive(replace(CLEAN, seed=5, snr_db=5.0)) for _ in range(2))
    assert np.array_equal(one.rate, other.rate)
    assert one.clock_offset == other.clock_offset
    time, place, sigma = gps_fixes(one.ground.scenario, one.car)
    off = np.linalg.norm(place - one.car.at(time)[0], axis=1)
    assert 0.5 * sigma < np.median(off) < 2.5 * sigma
    assert off.max() < 60


def test_settings_out_of_range_are_one_line(tmp_path) -> None:
    for change, told in (({"length": 10.0}, "length"), ({"polarity": 3}, "polarity"), ({"lanes": 3}, "no setting")):
        with pytest.raises(rf.InputError, match=told):
            read_drive("drive", **change)
    (tmp_path / "a.toml").write_text('base = "drive"\nlength = 900.0\nspeeds = [30, 40]\n')
    assert read_drive(tmp_path / "a.toml", seed=4).speeds == (30, 40)
    (tmp_path / "b.toml").write_text("passes = 4\n")
    assert read_drive(tmp_path / "b.toml") is None
    with pytest.raises(rf.InputError, match="a drive has no camera"):
        rf.simulate(tmp_path / "x", "drive", film=True)
    with pytest.raises(rf.InputError, match="a drive can hide clock_drift, channel_stretch, gauge_length, nothing"):
        rf.simulate(tmp_path / "x", "drive", effects={"stiffness_contrast": 0.1})


def test_what_files_state_wrongly_is_in_the_files_alone(tmp_path) -> None:
    small = {"length": 600.0, "sampling_rate": 5.0, "traffic": 0.0, "seed": 2}
    wrong = {"gauge_length": 0.25, "channel_stretch": -0.05, "clock_drift": 0.01}
    plain = rf.read(rf.simulate(tmp_path / "plain", "drive", **small).site)
    hidden = rf.read(rf.simulate(tmp_path / "hidden", "drive", effects=wrong, **small).site)
    one, other = (drive.source.known for drive in (plain, hidden))
    assert other.gauge_length == pytest.approx(10.0 / 1.25)
    assert other.channel_spacing == pytest.approx(8.0 / 0.95)
    took = [np.ptp(drive.tracks["time"].astype("int64")) for drive in (plain, hidden)]
    assert took[1] == pytest.approx(0.99 * took[0], rel=1e-4)
    assert one.gauge_length == 10.0
    assert json.loads((tmp_path / "hidden" / "truth.json").read_text())["effects"] == wrong
