import logging
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from drives import START, a_record, fixes

from solver.trajectory.kalman import process_noise
from solver.trajectory.passes import UNSEEN_ACCELERATION, likeliest, padded, smooth_passes
from solver.trajectory.tracks import tracks_of
from solver.trajectory.vehicle_pass import Pass, track_sigma
from vision.contract import InputError

FINE = np.arange(0.0, 60.0, 0.002)


def driven_x(kind):
    """x, m, at `FINE` of a car at 12 m/s at 20 s, x = 0."""
    acceleration = {
        "steady": 0 * FINE,
        "accelerating": 0.8 + 0 * FINE,
        "braking": -1.5 * np.exp(-(((FINE - 24) / 1.5) ** 2)),
        "restless": 0.5 * np.sin(2 * np.pi * FINE / 8),
    }[kind]
    x = np.cumsum(np.cumsum(acceleration) * 0.002 + 12) * 0.002
    return x - np.interp(20, FINE, x)


def passes_of(x, correlation, seeds):
    """Passes of the same drive seen for 8 s at 12.5 Hz, with errors of 6 cm from each of `seeds`."""
    seen = 20.03 + np.arange(100) * 0.08
    table = pd.concat(
        fixes(seen, np.interp(seen, FINE, x), -1.0, correlation=correlation, seed=seed, track_id=str(seed))
        for seed in seeds
    )
    return smooth_passes(table, a_record())


@pytest.mark.parametrize("kind", ["steady", "accelerating", "braking", "restless"])
@pytest.mark.parametrize(("correlation", "worst"), [(0.0, 0.022), (0.65, 0.04)])
def test_errors_are_small_and_as_large_as_they_say(kind, correlation, worst):
    x = driven_x(kind)
    passes = passes_of(x, correlation, range(40))
    assert len(passes) == 40
    errors, scaled = [], []
    for one in passes:
        time = one.rows / 5.0
        error = one.position - np.stack([np.interp(time, FINE, x), np.full(len(time), -1.0)], -1)
        errors.append(error[one.in_view])
        scaled.append((error / one.sigma)[one.in_view])
    rms = np.sqrt(np.mean(np.concatenate(errors) ** 2, axis=0))
    assert rms[0] < worst
    assert rms[1] < (0.012 if correlation == 0 else 0.025)
    spread = np.concatenate(scaled)
    assert (np.sqrt(np.mean(spread**2, axis=0)) < 1.25).all()
    assert (np.sqrt(np.mean(spread**2, axis=0)) > 0.8).all()
    assert np.mean(np.abs(spread) > 3) < 0.02


def test_likelihood_finds_how_errors_and_vehicle_behave():
    seen = 20.03 + np.arange(200) * 0.08
    chosen = {}
    for kind in ("steady", "restless"):
        for correlation in (0.0, 0.8):
            tables = [
                fixes(
                    seen, np.interp(seen, FINE, driven_x(kind)), 0.0, correlation=correlation, seed=k, track_id=str(k)
                )
                for k in range(10)
            ]
            tracks = list(tracks_of(pd.concat(tables), START, []))
            acceleration, memory = likeliest(padded(tracks), np.full(10, 0.08))
            chosen[kind, correlation] = np.median(acceleration[:, 0]), np.median(np.exp(-0.08 / memory[:, 0]))
    assert chosen["steady", 0.0][0] < 0.05
    assert chosen["restless", 0.0][0] > 0.2
    assert chosen["steady", 0.0][1] < 0.31
    assert 0.6 < chosen["steady", 0.8][1] < 0.95


def test_a_pass_is_followed_beyond_its_view():
    seen = 20 + np.arange(100) * 0.08
    table = fixes(seen, 10 * (seen - 20), -3.4, sigma=0.02, vehicle_class="van", length=5.5)
    (one,) = smooth_passes(table, a_record(), reach=30.0)
    assert (one.vehicle_class, one.length, one.track_id) == ("van", 5.5, "1")
    assert np.array_equal(np.diff(one.rows), np.ones(len(one.rows) - 1))
    assert one.position[[0, -1], 0] == pytest.approx([-30.0, 10 * 7.92 + 30.0], abs=2.1)
    assert np.allclose(one.position[:, 0], 10 * (one.rows / 5 - 20), atol=0.3)
    assert np.allclose(one.velocity, [10.0, 0.0], atol=0.1)
    assert one.speed == pytest.approx(10.0, abs=0.05)
    assert one.in_view.sum() == 40
    before = one.sigma[: one.in_view.argmax(), 0]
    assert (np.diff(before) < 0).all()
    assert before[0] > 5 * one.sigma[one.in_view, 0].max()


def test_the_record_clips_and_the_other_direction_is_negative():
    seen = 2 + np.arange(40) * 0.1
    (one,) = smooth_passes(fixes(seen, 60 - 15 * seen, 3.0), a_record(5.0))
    assert one.rows.tolist() == list(range(0, 25))
    assert one.speed == pytest.approx(-15.0, abs=0.1)


