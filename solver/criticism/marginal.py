"""Marginal likelihoods from a score test's linear algebra: of an effect of plausible size, and of an inexact law.

With r the whitened residual, X' what the fit leaves of an effect's columns in units of plausible sizes, U = X'r and
I = X'X', r ~ N(0, t + X'X'^T) has the ln of the Bayes factor U' (t + I)^-1 U / (2 t) - ln|1 + I / t| / 2 against
r ~ N(0, t): in I's eigenvectors a sum over directions. t is the variance that the noise counts as, since the base model
is not exact.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from torch import Tensor, linalg

from solver.criticism.policy import POLICY

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Spectrum:
    """What the fit leaves of an effect, direction by direction.

    Parameters
    ----------
    information : [direction], squared signal of a plausible size, in noise variances
    along : [direction], squared product of that signal with the residual
    alike : the same of numbers that are alike, as neighbors are; None where none need be
    """

    information: Array
    along: Array
    alike: "Spectrum | None" = None

    @classmethod
    def of(cls, information: Tensor, score: Tensor, size: Tensor, alike: Tensor | None = None) -> "Spectrum":
        """From information [number, number], score [number] and plausible sizes [number] of an effect's numbers.

        `alike` is a root [number, process] of the correlation of numbers, see `solver.criticism.fields`.

        >>> import torch
        >>> one = Spectrum.of(torch.tensor([[4.0]]), torch.tensor([6.0]), torch.tensor([0.5]))
        >>> float(one.information[0]), float(one.along[0])
        (1.0, 9.0)
        """
        return cls.of_plausible(information * size[:, None] * size, size * score, alike)

    @classmethod
    def of_plausible(cls, information: Tensor, score: Tensor, alike: Tensor | None = None) -> "Spectrum":
        """The same of numbers in plausible sizes."""
        values, vectors = linalg.eigh(information)
        together = None if alike is None else cls.of_plausible(alike.T @ information @ alike, alike.T @ score)
        return cls(values.clamp_min(0).numpy(), (vectors.T @ score).square().numpy(), together)

    @property
    def occam(self) -> float:
        """Ln of how many sizes a plausible one is told from."""
        return self.told(1.0)

    def told(self, variance: float) -> float:
        """The same where the noise has another variance."""
        return float(np.log1p(self.information / variance).sum() / 2)

    def evidence(self, variance: float) -> float:
        """Ln of the Bayes factor of the effect, at a noise variance; of many numbers, over how small they all may be.

        >>> two = Spectrum(np.array([99.0, 0.0]), np.array([99.0 * 20, 0.0]))
        >>> round(two.evidence(1.0), 3), round(float(20 * 0.99 / 2 - np.log(100) / 2), 3)
        (7.597, 7.597)
        """
        return self.scaled(variance, 1.0) + self.smaller(variance)

    def scaled(self, variance: float, scale: float) -> float:
        """The same of numbers that are so many times as large as is plausible, at one scale."""
        information, along = scale**2 * self.information, scale**2 * self.along
        gain = along / (variance * (variance + information)) - np.log1p(information / variance)
        return float(gain.sum() / 2)

    def smaller(self, variance: float) -> float:
        """What that ln gains where all of many numbers may be smaller: half way, in logs, to negligible, as probably.

        A field along the fiber of half its plausible size would pay for the whole of it in each of its numbers. As
        probable is one whose neighbors are alike: it would pay for changes over meters that it does not have.

        >>> alike, one = (Spectrum(np.full(n, 99.0), np.full(n, 99.0 * 5)) for n in (8, 1))
        >>> round(alike.smaller(1.0), 2), one.smaller(1.0)
        (6.54, 0.0)
        """
        if np.count_nonzero(self.information) < 2:
            return 0.0
        fields = [self] if self.alike is None else [self, self.alike]
        logs = [one.scaled(variance, scale) for one in fields for scale in (1.0, POLICY.negligible**0.5)]
        return mixture(logs) - logs[0]

    def falls(self) -> Array:
        """Fall of chi2 [direction], of those that leave a trace."""
        seen = self.information > 1e-9 * max(self.information.max(initial=0.0), 1e-300)
        return self.along[seen] / self.information[seen]

    def tolerated(self, variance: float, off: float) -> float:
        """Ln of the Bayes factor for a discrepancy of variance `off`, squared sigmas, in each direction.

        >>> left = Spectrum(np.array([1.0, 1.0]), np.array([30.0, 2.0]))
        >>> round(left.tolerated(1.0, 30.0), 3), left.tolerated(1.0, 0.0)
        (12.05, 0.0)
        """
        falls, share = self.falls() / variance, off / variance
        return float((falls * share / (1 + share)).sum() / 2 - len(falls) * np.log1p(share) / 2)


def mixture(logs: Sequence[float]) -> float:
    """Ln of the mean of some Bayes factors.

    >>> round(mixture([0.0, 0.0]), 6), round(mixture([10.0, 0.0]), 3)
    (0.0, 9.307)
    """
    return float(np.logaddexp.reduce(logs) - np.log(len(logs))) if len(logs) else 0.0


def fault_evidence(fall: float, numbers: int, trials: int) -> float:
    """Ln of the Bayes factor of a fault that lowers chi2 so much by so many numbers, found at the best of some places.

    The numbers' prior is as wide as they are large (George and Foster 2000, Biometrika 87, 731).

    >>> round(fault_evidence(60.0, 2, 10), 2), fault_evidence(1.0, 2, 1)
    (23.3, 0.0)
    """
    width = max(fall / numbers, 1.0)
    return float((fall - fall / width) / 2 - numbers / 2 * np.log(width) - np.log(trials))
