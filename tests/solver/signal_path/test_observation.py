"""Filters of whole maps against other ways to compute them: differential equations, scipy, direct convolution."""

import numpy as np
import pytest
import torch
from scipy.integrate import solve_ivp
from scipy.signal import bilinear, butter, lfilter, lsim

from solver.cable.cable import Cable
from solver.interrogator.interrogator import Interrogator
from solver.processing.processing import Processing
from solver.signal_path.observation import BASE, Description, bridged, fiber_matrix, laplace_filtered

RATE = 20.0
TIME = np.arange(600) / RATE


def bump(time: np.ndarray, at: float = 8.0, width: float = 0.8) -> np.ndarray:
    return np.exp(-(((time - at) / width) ** 2))


def filtered(values: np.ndarray, *transfers) -> np.ndarray:
    return laplace_filtered(torch.from_numpy(values)[:, None], transfers, RATE)[:, 0].numpy()


def test_a_high_pass_is_the_rc_circuit():
    corner = 2 * np.pi * 0.1
    circuit = solve_ivp(
        lambda t, y: -corner * (y + bump(t)), (0, TIME[-1]), [0.0], t_eval=TIME, rtol=1e-9, atol=1e-11, max_step=0.1
    )
    exact = bump(TIME) + circuit.y[0]
    np.testing.assert_allclose(filtered(bump(TIME), lambda s: s / (s + corner)), exact, atol=1e-3)


def test_creep_is_the_standard_linear_solid():
    creep, tau = 0.4, 1.5
    delayed = solve_ivp(
        lambda t, y: (creep * bump(t) - y) / tau, (0, TIME[-1]), [0.0], t_eval=TIME, rtol=1e-9, atol=1e-11, max_step=0.1
    )
    exact = bump(TIME) + delayed.y[0]
    np.testing.assert_allclose(filtered(bump(TIME), lambda s: 1 + creep / (1 + s * tau)), exact, atol=1e-3)


def test_an_integrator_does_not_wrap_around():
    total = filtered(bump(TIME), lambda s: 1 / s)
    np.testing.assert_allclose(total[-100:], 0.8 * np.sqrt(np.pi), rtol=2e-3)
    assert np.abs(total[:100]).max() < 2e-3


def test_a_delay_delays():
    np.testing.assert_allclose(filtered(bump(TIME), lambda s: torch.exp(-2 * s)), bump(TIME - 2), atol=1e-6)


def test_a_butterworth_low_pass_is_scipy_s():
    corner = 1.2
    numerator, denominator = butter(4, 2 * np.pi * corner, analog=True)
    exact = lsim((numerator, denominator), bump(TIME), TIME)[1]

    def transfer(s):
        x = s / (2 * np.pi * corner)
        return 1 / ((x**2 + 0.765367 * x + 1) * (x**2 + 1.847759 * x + 1))

    np.testing.assert_allclose(filtered(bump(TIME), transfer), exact, atol=2e-3)
    digital = lfilter(*bilinear(numerator, denominator, RATE), bump(TIME))
    np.testing.assert_allclose(filtered(bump(TIME), transfer), digital, atol=2e-2)


def test_filters_follow_one_another():
    def first(s):
        return 1 / (1 + s)

    def second(s):
        return s / (s + 1)

    np.testing.assert_allclose(
        filtered(bump(TIME), first, second), filtered(filtered(bump(TIME), second), first), atol=1e-3
    )


@pytest.mark.parametrize("length", [0.7, 2.0])
def test_a_fiber_filter_is_convolution(length):
    """1 / (1 + k^2 L^2) is convolution with exp(-|s| / L) / (2 L), mirrored at both ends."""
    spacing, channels = 0.1, 200
    s = spacing * np.arange(channels)
    values = np.exp(-(((s - 9) / 2.0) ** 2)) + 0.3 * np.exp(-(((s - 1.0) / 1.5) ** 2))
    matrix = fiber_matrix([lambda k: 1 / (1 + k**2 * length**2)], channels, spacing).numpy()
    mirrored = np.concatenate([values[::-1], values, values[::-1]])
    lag = spacing * np.arange(-channels, channels + 1)
    kernel = np.exp(-np.abs(lag) / length) / (2 * length) * spacing
    # The kernel's tip is averaged over its channel.
    kernel[channels] = 1 - np.exp(-spacing / 2 / length)
    direct = np.convolve(mirrored, kernel / kernel.sum(), "same")[channels : 2 * channels]
    np.testing.assert_allclose(matrix @ values, direct, atol=3e-3)


def test_fiber_filters_multiply_and_keep_the_mean():
    one, two = (lambda k: 1 / (1 + k**2)), (lambda k: torch.exp(-(k**2)))
    together = fiber_matrix([one, two], 30, 1.0)
    torch.testing.assert_close(together, fiber_matrix([one], 30, 1.0) @ fiber_matrix([two], 30, 1.0))
    torch.testing.assert_close(together.sum(1), torch.ones(30, dtype=torch.float64))
    torch.testing.assert_close(together, together.T)


def described(**stages) -> Description:
    return Description(cable=Cable(torch.arange(6, dtype=torch.float64)), sampling_rate=RATE, **stages)


def test_a_map_goes_through_every_step_in_turn():
    steps = (lambda m: m + 1, lambda m: 2 * m)
    plan = described(
        processing=Processing(steps), interrogator=Interrogator(10.0, pointwise=(lambda m: m.clamp(max=3),))
    )
    values = torch.full((5, 6), 4.0, dtype=torch.float64)
    assert torch.equal(plan.observed(values, np.arange(5)), torch.full((5, 6), 8.0, dtype=torch.float64))
    assert plan.nonlinear and not plan.linear.nonlinear and plan.along_fiber and not plan.in_rows


def test_filters_do_not_reach_across_long_gaps():
    """Two passes minutes apart: nothing of the first is left for the second."""
    samples = np.r_[0:100, 2000:2100]
    values = torch.zeros(200, 1, dtype=torch.float64)
    values[50] = 1.0
    plan = described(interrogator=Interrogator(10.0).filtered(lambda s: 1 + 1 / s))
    observed = plan.observed(values, samples)[:, 0]
    assert observed[60:100].min() > 0.01 and observed[100:].abs().max() == 0


def test_filters_remember_across_short_gaps():
    samples = np.r_[0:100, 140:240]
    values = torch.from_numpy(bump(samples / RATE, at=2.0))[:, None]
    tau = 2.0
    plan = described(interrogator=Interrogator(10.0).filtered(lambda s: 1 / (1 + s * tau)))
    observed = plan.observed(values, samples)[:, 0].numpy()
    decay = observed[100] / observed[99]
    assert decay == pytest.approx(np.exp(-41 / RATE / tau), rel=1e-2)
    assert bridged(samples, 41) == [slice(0, 200)] and len(bridged(samples, 40)) == 2


def test_only_measured_channels_are_given():
    chosen = torch.tensor([1, 4])
    values = torch.arange(12, dtype=torch.float64).reshape(2, 6)
    assert torch.equal(described(chosen=chosen).observed(values, np.arange(2)), values[:, chosen])
    assert not BASE.in_rows and not BASE.along_fiber and BASE.in_time == ()
