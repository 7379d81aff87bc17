"""What the FK filter passes, stops and leaves alone."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from solver.processing import fk_filter, fk_filtered, fk_mask
from solver.survey.das import DASRecord
from vision.contract import InputError

DT, DX = 0.2, 1.0
TIME, PLACE = np.arange(400) * DT, np.arange(160) * DX
INNER = (slice(120, 280), slice(40, 120))


def wave(speed: float, frequency: float) -> np.ndarray:
    """A plane wave [time, channel] of an apparent speed, m/s, and frequency, Hz."""
    return np.sin(2 * np.pi * frequency * (TIME[:, None] - PLACE / speed))


def record(strain_rate: np.ndarray) -> DASRecord:
    channel = np.arange(strain_rate.shape[1])
    time = np.arange(len(strain_rate)) * DT
    return DASRecord(strain_rate, time, np.datetime64(0, "ns"), channel * DX, channel, 10.0, DX, 1 / DT, (), {})


def passed_share(strain_rate: np.ndarray) -> float:
    filtered = fk_filtered(record(strain_rate)).strain_rate
    return float(filtered[INNER].std() / strain_rate[INNER].std())


@pytest.mark.parametrize(("speed", "frequency"), [(8.0, 0.4), (-8.0, 0.4), (15.0, 0.6), (4.0, 0.3), (-20.0, 0.7)])
def test_waves_of_vehicle_speed_pass_either_way(speed: float, frequency: float):
    assert passed_share(wave(speed, frequency)) == pytest.approx(1.0, abs=0.06)


@pytest.mark.parametrize(
    ("speed", "frequency"), [(200.0, 0.5), (1e9, 0.5), (1.2, 0.2), (-1.2, 0.2), (12.0, 1.5), (-12.0, 2.0)]
)
def test_waves_too_fast_too_slow_or_above_a_hertz_are_stopped(speed: float, frequency: float):
    assert passed_share(wave(speed, frequency)) < 0.12


def test_sharp_edges_are_those_of_the_paper():
    mask = fk_mask((1000, 500), DT, DX, taper=0.0).numpy()
    f = np.abs(np.fft.fftfreq(1000, DT))[:, None]
    k = np.fft.rfftfreq(500, DX)[None, :]
    expected = (f >= 2.5 * k) & (f <= 25.0 * k) & (f <= 1.0)
    expected[0, 0] = False
    differs = mask.astype(bool) != expected
    on_the_edge = np.isclose(f, 2.5 * k) | np.isclose(f, 25 * k) | np.isclose(f, 1.0)
    assert not (differs & ~on_the_edge).any()
    assert set(np.unique(mask)) == {0.0, 1.0}


def test_a_vehicle_comes_out_of_laser_noise():
    rng = np.random.default_rng(0)
    ahead = PLACE - 9.0 * (TIME[:, None] - 30)
    vehicle = -ahead * np.exp(-((ahead / 9) ** 2))
    noise = 3 * rng.normal(size=(len(TIME), 1)) + rng.normal(size=vehicle.shape)
    filtered = fk_filtered(record(vehicle + noise)).strain_rate
    clean = fk_filtered(record(vehicle)).strain_rate
    before = np.corrcoef((vehicle + noise)[INNER].ravel(), vehicle[INNER].ravel())[0, 1]
    after = np.corrcoef(filtered[INNER].ravel(), clean[INNER].ravel())[0, 1]
    assert before < 0.6
    assert after > 0.9


def test_gaps_and_dead_channels_stay_and_do_not_leak():
    whole = wave(8.0, 0.4)
    broken = whole.copy()
    broken[200:215] = np.nan
    broken[:, [33, 90]] = np.nan
    before = fk_filtered(record(broken)).strain_rate
    assert (np.isnan(before) == np.isnan(broken)).all()
    # What comes after the gap has nothing to say about what came before it.
    louder = broken.copy()
    louder[215:] *= 1000
    np.testing.assert_array_equal(fk_filtered(record(louder)).strain_rate[:200], before[:200])
    assert np.nanmax(np.abs(before[60:140, 30:130] - whole[60:140, 30:130])) < 0.25


def test_the_model_is_filtered_as_the_record_is():
    strain_rate = np.random.default_rng(1).normal(size=(90, 40))
    of_record = fk_filtered(record(strain_rate), speeds=(3.0, 20.0), highest=0.8).strain_rate
    of_model = fk_filter(torch.from_numpy(strain_rate), DT, DX, speeds=(3.0, 20.0), highest=0.8)
    np.testing.assert_array_equal(of_record, of_model.numpy())


def test_the_filter_is_linear_and_its_gradient_is_its_transpose():
    generator = torch.Generator().manual_seed(0)
    one, other = torch.randn(2, 30, 20, dtype=torch.float64, generator=generator)
    torch.testing.assert_close(
        fk_filter(2 * one - other, DT, DX), 2 * fk_filter(one, DT, DX) - fk_filter(other, DT, DX)
    )
    both = fk_filter(torch.stack([one, other]), DT, DX)
    torch.testing.assert_close(both, torch.stack([fk_filter(one, DT, DX), fk_filter(other, DT, DX)]))
    one.requires_grad_()
    (gradient,) = torch.autograd.grad((fk_filter(one, DT, DX) * other).sum(), one)
    # A real and even mask makes a symmetric operator.
    torch.testing.assert_close(gradient, fk_filter(other, DT, DX))


def test_what_was_done_is_noted():
    done = fk_filtered(replace(record(np.ones((20, 5))), provenance={"format": "x"})).provenance
    assert done == {"format": "x", "fk_filtered": "2.5 to 25 m/s, below 1 Hz"}


@pytest.mark.parametrize("wrong", [{"speeds": (5.0, 2.0)}, {"highest": 0.0}, {"taper": 1.0}, {"speeds": (0.0, 2.0)}])
def test_impossible_bands_are_refused(wrong: dict):
    with pytest.raises(InputError, match="FK filter"):
        fk_filtered(record(np.ones((20, 5))), **wrong)
