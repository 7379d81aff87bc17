"""The law of a record's noise, in time and across channels."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class NoiseLaw:
    """Noise of a record.

    Parameters
    ----------
    own : [lag], autocovariance in time of each channel's own noise, in units of its level squared
    common : [lag], that of the common mode
    across : [lag], correlation of the own noise between channels, 1 at lag 0
    hidden : [lag], autocovariance in time, part of `own`, of the rounding errors that occur only near vehicles: noise
        below a step is rounded to zero
    """

    own: Array
    common: Array
    across: Array
    hidden: Array = field(default_factory=lambda: np.array([0.0]))

    @classmethod
    def white(cls) -> "NoiseLaw":
        """White noise, independent in time and between channels."""
        return cls(np.array([1.0]), np.array([0.0]), np.array([1.0]))

    @property
    def common_share(self) -> float:
        """Share of the variance that all channels have in common."""
        return float(self.common[0] / (self.own[0] + self.common[0]))
