"""Processing of a record before the user receives it."""

import numpy as np
from numpy.typing import NDArray

from solver.simulator.effects import effect_rng
from solver.simulator.outside import handled
from solver.simulator.scenario import Scenario

Array = NDArray[np.float64]


def processed(scenario: Scenario, record: Array, noise_sd: float) -> Array:
    """Add laser noise to a record [time, channel], 1/s, remove the common mode, and filter."""
    if amount := scenario.effect("laser_noise"):
        laser = effect_rng(scenario.seed, "laser_noise").normal(size=(len(record), 1))
        record = record + amount * noise_sd * laser
    if share := scenario.effect("common_mode"):
        record = record - share * record.mean(axis=1, keepdims=True)
    if scenario.effect("fk_filter"):
        record = fan(
            record,
            scenario.sampling_rate,
            scenario.channel_spacing,
            (scenario.effect("fk_filter_slowest"), scenario.effect("fk_filter_fastest")),
            scenario.effect("fk_filter_frequency"),
        )
    if scenario.effect("median_filter"):
        from scipy.ndimage import median_filter

        window = (scenario.effect("median_filter_samples"), scenario.effect("median_filter_channels"))
        record = median_filter(record, size=tuple(map(round, window)), mode="nearest")
    return handled(scenario, record)


def fan(record: Array, sampling_rate: float, spacing: float, speeds: tuple[float, float], highest: float) -> Array:
    """Fan filter: keep motion along the fiber at `speeds` (low, high), m/s, below `highest`, Hz, fading over a fifth.

    >>> import numpy as np
    >>> t, s = np.arange(200)[:, None] / 5.0, np.arange(100.0)
    >>> wave = [np.sin(2 * np.pi * (0.4 * t - s * 0.4 / v)) for v in (16.0, 400.0)]
    >>> [bool(np.abs(fan(w, 5.0, 1.0, (3, 60), 1.0)[50:150, 30:70]).max() > 0.8) for w in wave]
    [True, False]
    """
    rows, channels = record.shape
    padded = np.pad(record, ((rows // 4, rows // 4), (channels // 4, channels // 4)), mode="edge")
    frequency = np.fft.fftfreq(padded.shape[0], 1 / sampling_rate)[:, None]
    wavenumber = np.fft.fftfreq(padded.shape[1], spacing)[None, :]
    with np.errstate(divide="ignore", invalid="ignore"):
        speed = np.nan_to_num(np.abs(frequency / wavenumber), nan=0.0, posinf=np.inf)
    keep = (
        _fade(speed, speeds[0] / 1.2, speeds[0])
        * (1 - _fade(speed, speeds[1], 1.2 * speeds[1]))
        * (1 - _fade(np.abs(frequency), highest, 1.2 * highest))
    )
    out = np.fft.ifft2(np.fft.fft2(padded) * keep).real
    return np.asarray(out[rows // 4 : rows // 4 + rows, channels // 4 : channels // 4 + channels])


def _fade(value: Array, low: float, high: float) -> Array:
    """0 below `low`, 1 above `high`, a cosine between."""
    return 0.5 - 0.5 * np.cos(np.pi * np.clip((value - low) / (high - low), 0.0, 1.0))