def test_wrong_fixes_weigh_little():
    seen = 20 + np.arange(100) * 0.08
    table = fixes(seen, 12 * (seen - 20), 0.0)
    table.loc[[0, 30, 31, 99], "x"] += [8.0, -5.0, -5.0, 9.0]
    (one,) = smooth_passes(table, a_record())
    assert np.abs(one.position[:, 0] - 12 * (one.rows / 5 - 20))[one.in_view].max() < 0.25


def test_sparse_gps_is_smoothed_too():
    seen = np.arange(5.0, 45.0)
    table = fixes(seen, 8 * (seen - 5), 2.0, sigma=1.5)
    (one,) = smooth_passes(table, a_record())
    error = one.position[one.in_view, 0] - 8 * (one.rows[one.in_view] / 5 - 5)
    assert np.sqrt(np.mean(error**2)) < 1.0
    assert (one.sigma[one.in_view] < 1.6).all()


def test_a_drive_up_and_down_is_two_passes():
    seen = np.arange(0.0, 58.0, 0.2)
    x = np.interp(seen, [0, 28, 30, 58], [0, 280, 280, 0])
    passes = smooth_passes(fixes(seen, x, 0.0), a_record())
    assert [one.track_id for one in passes] == ["1", "1#2"]
    assert [np.sign(one.speed) for one in passes] == [1, -1]
    assert passes[1].rows[0] == passes[0].rows[-1] + 1
    assert not set(passes[0].rows) & set(passes[1].rows)


def test_what_does_not_move_is_counted_and_left_out(caplog):
    seen = np.arange(10.0, 15.0, 0.1)
    table = pd.concat(
        [
            fixes(seen, 10 * seen, 0.0, track_id="moves"),
            fixes(seen, 3.0, 0.0, track_id="parked"),
            fixes(seen[:2], [0.0, 9.0], 0.0, track_id="short"),
            fixes(seen + 3600, 10 * seen, 0.0, track_id="later"),
        ]
    )
    with caplog.at_level(logging.INFO, logger="roadfiber"):
        passes = smooth_passes(table, a_record())
    assert [one.track_id for one in passes] == ["moves"]
    assert "of 4 tracks, 1 are not during the record and 2 do not move" in caplog.text
    with pytest.raises(InputError, match="no moving vehicle"):
        smooth_passes(table[table["track_id"] == "parked"], a_record())


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (
            lambda t: t.assign(x=1000 * t["x"]),
            "2 of 2 tracks (1, 2) go faster than any vehicle (90 m/s); check that x and",
        ),
        (lambda t: t.assign(x=t["x"] / 1000), "no track goes farther than 0.26 m; check that x and y are in m"),
        (
            lambda t: t.assign(sigma_x=500.0),
            "tracks of up to 49 m are lost in fixes of sigma 5e+02 m; check the sigmas",
        ),
        (
            lambda t: t.groupby("track_id").head(1),
            "no track has 3 fixes; give all fixes of a vehicle the same track_id",
        ),
        (lambda t: t.assign(track_id="1", x=t["x"] + 900 * (t["track_id"] == "2")), "1 of 1 tracks (1) go faster than"),
    ],
    ids=["mm", "km", "sigma", "one row per track", "one id for all"],
)
def test_tracks_that_no_vehicle_drives_are_one_clear_line(change, says):
    seen = 20 + np.arange(50) * 0.1
    table = pd.concat([fixes(seen + 0.05 * k, 10 * (seen - 20), 0.0, track_id=f"{k + 1}") for k in (0, 1)])
    assert len(smooth_passes(table, a_record())) == 2
    with pytest.raises(InputError) as caught:
        smooth_passes(change(table), a_record())
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_one_id_of_two_that_drive_together_is_said_to_be():
    seen = 20 + np.arange(30.0)
    together = pd.concat([fixes(seen, 8 * (seen - 20), 0.0), fixes(seen + 0.5, 8 * (seen - 20) - 30, 3.0)])
    with pytest.raises(
        InputError, match=r"1 of 1 tracks \(1\) go to and fro as no vehicle does; check .* own track_id"
    ):
        smooth_passes(together, a_record())


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 6])
def test_tracks_of_few_fixes_are_read(count):
    """Those of 3 to 5 ended in a traceback."""
    seen = 20 + np.arange(50) * 0.1
    few = fixes(20 + np.arange(count) * 0.5, 10 * np.arange(count) * 0.5, 3.0, track_id="few")
    passes = smooth_passes(pd.concat([few, fixes(seen, 10 * (seen - 20), 0.0)]), a_record())
    assert {one.track_id for one in passes} == ({"1"} if count < 3 else {"1", "few"})


