"""Derivative-of-Ricker wavelets: the shape that a moving load leaves across the channels of a gauge-averaging fiber."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

#: The paper's bank, in channels.
SCALES = np.arange(2.0, 20.25, 0.5)
SUPPORT = 5.0  # half length of a wavelet in scales; beyond it less than 1e-3 of the peak is left


def derivative_of_ricker(u: ArrayLike) -> Array:
    """Derivative (u^3 - 3 u) exp(-u^2 / 2) of the Ricker wavelet (1 - u^2) exp(-u^2 / 2).

    Its two main lobes are 1.484 apart.

    >>> derivative_of_ricker([-0.742, 0.0, 0.742]).round(3).tolist()
    [1.38, 0.0, -1.38]
    """
    u = np.asarray(u, float)
    return (u**3 - 3 * u) * np.exp(-(u**2) / 2)


def wavelet(scale: float, half: int | None = None) -> Array:
    """Zero-mean, unit-energy wavelet of a scale in samples, [2 half + 1]; `half` is five scales if not given.

    >>> w = wavelet(6.5)
    >>> bool(abs(w.sum()) < 1e-12), float(w @ w).__round__(12)
    (True, 1.0)
    """
    half = int(np.ceil(SUPPORT * scale)) if half is None else half
    shape = derivative_of_ricker(np.arange(-half, half + 1) / scale)
    shape -= shape.mean()
    return shape / np.linalg.norm(shape)


def bank(scales: Sequence[float] | Array) -> Array:
    """Wavelets of all scales on one support, [sample, scale].

    >>> bank(SCALES).shape
    (201, 37)
    """
    half = int(np.ceil(SUPPORT * max(scales)))
    return np.stack([wavelet(scale, half) for scale in scales], axis=1)


def wide_bank(gauge_length: float, farthest: float) -> tuple[Array, Array, Array]:
    """Bank for the response of any straight fiber up to `farthest`, m, beside the vehicle.

    Parameters
    ----------
    gauge_length : m

    Returns
    -------
    scales : [scale], m
    along : places [sample], m, from the vehicle; a twentieth of a gauge apart
    wavelets : [sample, scale]

    >>> scales, along, wavelets = wide_bank(10.0, 20.0)
    >>> scales[[0, -1]].tolist(), along[[0, -1]].tolist(), wavelets.shape
    ([1.5, 19.0], [-95.0, 95.0], (381, 100))
    """
    step = gauge_length / 20
    scales = np.linspace(3 * step, 0.3 * gauge_length + 0.8 * farthest, 100)
    wavelets = bank(scales / step)
    half = len(wavelets) // 2
    return scales, step * np.arange(-half, half + 1, dtype=float), wavelets


def parabola(left: Array, middle: Array, right: Array) -> Array:
    """Place of the peak of the parabola through three equidistant values, in steps from the middle, -0.5 to 0.5.

    >>> parabola(np.array([0.0]), np.array([3.0]), np.array([2.0])).tolist()
    [0.25]
    """
    bend = 2 * middle - left - right
    peak = np.divide(right - left, 2 * bend, out=np.zeros_like(middle), where=bend > 0)
    return np.clip(peak, -0.5, 0.5)


def best_scale(response: Array, scales: Array) -> Array:
    """Scale [...] of the largest response [..., scale], between the equidistant `scales` by a parabola.

    >>> scales = np.arange(2.0, 10.0, 0.5)
    >>> best_scale(-((scales - 6.1) ** 2), scales).round(6)
    np.float64(6.1)
    """
    peak = np.clip(response.argmax(-1), 1, len(scales) - 2)[..., None]
    left, middle, right = (np.take_along_axis(response, peak + step, -1)[..., 0] for step in (-1, 0, 1))
    return scales[peak[..., 0]] + (scales[1] - scales[0]) * parabola(left, middle, right)
