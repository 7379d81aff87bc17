"""What a likeness of looks is worth: learned from the vehicles in view, as every embedding has its own scale."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STRONGEST = 4.0  # of a ratio's logarithm: looks change in shade and behind leaves
NARROWEST = 0.02  # sd


@dataclass(frozen=True)
class Cosines:
    """Mean and spread of some cosines: their count, sum and sum of squares."""

    count: float
    total: float
    squares: float

    @classmethod
    def of(cls, mean: float, sd: float, count: float) -> "Cosines":
        """As if `count` had been seen."""
        return cls(count, count * mean, count * (mean**2 + sd**2))

    def and_also(self, seen: Array) -> "Cosines":
        """With those of `seen` [n]."""
        return Cosines(self.count + len(seen), self.total + float(seen.sum()), self.squares + float((seen**2).sum()))

    def log_density(self, value: Array) -> Array:
        """Logarithm of the normal density of values [...], up to a constant."""
        mean = self.total / self.count
        sd = max(np.sqrt(max(self.squares / self.count - mean**2, 0.0)), NARROWEST)
        return np.asarray(-(((value - mean) / sd) ** 2) / 2 - np.log(sd))


# Of networks for re-identification, about; a dozen pairs outweigh them.
USUAL_SAME, USUAL_OTHER = Cosines.of(0.9, 0.1, 10.0), Cosines.of(0.3, 0.3, 10.0)


@dataclass(frozen=True)
class Likeness:
    """Cosines between the looks of a track and of a detection: of the same vehicle, and of two that are seen at once.

    A histogram of colors makes two gray cars alike to 0.98, a network for re-identification to 0.4: what tells vehicles
    apart is how much likelier a cosine is between looks of one than of two (Neyman & Pearson 1933).

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
        highest = self.same.total / self.same.count  # liker than usual is no less the same
        held = np.minimum(cosine, highest)
        return np.clip(self.same.log_density(held) - self.other.log_density(held), -STRONGEST, STRONGEST)

    def learned(self, cosines: Array) -> "Likeness":
        """With cosines [pair, pair] of the pairs of one frame, tracks down and their detections across."""
        apart = cosines[~np.eye(len(cosines), dtype=bool)]
        return Likeness(self.same.and_also(np.diagonal(cosines)), self.other.and_also(apart))
