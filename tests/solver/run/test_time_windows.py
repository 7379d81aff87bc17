"""A survey of an hour with vehicles at its begin and its end: only the time around them is held."""

import tracemalloc
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import roadfiber as rf
from solver.simulator import Survey, write_survey
from solver.survey.das.ingest import ingest
from solver.survey.das.opened import Raw, opened
from solver.survey.das.prodml import write_prodml
from solver.survey.das.store import Store
from solver.survey.das.time_windows import APART

LATER = 3600.0


@pytest.fixture(scope="module")
def hour(street: Survey, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The street's vehicles come again after an hour, between two hours of noise."""
    site = write_survey(street, tmp_path_factory.mktemp("hour") / "s")
    rate, signal = street.scenario.sampling_rate, street.signal
    rows, again = len(signal), round(LATER * rate)
    rng, setting = np.random.default_rng(5), street.scenario
    record = rng.normal(0, street.noise_sd, (again + rows, signal.shape[1]))
    record[:rows] += signal
    record[again:] += signal
    for path in site.parent.glob("das/*.h5"):
        path.unlink()
    gauges = {"gauge_length": setting.gauge_length, "channel_spacing": setting.channel_spacing}
    write_prodml(site.parent / "das" / "a.h5", record, start=street.start, sampling_rate=rate, **gauges)
    tracks = pd.read_csv(site.parent / "trajectories.csv")
    stamps = pd.to_datetime(tracks["time"], utc=True, format="ISO8601") + pd.Timedelta(seconds=LATER)
    more = tracks.assign(track_id="again " + tracks["track_id"].astype(str))
    more["time"] = stamps.dt.strftime("%Y-%m-%dT%H:%M:%S.%fZ")
    pd.concat([tracks, more]).to_csv(site.parent / "trajectories.csv", index=False)
    return site


@pytest.fixture(scope="module")
def run(hour: Path) -> rf.Run:
    return rf.locate(hour, corridor="fit")


def test_the_time_between_vehicles_is_not_held(hour: Path, street: Survey) -> None:
    record = rf.read(hour).record
    whole = LATER * record.sampling_rate + len(street.time)
    assert len(record.time) < 2 * len(street.time) + (4 * 90 + APART) * record.sampling_rate < 0.3 * whole
    first, second = record.windows
    assert record.time[second][0] > LATER - 150 > 1000 > record.time[first][-1]
    for rows in (first, second):
        np.testing.assert_allclose(np.diff(record.time[rows]), 1 / record.sampling_rate, rtol=1e-6)
        assert record.measured[rows].sum() > len(street.time)
    read = record.measured
    assert not read[second.start - 80 : second.start + 80].any()
    end = str(street.start + np.timedelta64(round((whole - 1) * 1e9 / record.sampling_rate), "ns"))
    assert str(record.recorded.end) == end


def test_each_window_is_what_it_is_in_the_whole(hour: Path) -> None:
    survey = rf.read(hour)
    some, whole = survey.record, survey.at_all_times().record
    rows = np.rint(some.time[some.measured] * whole.sampling_rate).astype(int)
    assert np.array_equal(some.strain_rate[some.measured], whole.strain_rate[rows])
    assert whole.windows == [slice(0, len(whole.time))]


def test_a_store_has_the_same_windows(hour: Path, tmp_path: Path) -> None:
    files = sorted(hour.parent.glob("das/*.h5"))
    source = opened(files, {"quantity": "strain_rate"})
    assert isinstance(source, Raw)
    store = ingest(source.known, files, {}, tmp_path / "store")
    assert isinstance(store, Store)
    second = np.timedelta64(1, "s")
    times = [(store.start + at * second, store.start + (at + 200) * second) for at in (10, 1800, 3300)]
    wanted, found = (one.record(channels=(20, 60), times=times) for one in (source, store))
    assert len(found.windows) == 3
    assert np.array_equal(found.time, wanted.time)
    np.testing.assert_allclose(found.strain_rate, wanted.strain_rate, rtol=1e-6, atol=1e-13, equal_nan=True)


def test_the_route_is_that_of_all_times(hour: Path, run: rf.Run, street: Survey) -> None:
    whole = rf.locate(rf.read(hour).at_all_times(), corridor="fit")
    assert len(run.problem.passes) == len(whole.problem.passes) == 8
    assert np.array_equal(run.result.channel, whole.result.channel)
    # The quiet time tells the noise, and there is more of it in all.
    assert np.abs(run.result.route - whole.result.route).max() < 0.02
    inside = np.isin(run.result.channel, np.arange(street.active[0], street.active[1] + 1))
    off = run.result.route[inside] - street.route[run.result.channel[inside]]
    assert np.linalg.norm(off, axis=1).max() < 0.25
    assert 0.95 < run.result.chi2_per_dof < 1.05


def test_a_run_knows_when_its_vehicles_came(run: rf.Run, tmp_path: Path) -> None:
    problem = run.problem
    first, again = ([one for one in problem.passes if one.track_id.startswith("again") == late] for late in (0, 1))
    middles = [problem.time_of(np.mean([one.rows[0] for one in passes])) for passes in (first, again)]
    assert middles[1] - middles[0] == pytest.approx(LATER, abs=1.0)
    np.testing.assert_allclose(run.time, problem.time_of(run.result.samples), atol=1e-6)
    run.save(tmp_path / "run")
    opened = rf.open(tmp_path / "run")
    assert opened.problem.windows == problem.windows and len(problem.windows) == 1
    assert np.array_equal(opened.time, run.time)


def test_an_effect_of_time_sees_the_hour(hour: Path) -> None:
    """By rows, the clock would drift eight times as fast."""
    tracks, drift = rf.read(hour).tracks, 2e-3 / 60
    began = tracks["time"].min()
    survey = rf.read(hour).with_tracks(tracks.assign(time=began + (tracks["time"] - began) * (1 + drift)))
    run = rf.locate(survey, effects=["wheel_layout", "curved_gauge", "clock_drift"], corridor="fit")
    found = run.result.parameters["clock_drift.rate"]
    assert abs(found.value + drift) < 3 * found.sigma < 0.6 * drift


def test_memory_follows_what_is_held(hour: Path) -> None:
    peaks = []
    for read in (rf.read, lambda path: rf.read(path).at_all_times()):
        tracemalloc.start()
        try:
            rf.locate(read(hour), corridor="fit")
            peaks.append(tracemalloc.get_traced_memory()[1])
        finally:
            tracemalloc.stop()
    assert peaks[0] < 0.5 * peaks[1]
