"""What a comparison holds."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.criticism.comparison.power import Power
from solver.criticism.comparison.regions import Region
from solver.criticism.comparison.split import Split
from solver.criticism.comparison.stack import Stack


@dataclass(frozen=True)
class Comparison:
    """Model against measurement: where, when and how they differ.

    Parameters
    ----------
    regions : where the model fails, largest first
    split : whose the misfit is
    stack : the residual in the vehicle's frame
    power : of the residual, by everything it may depend on
    noise : [fitted], mean square of the whitened residual where no vehicle is; 1 if the noise was told right
    """

    regions: list[Region]
    split: Split
    stack: Stack
    power: Power
    noise: NDArray[np.float64]

    @property
    def chi2_per_sample(self) -> float:
        """Mean squared residual in noise units."""
        return self.split.chi2 / max(self.split.samples, 1)

    @property
    def noise_floor(self) -> float:
        """The same that noise alone leaves."""
        return self.split.noise / max(self.split.samples, 1)
