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
    chi2_per_dof, noise_floor : misfit of the run's fit, and what noise alone would leave of it; None where that is not
        known
    """

    regions: list[Region]
    split: Split
    stack: Stack
    power: Power
    noise: NDArray[np.float64]
    chi2_per_dof: float
    noise_floor: float | None

    @property
    def excess(self) -> float:
        """Misfit above the noise, as a share of the noise; 0 where the noise is not known."""
        return 0.0 if self.noise_floor is None else self.chi2_per_dof / max(self.noise_floor, 1e-300) - 1

    @property
    def level(self) -> float:
        """Mean square of the whitened residual per sample where no vehicle is: what pictures of samples begin at."""
        return self.split.noise / max(self.split.samples, 1)
