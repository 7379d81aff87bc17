import numpy as np
import pandas as pd
import pytest

from vision.contract import InputError
from vision.jitter import LIMIT, bin_edges, deviations, jitter_by_bin, jitter_floor, parked, stride


def drive(track_id=1, frames=200, speed=10.0, noise=0.0, every=1, seed=0, rate=25.0, start=0.0):
    frame = np.arange(0, frames, every)
    place = np.stack([start + speed * frame / rate, np.full(len(frame), 1.75)], axis=1)
    place += np.random.default_rng(seed).normal(0, noise, place.shape)
    return pd.DataFrame(
        {"track_id": str(track_id), "frame": frame, "time": frame / rate, "x": place[:, 0], "y": place[:, 1]}
    )


def test_it_is_the_rolling_mean_of_fifteen_frames():
    table = drive(noise=0.2)
    expected = table[["x", "y"]] - table[["x", "y"]].rolling(15, center=True).mean()
    np.testing.assert_allclose(deviations(table), expected, atol=1e-9)
    assert expected.notna().sum().tolist() == [186, 186]


def test_tracks_do_not_mix_and_rows_may_come_in_any_order():
    both = pd.concat([drive(1, noise=0.1), drive(2, speed=-8, noise=0.1, seed=1, start=90)], ignore_index=True)
    alone = pd.concat([deviations(both.iloc[:200]), deviations(both.iloc[200:])])
    shuffled = both.sample(frac=1, random_state=3)
    pd.testing.assert_frame_equal(deviations(shuffled).sort_index(), alone)


def test_every_other_frame_counts_as_a_frame():
    table = drive(frames=400, every=2, noise=0.2)
    assert stride(table["frame"].to_numpy()) == 2
    expected = table[["x", "y"]] - table[["x", "y"]].rolling(15, center=True).mean()
    np.testing.assert_allclose(deviations(table), expected, atol=1e-9)


def test_missing_frames_look_like_jitter_until_they_are_interpolated():
    table = drive().drop(index=[100, 101, 102])
    before = np.hypot(*deviations(table).to_numpy().T)
    assert np.nanmax(before) == pytest.approx(0.4 * (5 + 6 + 7) / 12), "the farthest three are missing"
    assert np.nanmax(np.abs(deviations(table, straight=True))) < 1e-9
    assert np.nanmax(np.abs(deviations(drive()))) < 1e-9


def test_a_straight_line_takes_out_uneven_frames():
    table = drive()
    table["time"] = np.cumsum(np.tile([0.02, 0.06], 100))
    table["x"] = 10 * table["time"]
    assert np.nanmax(np.abs(deviations(table))) > 0.1
    assert np.nanmax(np.abs(deviations(table, straight=True))) < 1e-9


def test_ten_bins_with_mean_and_deviation():
    quiet, rough = drive(1, 500, 5.0, 0.03), drive(2, 500, 5.0, 0.4, seed=1, start=100.0)
    bins = jitter_by_bin(pd.concat([quiet, rough], ignore_index=True))
    assert len(bins) == 10 and bins["fixes"].sum() == 2 * 486
    # Length of a two-dimensional normal deviation (Rayleigh): mean sqrt(pi/2), sd sqrt(2 - pi/2); of 15, one is itself.
    scale = np.sqrt(14 / 15)
    assert bins["mean"].iloc[:5].mean() == pytest.approx(0.03 * np.sqrt(np.pi / 2) * scale, rel=0.1)
    assert bins["mean"].iloc[5:].mean() == pytest.approx(0.4 * np.sqrt(np.pi / 2) * scale, rel=0.1)
    assert bins["sd"].iloc[5:].mean() == pytest.approx(0.4 * np.sqrt(2 - np.pi / 2) * scale, rel=0.1)
    assert (bins["mean"].iloc[:5] < LIMIT).all() and (bins["mean"].iloc[5:] > LIMIT).all()


def test_empty_bins_are_empty():
    bins = jitter_by_bin(drive(noise=0.1), edges=np.array([-50.0, -20.0, 100.0]))
    assert bins["fixes"].tolist() == [0, 186] and np.isnan(bins["mean"].iloc[0])
    assert bin_edges(np.array([3.0, 3.0])).tolist() == pytest.approx(np.linspace(3, 4, 11).tolist())


def test_parked_cars_give_the_floor():
    standing, moving = drive("p", speed=0.0, noise=0.05), drive("m", noise=0.5, seed=1)
    both = pd.concat([standing, moving], ignore_index=True)
    assert parked(both) == ["p"]
    assert jitter_floor(both) == pytest.approx(0.05 * np.sqrt(2 * 14 / 15), rel=0.1)
    assert jitter_floor(moving) is None
    assert parked(drive("short", 100, speed=0.0)) == [], "four seconds may be a red light"


def test_datetimes_are_times():
    table = drive(noise=0.1)
    stamped = table.assign(time=pd.Timestamp("2025-08-11", tz="UTC") + pd.to_timedelta(table["time"], unit="s"))
    np.testing.assert_allclose(deviations(stamped, straight=True), deviations(table, straight=True), atol=1e-9)


@pytest.mark.parametrize("window", [1, 14])
def test_windows_have_a_middle(window):
    with pytest.raises(InputError, match="odd number"):
        deviations(drive(), window=window)
