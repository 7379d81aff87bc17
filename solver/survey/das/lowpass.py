"""Anti-alias filter and decimation of a record as one matrix product."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Records are fitted at this rate or a little above, Hz. The signal of a wheel 2 m away at 20 m/s falls with frequency
#: as exp(-2 pi f 2 / 20): to 0.7 % at 8 Hz, up to which the filter passes. At 12 Hz, with 4 % lost, routes were 0.3 m
#: off.
FIT_RATE = 20.0
#: Length of the anti-alias filter, output samples to either side; its pass band is flat to 0.8 of the new Nyquist rate.
HALF_LENGTH = 10
#: Output samples of one product: more would multiply more zeros, fewer would read more samples twice.
TOGETHER = 16


def factor_of(sampling_rate: float, rate: float = FIT_RATE) -> int:
    """Decimation factor to the lowest whole fraction of the sampling rate that is not below `rate`.

    >>> factor_of(500.0), factor_of(39.0)
    (25, 1)
    """
    return max(1, int(sampling_rate // rate))


def taps_of(factor: int) -> Array:
    """Taps of the low pass before every `factor`-th sample is kept: windowed sinc (Kaiser window, beta 5).

    Oppenheim and Schafer 2010, section 7.6.

    >>> len(taps_of(25)), round(float(taps_of(25).sum()), 12), taps_of(1).tolist()
    (501, 1.0, [1.0])
    """
    if factor == 1:
        return np.ones(1)
    from scipy.signal import firwin

    return np.asarray(firwin(2 * HALF_LENGTH * factor + 1, 0.9 / factor, window=("kaiser", 5.0)))


@dataclass(frozen=True)
class Lowpass:
    """A filter in time with an odd number of taps, after which every `factor`-th sample is kept.

    Parameters
    ----------
    taps : [tap], convolution weights
    factor : of decimation
    dtype : of the computation

    >>> values = np.random.default_rng(0).normal(size=(400, 3))
    >>> low = Lowpass(taps_of(5), 5)
    >>> one = np.convolve(values[:, 1], low.taps, "valid")[::5]
    >>> bool(np.allclose(low(values, 0, len(one))[:, 1], one, atol=1e-12))
    True
    """

    taps: Array
    factor: int
    dtype: Any = np.float64

    @property
    def half(self) -> int:
        """Samples to either side."""
        return len(self.taps) // 2

    @cached_property
    def product(self) -> NDArray[Any]:
        """Matrix [output, input] of `TOGETHER` output samples."""
        found = np.zeros((TOGETHER, (TOGETHER - 1) * self.factor + len(self.taps)), self.dtype)
        for row in range(TOGETHER):
            found[row, row * self.factor : row * self.factor + len(self.taps)] = self.taps[::-1]
        return found

    def __call__(self, values: NDArray[Any], first: int, count: int) -> NDArray[Any]:
        """Output samples [count, channel] of values [time, channel]; the first one's filter begins at row `first`."""
        out = np.empty((count, values.shape[1]), self.dtype)
        for done in range(0, count, TOGETHER):
            some = min(TOGETHER, count - done)
            begin, width = first + done * self.factor, (some - 1) * self.factor + len(self.taps)
            np.matmul(self.product[:some, :width], values[begin : begin + width], out=out[done : done + some])
        return out
