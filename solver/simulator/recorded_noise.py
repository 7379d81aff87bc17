"""Noise of an interrogator, and faults of a record."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from solver.simulator.effects import effect_rng
from solver.simulator.scenario import Scenario

Array = NDArray[np.float64]


class Color(NamedTuple):
    """What kind of noise an interrogator has.

    Attributes
    ----------
    pink_share : of each channel's variance that is 1/f; the rest is a first-order autoregression
    lag_one : that autoregression's correlation from sample to sample
    common_share : of the variance that all channels have in common (the laser)
    common_pink_share : of that variance that is 1/f
    channel_spread : sd of the log of the channels' sd
    """

    pink_share: float = 0.15
    lag_one: float = 0.05
    common_share: float = 0.1
    common_pink_share: float = 0.15
    channel_spread: float = 0.2


DRIFT = 30.0  # s, correlation time of a level that drifts
WHITE = Color(0.0, 0.0, 0.0, 0.0, 0.0)


def color(scenario: Scenario) -> Color:
    """Kind of noise of a scenario; for `street` it is drawn at random.

    >>> color(Scenario(noise="white")).common_share
    0.0
    """
    if scenario.noise == "white":
        return WHITE
    if scenario.noise == "colored":
        return Color()
    rng = effect_rng(scenario.seed, "noise")
    return Color(
        pink_share=float(rng.uniform(0.05, 0.35)),
        lag_one=float(rng.uniform(0.0, 0.2)),
        common_share=float(rng.uniform(0.0, 0.2)),
        common_pink_share=float(rng.uniform(0.0, 0.3)),
        channel_spread=float(rng.uniform(0.1, 0.3)),
    )


def noise(rng: np.random.Generator, shape: tuple[int, int], kind: Color) -> Array:
    """Noise [time, channel] of mean variance 1: colored in time, partly common, unequal among channels.

    >>> import numpy as np
    >>> bool(0.9 < noise(np.random.default_rng(0), (1000, 50), Color()).var() < 1.1)
    True
    """
    rows, channels = shape
    spread = np.exp(kind.channel_spread * rng.normal(size=channels))
    spread /= np.sqrt((spread**2).mean())
    own = _colored(rng, rows, channels, kind.pink_share, kind.lag_one)
    common = _colored(rng, rows, 1, kind.common_pink_share, kind.lag_one)
    return np.sqrt(1 - kind.common_share) * spread * own + np.sqrt(kind.common_share) * common


def _colored(rng: np.random.Generator, rows: int, columns: int, pink_share: float, lag_one: float) -> Array:
    """White noise shaped to a sum of an AR(1) and a 1/f spectrum, unit expected variance."""
    size = 2 * rows  # so that the periodic end does not join the beginning
    frequency = np.fft.rfftfreq(size)
    autoregressive = 1.0 / np.abs(1.0 - lag_one * np.exp(-2j * np.pi * frequency)) ** 2
    pink = 1.0 / np.maximum(frequency, frequency[1])
    power = (1 - pink_share) * autoregressive / autoregressive.mean() + pink_share * pink / pink.mean()
    white = np.fft.rfft(rng.normal(size=(size, columns)), axis=0)
    return np.fft.irfft(white * np.sqrt(power)[:, None], size, axis=0)[:rows]


def unsteady(scenario: Scenario, recorded: Array) -> Array:
    """Noise [time, channel] whose level drifts and whose single samples have heavy tails, as the scenario says.

    >>> import numpy as np
    >>> steady = np.random.default_rng(0).normal(size=(4000, 40))
    >>> heavy = unsteady(Scenario(noise_freedom=3.0), steady)
    >>> bool(np.abs(heavy).max() > 2 * np.abs(steady).max()), bool(np.median(np.abs(heavy)) < 0.55)
    (True, True)
    """
    if freedom := scenario.noise_freedom:
        rng = effect_rng(scenario.seed, "noise_freedom")
        recorded = recorded * np.sqrt((freedom - 2) / rng.chisquare(freedom, recorded.shape))
    if scenario.noise_drift:
        rng = effect_rng(scenario.seed, "noise_drift")
        slowness = np.exp(-1 / (DRIFT * scenario.sampling_rate))
        pushes = np.sqrt(1 - slowness**2) * rng.normal(size=len(recorded))
        pushes[0] = rng.normal()
        drift = scenario.noise_drift * _filtered(pushes, slowness)
        recorded = recorded * np.exp(drift - scenario.noise_drift**2)[:, None]
    return recorded


def _filtered(pushes: Array, slowness: float) -> Array:
    from scipy.signal import lfilter

    return np.asarray(lfilter([1.0], [1.0, -slowness], pushes))


def damage(scenario: Scenario, recorded: Array, noise_sd: float) -> Array:
    """Put faded channels, spikes, gaps and rounding into a record [time, channel], 1/s; NaN in gaps."""
    out = recorded.copy()
    rows, channels = out.shape
    bad = effect_rng(scenario.seed, "bad_channels")
    chosen = bad.choice(channels, scenario.bad_channels, replace=False)
    out[:, chosen] = 20 * noise_sd * bad.normal(size=(rows, len(chosen)))
    rng = effect_rng(scenario.seed, "spikes")
    hit = rng.random(out.shape) < scenario.spikes
    out += hit * rng.choice([-1.0, 1.0], out.shape) * rng.uniform(8, 40, out.shape) * noise_sd
    rng = effect_rng(scenario.seed, "gaps")
    for _ in range(scenario.gaps):
        lost = int(rng.uniform(1, 4) * scenario.sampling_rate)
        start = int(rng.integers(1, max(2, rows - lost - 1)))
        out[start : start + lost] = np.nan
    step = scenario.rounding * noise_sd
    return step * np.rint(out / step) if step else out
