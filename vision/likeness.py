"""Likelihood ratios of appearance similarities, learned from the vehicles in view, as embeddings differ in scale."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STRONGEST = 4.0  # largest logarithm of a ratio: appearance changes in shade and behind leaves
NARROWEST = 0.02  # sd


@dataclass(frozen=True)
class Cosines:
    """Mean and spread of some cosines: their count, sum and sum of squares."""

    count: float
    total: float
    squares: float

    @classmethod
    def of(cls, mean: float, sd: float, count: float) -> "Cosines":
        """Prior statistics, worth `count` cosines."""
        return cls(count, count * mean, count * (mean**2 + sd**2))

    def and_also(self, seen: Array) -> "Cosines":
        """The statistics updated with the cosines `seen` [n]."""
        return Cosines(self.count + len(seen), self.total + float(seen.sum()), self.squares + float((seen**2).sum()))

    def log_density(self, value: Array) -> Array:
        """Logarithm of the normal density of values [...], up to a constant."""
        mean = self.total / self.count
        sd = max(np.sqrt(max(self.squares / self.count - mean**2, 0.0)), NARROWEST)
        return np.asarray(-(((value - mean) / sd) ** 2) / 2 - np.log(sd))


# Typical of networks for re-identification; a dozen pairs outweigh them.
USUAL_SAME, USUAL_OTHER = Cosines.of(0.9, 0.1, 10.0), Cosines.of(0.3, 0.3, 10.0)


@dataclass(frozen=True)
class Likeness:
    """Cosines between appearance vectors of a track and a detection: of one vehicle, and of two seen at the same time.

    Two gray cars have a cosine of 0.98 by a color histogram, and of 0.4 by a network for re-identification: what tells
    vehicles apart is how much likelier a cosine is for one vehicle than for two (Neyman & Pearson 1933).

    >>> likeness = Likeness()
    >>> for _ in range(50):
    ...     likeness = likeness.learned(np.array([[0.98, 0.9], [0.86, 0.99]]))
    >>> likeness.ratio(np.array([0.85, 0.9, 0.98])).round(1).tolist()
    [-3.7, -0.3, 1.9]
    """

    same: Cosines = USUAL_SAME
    other: Cosines = USUAL_OTHER

    def ratio(self, cosine: Array) -> Array:
        """Logarithm of how much likelier cosines [...] are for one vehicle than for two, within ±4."""
        highest = self.same.total / self.same.count  # more similar than usual is no evidence against the same vehicle
        held = np.minimum(cosine, highest)
        return np.clip(self.same.log_density(held) - self.other.log_density(held), -STRONGEST, STRONGEST)

    def learned(self, cosines: Array) -> "Likeness":
        """With cosines [pair, pair] of the pairs of one frame, tracks down and their detections across."""
        apart = cosines[~np.eye(len(cosines), dtype=bool)]
        return Likeness(self.same.and_also(np.diagonal(cosines)), self.other.and_also(apart))
