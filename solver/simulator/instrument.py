"""Effects in time: how the ground and the instrument respond to the strain under the vehicles.

All are computed at a high rate, before the record is sampled.
"""

import numpy as np
from numpy.typing import NDArray

from solver.simulator.effects import effect_rng
from solver.simulator.scenario import Scenario

Array = NDArray[np.float64]
IN_TIME = (
    "viscoelastic_lag",
    "time_averaging",
    "lowpass",
    "highpass",
    "unknown_softening",
    "unknown_hysteresis",
    "unknown_exhaustion",
    "unknown_channel_delay",
)


def creep(scenario: Scenario, strain: Array, step: float) -> Array:
    """Strain [time, channel] of a viscoelastic ground whose elastic strain is given, every `step` s.

    The model's differential equation is solved exactly for a strain that is linear within a step.

    - standard linear solid: e + q, tau q' = D e - q
    - Kelvin-Voigt: T q' = e - q, alone
    - Maxwell: e + q, q' = R e
    """
    amount = scenario.effect("viscoelastic_lag")
    if not amount:
        return strain
    model = round(scenario.effect("viscoelastic_lag_model"))
    if model == 2:
        flow = np.cumsum((strain[1:] + strain[:-1]) / 2, axis=0) * step
        return strain + amount * np.concatenate([np.zeros((1, strain.shape[1])), flow])
    if model == 1:
        return relaxed(strain, amount / step)
    return strain + amount * relaxed(strain, scenario.effect("viscoelastic_lag_tau") / step)


def relaxed(drive: Array, tau: float) -> Array:
    """Solve tau q' = drive - q exactly for a drive [time, ...] linear within each step; tau in steps.

    >>> import numpy as np
    >>> bool(np.isclose(relaxed(np.ones(10), 3.0)[4], 1 - np.exp(-4 / 3)))
    True
    """
    from scipy.signal import lfilter

    decay = np.exp(-1 / tau)
    mean = tau * (1 - decay)
    # q[n] = decay q[n-1] + (1 - mean) drive[n] + (mean - decay) drive[n-1]; at rest before the first.
    return np.asarray(lfilter([1 - mean, mean - decay], [1, -decay], drive, axis=0, zi=-(1 - mean) * drive[:1])[0])


def rate_of(scenario: Scenario, strain: Array, step: float) -> Array:
    """Strain rate [time, channel] in the middle of every step of a strain [time + 1, channel]."""
    window = scenario.effect("time_averaging") / step
    if not window:
        return np.diff(strain, axis=0) / step
    middle = np.arange(0.5, len(strain) - 1)
    return (_at(strain, middle) - _at(strain, middle - window)) / (window * step)


def _at(strain: Array, row: Array) -> Array:
    """Interpolate linearly between rows; before the first, repeat it."""
    row = np.maximum(row, 0.0)
    low = np.minimum(row.astype(int), len(strain) - 2)
    share = (row - low)[:, None]
    return (1 - share) * strain[low] + share * strain[low + 1]


def filtered(scenario: Scenario, rate: Array, step: float) -> Array:
    """Butterworth filters of the instrument on a strain rate [time, channel], every `step` s."""
    from scipy.signal import butter, sosfilt, sosfiltfilt

    if corner := scenario.effect("lowpass"):
        sos = butter(round(scenario.effect("lowpass_order")), corner, fs=1 / step, output="sos")
        run = sosfiltfilt if scenario.effect("lowpass_zero_phase") else sosfilt
        rate = run(sos, rate, axis=0)
    if corner := scenario.effect("highpass"):
        sos = butter(round(scenario.effect("highpass_order")), corner, "highpass", fs=1 / step, output="sos")
        rate = sosfilt(sos, rate, axis=0)
    return rate


def clipped(scenario: Scenario, rate: Array) -> Array:
    """Apply saturation and cycle skips to a sampled strain rate [time, channel]."""
    largest = np.abs(rate).max()
    if share := scenario.effect("saturation"):
        rate = np.clip(rate, -share * largest, share * largest)
    if chance := scenario.effect("cycle_skips"):
        rng = effect_rng(scenario.seed, "cycle_skips")
        jump = scenario.effect("cycle_skips_size") * largest
        hit = (rng.random(rate.shape) < chance) & (np.abs(rate) > 0.1 * largest)
        rate = rate + jump * hit * rng.choice([-1.0, 1.0], rate.shape)
    return rate
