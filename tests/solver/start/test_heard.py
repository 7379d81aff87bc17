"""The fiber hears vehicles that nobody listed, and whose clock is off."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import roadfiber as rf
from roadfiber.survey_commands import vehicles as listed
from solver import simulator
from solver.simulator.scenario import read_scenario
from solver.start.heard import Heard, middle_times, pair, without_lobes
from vision.contract import InputError

LATE = 0.8


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[simulator.Survey, Path]:
    """Five vehicles, of which the camera missed the second; its clock is behind by 0.8 s."""
    survey = simulator.simulate(read_scenario("street-blind", seed=4, passes=5, laid="winding"))
    site = simulator.write_survey(survey, tmp_path_factory.mktemp("heard") / "survey")
    path = site.parent / "trajectories.csv"
    table = pd.read_csv(path, dtype={"track_id": str})
    table = table[table["track_id"] != survey.vehicles[1].track_id]
    table["time"] = (pd.to_datetime(table["time"]) - pd.Timedelta(seconds=LATE)).dt.strftime("%Y-%m-%dT%H:%M:%S.%fZ")
    table.to_csv(path, index=False)
    return survey, site


def test_every_vehicle_is_heard_also_one_that_nobody_listed(made, capsys: pytest.CaptureFixture[str]) -> None:
    survey, site = made
    found = rf.vehicles(site)
    truth = sorted(survey.vehicles, key=lambda one: one.time_at)
    assert len(found.table) == len(truth) == 5 and found.unheard == []
    missed = survey.vehicles[1].track_id
    assert found.table["track_id"].tolist() == ["" if one.track_id == missed else one.track_id for one in truth]
    assert np.sign(found.table["speed"]).tolist() == [one.direction for one in truth]
    speed = np.array([one.speed for one in truth])
    assert (np.abs(found.table["speed"].abs() / speed - 1) < 0.2).all()
    assert abs(found.clock_offset - LATE) < 0.15 and found.clock_sigma < 0.2
    assert "heard 5 vehicles; 4 of them are in the trajectories, 1 is not" in found.headline
    listed(site, out=site.parent / "heard.csv", as_json=True)
    assert json.loads(capsys.readouterr().out)["headline"] == found.headline
    assert len(pd.read_csv(site.parent / "heard.csv")) == 5
    assert "not in the trajectories" not in repr(found) and "<table" in found._repr_html_()


def test_pairs_tell_the_clock_though_most_that_was_heard_was_not_seen() -> None:
    rng = np.random.default_rng(2)
    middle, speed = np.sort(rng.uniform(0, 3600, 150)), rng.choice([-13.0, 12.0, 17.0], 150)
    seen = [
        Heard(t + 2.3 + rng.normal(0, 0.1), v * rng.uniform(0.9, 1.1), 20.0, 1.0)
        for t, v in zip(middle, speed, strict=True)
    ]
    strangers = [Heard(t, 12.0, 20.0, 1.0) for t in rng.uniform(0, 3600, 200)]
    found = pair(sorted([*seen[20:], *strangers], key=lambda one: one.time), middle, speed)
    assert found.offset == pytest.approx(2.3, abs=0.05) and 0.003 < found.sigma < 0.03
    assert (found.seen >= 0).sum() >= 125
    assert len(set(found.seen[found.seen >= 0].tolist())) == (found.seen >= 0).sum()


def test_nothing_heard_or_seen_tells_no_clock() -> None:
    assert np.isnan(pair([], np.array([3.0]), np.array([9.0])).offset)
    assert np.isnan(pair([Heard(3.0, 9.0, 20.0, 1.0)], np.array([np.nan]), np.array([9.0])).offset)
    assert np.isnan(pair([Heard(3.0, 9.0, 20.0, 1.0)], np.array([3.0]), np.array([-9.0])).sigma)


def test_lobes_are_no_vehicles_and_two_of_a_kind_are_two() -> None:
    loud = Heard(50.0, 10.0, 38.0, 1.0)
    lobe, far, other = Heard(55.0, 11.0, 14.0, 0.7), Heard(90.0, 11.0, 14.0, 0.7), Heard(51.0, -10.0, 35.0, 1.0)
    assert without_lobes([lobe, far, other, loud]) == [loud, other, far]


def test_a_pass_goes_by_the_middle_once_or_never(survey) -> None:
    passes, time = survey.problem.passes, np.arange(10000) / survey.problem.sampling_rate
    one = passes[0]
    row = len(one.rows) // 2
    found = middle_times(passes, float(one.position[row, 0]), time)
    assert found[0] == pytest.approx(time[one.rows[row]])
    assert np.isnan(middle_times(passes, 1e4, time)).all()


def test_a_survey_without_tracks_is_told_to_track_first(made) -> None:
    whole = rf.read(made[1])
    bare = type(whole).of(**vars(whole) | {"tracks": None})
    with pytest.raises(InputError, match="track its video first"):
        rf.vehicles(bare)


def test_a_run_takes_apart_vehicles_that_hide_each_other(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Twelve vehicles 2 to 7 s apart, every second of them not in the trajectories."""
    small = {"view": (0.0, 80.0), "channels": 201, "passes": 12, "headway": (2.0, 7.0), "snr_db": 18.0}
    made = simulator.simulate(read_scenario("street", seed=902, laid="winding", **small))
    survey = rf.read(simulator.write_survey(made, tmp_path / "survey"))
    gone = {one.track_id for one in made.vehicles[1::2]}
    some = survey.with_tracks(survey.tracks[~survey.tracks["track_id"].isin(gone)])
    alone = rf.vehicles(some)
    assert len(alone.table) < 8 and len(alone.unheard) > 2
    run = rf.locate(some, corridor="fit")
    found = rf.vehicles(some, run)
    time = np.arange(0.0, survey.record.time[-1], 0.02)
    middle = np.sort([time[np.abs(one.position(time)[:, 0] - 40).argmin()] for one in made.vehicles])
    heard = np.array([one.time for one in found.paired.heard])
    assert len(heard) == 12 and np.abs(heard - middle).max() < 1.0
    assert found.unheard == [] and (found.table["track_id"] != "").sum() == 6
    run.save(tmp_path / "run")
    listed(tmp_path / "survey", run=tmp_path / "run")
    assert "heard 12 vehicles; 12 of them are in the trajectories" in capsys.readouterr().out
    other = simulator.simulate(read_scenario("street-short", seed=1, laid="winding"))
    with pytest.raises(InputError, match="the run is of another record"):
        rf.vehicles(rf.read(simulator.write_survey(other, tmp_path / "other")), run)
