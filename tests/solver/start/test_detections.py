import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from drive_by import a_street, drive

from solver.start.detections import MatchedFilter, excess, mended, snr_maps, thinned
from solver.start.wavelets import SCALES, bank


def test_bank_is_zero_mean_and_of_unit_energy():
    wavelets = bank(SCALES)
    np.testing.assert_allclose(wavelets.sum(0), 0, atol=1e-12)
    np.testing.assert_allclose((wavelets**2).sum(0), 1)


def test_snr_map_is_the_correlation_over_its_median_deviation():
    rng = np.random.default_rng(0)
    data, scales = rng.normal(size=(7, 60)), np.array([2.0, 3.0])
    positive, negative = snr_maps(data, scales)
    maps = []
    for shape in bank(scales).T:
        half = len(shape) // 2
        padded = np.pad(data, ((0, 0), (half, half)), mode="edge")
        match = np.array([[row[c : c + len(shape)] @ shape for c in range(60)] for row in padded])
        maps.append(match / (1.4826 * np.median(np.abs(match - np.median(match)))))
    np.testing.assert_allclose(positive, np.max(maps, axis=0), atol=1e-9)
    np.testing.assert_allclose(negative, -np.min(maps, axis=0), atol=1e-9)


def test_silent_channels_do_not_make_the_noise_look_small():
    data = np.random.default_rng(0).normal(size=(40, 300))
    dead = data.copy()
    dead[:, 60:] = np.nan
    whole, _ = snr_maps(data, SCALES)
    one = drive("1", "car", 12.0, 0.0, 6.0, 5.0)
    partly = MatchedFilter(dead, [replace(one, rows=np.arange(40))], SCALES)
    assert partly.positive[:, :50].max() < 1.5 * whole.max()


def test_mended_takes_out_spikes_and_gaps_and_leaves_a_vehicle_alone():
    shape = 40 * bank([6.0])[:, 0]
    rng = np.random.default_rng(1)
    clean = np.tile(np.pad(shape, 40), (30, 1)) + rng.normal(0, 0.2, (30, len(shape) + 80))
    # At 70 times the noise a peak may lose what the noise adds to it.
    assert (mended(clean) != clean).mean() < 0.01
    assert np.abs(mended(clean) - clean).max() < 1.5
    spoiled = clean.copy()
    spoiled[::3, 15] += 50
    spoiled[:, 20] = np.nan
    spoiled[4] = np.nan
    again = mended(spoiled)
    rows = np.arange(30) != 4
    assert np.abs(again - clean)[rows].max() < 1.5
    assert (again[4] == 0).all()


@pytest.mark.parametrize("stride", [2, 3, 7])
def test_thinned_passes_count_frames(stride: int):
    one = drive("1", "car", 12.0, 0.0, 8.0, 50.0)
    time = np.arange(one.rows[-1] + 5) / 50.0
    frames, (thin,) = thinned(np.column_stack([time, time]), [one], stride)
    # The mean place belongs to the mean time of the frame.
    np.testing.assert_allclose(frames[thin.rows][:, 0], 8.0 + (thin.position[:, 0] - 30.0) / 12.0)
    assert (np.diff(thin.rows) == 1).all()
    assert len(thin.rows) >= len(one.rows) // stride - 1


def test_a_pass_shorter_than_a_frame_is_left_empty():
    one = drive("1", "car", 12.0, 0.0, 8.0, 50.0)
    short = replace(
        one, **{name: getattr(one, name)[:3] for name in ("rows", "position", "velocity", "sigma", "in_view")}
    )
    _, (thin,) = thinned(np.zeros((900, 4)), [short], 10)
    assert len(thin.rows) == 0


def test_detections_follow_the_vehicle_and_know_its_direction():
    record, passes, route = a_street(noise=0.05)
    matched = MatchedFilter(record.strain_rate, passes, SCALES)
    for one in passes:
        seen = matched.detect(one, 1)
        assert len(seen) == one.in_view.sum()
        assert (seen.snr_db > 7).all()
        off = np.interp(seen.channel, np.arange(len(route)), route[:, 0]) - seen.x
        assert np.median(np.abs(off)) < 1.5
        wrong = matched.detect(one, -1)
        assert np.median(wrong.snr_db) < np.median(seen.snr_db)


def test_gate_looks_only_where_it_is_told():
    record, passes, _ = a_street(noise=0.05)
    matched = MatchedFilter(record.strain_rate, passes, SCALES)
    one = passes[0]
    expected = (one.position[:, 0] + 15.0) / 1.021
    assert len(matched.detect(one, 1, expected, 4)) == one.in_view.sum()
    # 25 channels away there is only the flank of the response, or noise.
    assert len(matched.detect(one, 1, expected + 25, 4)) < 0.5 * one.in_view.sum()
    assert len(matched.detect(one, 1, expected + 500, 4)) == 0


def test_nothing_is_detected_where_nothing_is_measured():
    record, passes, _ = a_street(noise=0.05)
    strain_rate = record.strain_rate.copy()
    gap = passes[0].rows[passes[0].in_view][2:6]
    strain_rate[gap] = np.nan
    seen = MatchedFilter(strain_rate, passes, SCALES).detect(passes[0], 1)
    assert not np.isin(gap, seen.row).any()
    assert len(seen) == passes[0].in_view.sum() - 4


def test_the_matched_filter_takes_the_memory_of_the_frames_that_passes_fill():
    record, passes, _ = a_street(noise=0.05, rate=20.0)
    hours = np.full((60 * len(record.strain_rate), record.strain_rate.shape[1]), np.nan, np.float32)
    hours[: len(record.strain_rate)] = record.strain_rate
    wanted, thin = thinned(record.strain_rate.astype(np.float32), passes, 2)
    seen = MatchedFilter(wanted, thin, SCALES, excess(wanted)).positive
    tracemalloc.start()
    try:
        frames, thin = thinned(hours, passes, 2)
        again = MatchedFilter(frames, thin, SCALES, excess(frames)).positive
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert np.array_equal(again, seen)
    assert peak < 0.5 * hours.nbytes
