"""Decimation keeps what the fit needs, and times."""

from dataclasses import replace

import numpy as np

from solver.survey.das import DASRecord, decimated


def record(rate: float, wave: np.ndarray) -> DASRecord:
    time = np.arange(len(wave)) / rate
    channel = np.arange(wave.shape[1])
    return DASRecord(wave, time, np.datetime64(0, "ns"), channel * 1.0, channel, 10.0, 1.0, rate, (), {})


def pulse(time: np.ndarray) -> np.ndarray:
    """A vehicle-like pulse [time, 1] of 0.3 s."""
    u = (time - 10.03) / 0.3
    return (u * np.exp(-(u**2) / 2))[:, None]


def test_a_slow_record_stays_as_it_is() -> None:
    slow = record(5.0, np.ones((50, 2)))
    assert decimated(slow) is slow


def test_pulses_keep_shape_and_time_and_fast_noise_goes() -> None:
    time = np.arange(20000) / 1000.0
    noise = np.sin(2 * np.pi * 50 * time)[:, None]
    reduced = decimated(record(1000.0, pulse(time) + noise))
    assert 20.0 <= reduced.sampling_rate < 40.0
    np.testing.assert_allclose(reduced.time[1] - reduced.time[0], 1 / reduced.sampling_rate)
    inner = slice(10, -11)
    np.testing.assert_allclose(reduced.strain_rate[inner], pulse(reduced.time[inner]), atol=2e-3)
    assert np.isnan(reduced.strain_rate[[0, -1]]).all()
    assert len(reduced.time) == len(reduced.strain_rate)
    assert "1000 Hz" in reduced.provenance["decimated"]


def test_gaps_stay_gaps_and_nothing_leaks_from_them() -> None:
    time = np.arange(3000) / 100.0
    wave = pulse(time)
    wave[2000:2100] = np.nan
    reduced = decimated(replace(record(100.0, wave), gaps=((20.0, 21.0),)))
    missing = np.isnan(reduced.strain_rate[:, 0])
    assert missing[(reduced.time >= 20.0) & (reduced.time < 21.0)].all()
    assert not missing[(reduced.time > 1.0) & (reduced.time < 19.0)].any()
    assert not missing[(reduced.time > 22.0) & (reduced.time < 29.0)].any()
    np.testing.assert_allclose(reduced.strain_rate[~missing], pulse(reduced.time[~missing]), atol=2e-3)
