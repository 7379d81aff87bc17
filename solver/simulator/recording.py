"""What the interrogator adds: sampling, its high pass, its noise."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def low_pass_decimate(rate: Array, factor: int) -> Array:
    """Low-pass [time, channel] without delay at 0.8 of the new Nyquist frequency; keep every `factor`-th row.

    Hamming-windowed sinc, 10 output intervals long on either side; beyond the ends the map is taken as 0.

    >>> import numpy as np
    >>> low_pass_decimate(np.ones((200, 1)), 5).shape
    (40, 1)
    """
    half = 10 * factor
    lag = np.arange(-half, half + 1)
    taps = np.sinc(0.8 * lag / factor) * np.hamming(2 * half + 1)
    taps /= taps.sum()
    size = len(rate) + 2 * half
    spectrum = np.fft.rfft(rate, size, axis=0) * np.fft.rfft(taps, size)[:, None]
    return np.fft.irfft(spectrum, size, axis=0)[half : half + len(rate) : factor]


def high_pass(rate: Array, corner: float, sampling_rate: float) -> Array:
    """First-order high pass of a map [time, channel], corner in Hz, causal (bilinear transform).

    >>> import numpy as np
    >>> step = high_pass(np.ones((400, 1)), 0.1, 5.0)
    >>> bool(step[0, 0] > 0.9) and bool(abs(step[-1, 0]) < 1e-6)
    True
    """
    warped = np.tan(np.pi * corner / sampling_rate)
    gain, pole = 1.0 / (1.0 + warped), (1.0 - warped) / (1.0 + warped)
    out = np.empty_like(rate)
    before, last = np.zeros(rate.shape[1]), np.zeros(rate.shape[1])
    for row, now in enumerate(rate):
        last = out[row] = gain * (now - before) + pole * last
        before = now
    return out


def noise(
    rng: np.random.Generator,
    shape: tuple[int, int],
    *,
    pink_share: float = 0.15,
    lag_one: float = 0.05,
    common_share: float = 0.1,
    channel_spread: float = 0.2,
) -> Array:
    """Noise [time, channel] of mean variance 1: colored in time, partly common, unequal among channels.

    Parameters
    ----------
    pink_share : of each channel's variance that is 1/f; the rest is a first-order autoregression
    lag_one : that autoregression's correlation from sample to sample
    common_share : of the variance that all channels have in common (the laser)
    channel_spread : sd of the log of the channels' sd

    >>> import numpy as np
    >>> bool(0.9 < noise(np.random.default_rng(0), (1000, 50)).var() < 1.1)
    True
    """
    rows, channels = shape
    spread = np.exp(channel_spread * rng.normal(size=channels))
    spread /= np.sqrt((spread**2).mean())
    own = _colored(rng, rows, channels, pink_share, lag_one)
    common = _colored(rng, rows, 1, pink_share, lag_one)
    return np.sqrt(1 - common_share) * spread * own + np.sqrt(common_share) * common


def _colored(rng: np.random.Generator, rows: int, columns: int, pink_share: float, lag_one: float) -> Array:
    """White noise shaped to a sum of an AR(1) and a 1/f spectrum, unit expected variance."""
    size = 2 * rows  # so that the end does not meet the beginning
    frequency = np.fft.rfftfreq(size)
    autoregressive = 1.0 / np.abs(1.0 - lag_one * np.exp(-2j * np.pi * frequency)) ** 2
    pink = 1.0 / np.maximum(frequency, frequency[1])
    power = (1 - pink_share) * autoregressive / autoregressive.mean() + pink_share * pink / pink.mean()
    white = np.fft.rfft(rng.normal(size=(size, columns)), axis=0)
    return np.fft.irfft(white * np.sqrt(power)[:, None], size, axis=0)[:rows]
