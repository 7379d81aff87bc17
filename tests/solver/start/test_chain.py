"""Each step of the paper's chain, and the chain on passes beside a known fiber."""

import numpy as np
import pytest
from drive_by import SPACING, a_street, record_of

from solver.start.detections import scale_maps, snr_maps
from solver.start.initialization import initialize
from solver.start.matched_filter import (
    channel_range,
    directionally_consistent,
    first_principal_component,
    longest_rise,
    loudest,
    trace,
)
from solver.start.wavelets import bank
from vision.contract import InputError


def test_the_loudest_scale_and_channel_of_a_wavelet_in_noise():
    scales = np.arange(2.0, 12.25, 0.5)
    rng = np.random.default_rng(0)
    frames = 0.05 * rng.normal(size=(4, 240))
    for row, (scale, place) in enumerate([(4.0, 60), (6.0, 120), (9.0, 180)]):
        shape = bank([scale])[:, 0]
        frames[row, place - len(shape) // 2 : place + len(shape) // 2 + 1] += shape
    found = loudest(scale_maps(frames, scales), scales)
    assert np.abs(found.channel[:3] - [60, 120, 180]).max() <= 1
    np.testing.assert_allclose(found.scale[:3], [4.0, 6.0, 9.0], atol=1.0)
    assert found.snr_db[:3].min() > 15.0 > found.snr_db[3] > 7.0
    positive, _ = snr_maps(frames, scales)
    np.testing.assert_allclose(10 ** (found.snr_db / 20), positive.max(1))


def test_consistency_drops_what_jumps_and_keeps_what_moves_either_way():
    rng = np.random.default_rng(1)
    channel = np.arange(80) + rng.integers(0, 2, 80)
    wild = rng.permutation(80)[:20]
    channel[wild] = rng.integers(0, 80, 20)
    for order in (channel, channel[::-1]):
        kept = directionally_consistent(order)
        assert kept.sum() >= 60
        steps = np.diff(order[kept])
        assert (steps >= -1).all() or (steps <= 1).all()


def test_the_longest_rise_is_the_longest():
    rng = np.random.default_rng(2)
    for _ in range(20):
        values = rng.integers(0, 9, 9)
        subsets = [[values[i] for i in range(9) if bits >> i & 1] for bits in range(1, 512)]
        longest = max(len(s) for s in subsets if s == sorted(s))
        assert longest_rise(values, 0.0).sum() == longest
    assert not longest_rise(np.zeros(0), 0.0).any()


def test_the_first_principal_component_is_the_leading_eigenvector():
    rng = np.random.default_rng(3)
    points = rng.normal(size=(300, 2)) @ np.array([[9.0, 6.0], [0.0, 1.0]]) + np.array([40.0, -7.0])
    component = first_principal_component(points)
    size, axes = np.linalg.eigh(np.cov(points.T))
    assert abs(component.direction @ axes[:, 1]) == pytest.approx(1.0)
    assert component.share == pytest.approx(size[1] / size.sum())
    assert component.direction[0] > 0
    aside = np.array([-component.direction[1], component.direction[0]])
    np.testing.assert_allclose(component.off(component.center + np.outer([0.0, 2.0, -3.0], aside)), [0.0, 2.0, 3.0])
    with pytest.raises(InputError, match="fewer than two"):
        first_principal_component(points[:1])


def test_channel_range_counts_inliers_only():
    assert channel_range(np.array([5, 80, 31]), np.array([True, False, True])) == (5, 31)


@pytest.mark.parametrize("reverse", [False, True])
def test_every_pass_finds_the_fiber_that_it_drove_by(reverse: bool):
    record, passes, route = a_street(reverse=reverse, noise=0.2)
    for one in passes:
        found = trace(record, one)
        assert found.inliers.mean() > 0.7
        assert not (found.inliers & ~found.consistent).any()
        assert abs(found.line.slope) == pytest.approx(SPACING, rel=0.06)
        assert np.sign(found.line.slope) == (-1 if reverse else 1) == np.sign(found.component.direction[1])
        assert found.component.share > 0.99
        beside = np.interp(
            found.x, *(route[:: -1 if reverse else 1, 0], np.arange(len(route))[:: -1 if reverse else 1])
        )
        assert np.median(np.abs(found.channel - beside)[found.inliers]) < 2.0


def test_the_range_is_nearly_that_of_all_passes_together():
    record, passes, _ = a_street(noise=0.1)
    together = initialize(record, passes).active
    single = np.array([trace(record, one).channels for one in passes])
    assert np.abs(single - together).max() <= 6


def test_channels_count_as_the_record_does():
    record, passes, _ = a_street(noise=0.1)
    shifted = record_of(record.strain_rate, first=500)
    here, there = trace(record, passes[0]), trace(shifted, passes[0])
    assert there.channels == (here.channels[0] + 500, here.channels[1] + 500)
    np.testing.assert_allclose(there.line.x_of(there.channel), here.line.x_of(here.channel))


def test_a_pass_that_is_not_heard_is_named():
    record, passes, _ = a_street(noise=0.1)
    silent = record_of(np.random.default_rng(0).normal(size=record.strain_rate.shape))
    with pytest.raises(InputError, match="pass 0: "):
        trace(silent, passes[0], threshold_db=20.0)
    with pytest.raises(InputError, match="pass 0: "):
        trace(silent, passes[0])