def test_a_track_that_leaps_is_two_and_an_impossible_one_among_many_is_left_out():
    seen = 20 + np.arange(50) * 0.1
    leaping = fixes(seen, 10 * (seen - 20) + 200 * (seen > 22.45), 0.0, track_id="leaps")
    others = [fixes(seen, 10 * (seen - 20), float(k), track_id=f"{k}") for k in (1, 2)]
    swift = fixes(seen, 900 * (seen - 20), 0.0, track_id="swift")
    passes = smooth_passes(pd.concat([leaping, *others, swift]), a_record(), warnings=(said := []))
    assert sorted(one.track_id for one in passes) == ["1", "2", "leaps", "leaps#2"]
    assert said == ["trajectories: 1 of 5 tracks (swift) go faster than any vehicle (90 m/s); they are left out"]


def test_a_pass_in_a_gap_is_left_out():
    tables = [fixes(at + np.arange(50) * 0.1, 10 * np.arange(50) * 0.1, 0.0, track_id=str(at)) for at in (10, 40)]
    record = a_record(missing=slice(20, 120))
    assert [one.track_id for one in smooth_passes(pd.concat(tables), record)] == ["40"]


@pytest.mark.parametrize("shift", [-3600.0, 3600.0])
def test_no_overlap_is_one_clear_line(shift):
    seen = shift + np.arange(50) * 0.1
    with pytest.raises(InputError) as caught:
        smooth_passes(fixes(seen, 10 * seen, 0.0), a_record())
    hour = "05" if shift < 0 else "07"
    assert f"trajectories (2025-08-11T{hour}:00:00Z to 2025-08-11T{hour}:00:04Z)" in str(caught.value)
    assert "DAS (2025-08-11T06:00:00Z to 2025-08-11T06:00:59Z) do not overlap in time" in str(caught.value)


def test_no_tracks_is_one_clear_line():
    with pytest.raises(InputError, match="no trajectories"):
        smooth_passes(fixes([1.0], 0.0, 0.0).iloc[:0], a_record())


def test_a_day_of_gps_is_read_where_the_record_is():
    seen = np.arange(-20_000.0, 20_000.0)
    table = fixes(seen, 100 * np.sin(seen / 10), 0.0, sigma=0.5)
    passes = smooth_passes(table, a_record())
    assert [one.track_id for one in passes] == ["1", "1#2", "1#3"]
    for one in passes:
        assert np.abs(one.position[:, 0] - 100 * np.sin(one.rows / 50)).max() < 2.5


def test_many_tracks_of_many_lengths():
    rng = np.random.default_rng(1)
    tables = []
    for number in range(80):
        seen = rng.uniform(0, 40) + np.arange(rng.integers(20, 60)) * 0.1
        tables.append(fixes(seen, 10 * (seen - seen[0]), 0.0, seed=number, track_id=str(number)))
    passes = smooth_passes(pd.concat(tables), a_record())
    alone = smooth_passes(tables[17], a_record())[0]
    together = next(one for one in passes if one.track_id == "17")
    assert len(passes) == 80
    assert np.array_equal(together.rows, alone.rows)
    assert np.allclose(together.position, alone.position, atol=1e-6)
    assert np.allclose(together.sigma, alone.sigma, rtol=1e-4)


def test_speed_of_a_pass_out_of_view():
    still = np.zeros((3, 2))
    one = Pass(
        "1", "car", np.arange(3), np.arange(6.0).reshape(3, 2), np.full((3, 2), [2.0, 0.0]), still, np.zeros(3, bool)
    )
    assert one.speed == 2.0


def test_out_of_sight_a_driver_may_do_what_drivers_do_however_steady_the_drive_was():
    """Sigma out of view is at least what unseen accelerations add to a drive that is known exactly."""
    seen = 20 + np.arange(100) * 0.08
    (one,) = smooth_passes(fixes(seen, 10 * (seen - 20), -3.4, sigma=1e-3), a_record())
    after = one.rows / 5.0 - seen[-1]
    last = after > 1.0
    added = process_noise(after[last], np.array(UNSEEN_ACCELERATION), np.array(1.0))[:, 0, 0] ** 0.5
    assert last.any() and (one.sigma[last, 0] > 0.99 * added).all()


def test_long_gauges_follow_a_vehicle_farther():
    seen = 20 + np.arange(50) * 0.1
    table = fixes(seen, 10 * (seen - 20), 0.0)
    (usual,), (long,) = (smooth_passes(table, replace(a_record(), gauge_length=gauge)) for gauge in (10.0, 50.0))
    # 30 m farther at 10 m/s and 5 samples a second, before and after.
    assert len(long.rows) - len(usual.rows) == pytest.approx(2 * 30.0 / 10 * 5, abs=2)


def test_a_track_is_as_uncertain_as_the_square_mean_of_its_sigmas_in_view():
    sigma = np.array([[0.3, 0.4], [0.3, 0.4], [9.0, 9.0]])
    one = Pass("1", "car", np.arange(3), np.zeros((3, 2)), np.ones((3, 2)), sigma, np.array([True, True, False]))
    wild = replace(one, sigma=100 * sigma)
    assert track_sigma([one, one, wild]) == pytest.approx((0.5 * (0.3**2 + 0.4**2)) ** 0.5)
