"""Score test of effects that are not in the model: how much each would lower the misfit, all else refitted.

With r the whitened residual, J the derivatives by all that was fitted (rows of the priors appended) and X those by the
effect's parameters at its null, X' = (1 - J (J'J)^-1 J') X is what the fit leaves of them. U = X'.r and I = X'.X' give
the predicted fall of chi2, U' I^-1 U, the estimate I^-1 U and its covariance I^-1 (Rao 1948, Math. Proc. Cambridge
Philos. Soc. 44, 50; the projection is that of Neyman 1959, C(alpha) tests).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from solver.criticism.marginal import Spectrum
from solver.criticism.sums import Sums
from solver.effect import Effect
from solver.fit.windowed import Windowed

Array = NDArray[np.float64]

#: A direction of which less than this share of its variance is left by the fit cannot be told from the route.
INVISIBLE = 1e-6
#: Directions that change less than this share of what the strongest of an effect changes, squared, are not looked at.
SILENT = 1e-12
#: Standard deviations of chi2 from its mean at which a fall is more than noise.
NOTED = 4.0


@dataclass(frozen=True)
class Score:
    """What the score test says of one effect, or of one way to spread its parameters.

    Parameters
    ----------
    effect : the candidate
    shape : values of its shape parameters
    shared : one number per parameter for all passes, where its scope is "pass"
    fall : predicted fall of chi2
    freedom : numbers that it adds
    trials : how many shapes were tried
    counts : how many numbers each amplitude has
    estimate, sigma : [number], those of passes that share one the same; sigma is nan where a number changes nothing
    retained : share of the effect's signal that the fit leaves visible
    signal : [sample * channel + anchor, 1], whitened, what the estimate would change; None where too much of it was
        looked at to keep
    crossed : [fitted], products of that with all that was fitted
    spectrum : what the fit leaves of plausible sizes
    variance : that the noise counts as, as the base model is not exact
    """

    effect: Effect
    shape: dict[str, float]
    shared: bool
    fall: float
    freedom: int
    trials: int
    counts: tuple[int, ...]
    estimate: Array
    sigma: Array
    retained: float
    signal: Windowed | None
    crossed: Tensor
    spectrum: Spectrum
    variance: float

    @property
    def evidence(self) -> float:
        """Ln of the Bayes factor against the model without the effect, less the ln of shapes tried."""
        return self.spectrum.evidence(self.variance) - float(np.log(self.trials))

    def tolerated(self, variance: float, off: float) -> float:
        """Ln of the Bayes factor for a discrepancy of variance `off` in its directions, less the ln of shapes tried."""
        return self.spectrum.tolerated(variance, off) - float(np.log(self.trials))

    @property
    def beyond_noise(self) -> bool:
        """Whether chi2 falls by clearly more than noise alone makes it fall."""
        return self.fall > self.freedom + NOTED * np.sqrt(2 * self.freedom)


@dataclass(frozen=True)
class Projected:
    """What the fit leaves of some directions.

    Parameters
    ----------
    score : [number], along the residual
    information : [number, number], of what is left
    gram : [number, number], of what there was
    """

    score: Tensor
    information: Tensor
    gram: Tensor

    @classmethod
    def beyond(cls, sums: Sums, factor: Tensor, step: Tensor) -> "Projected":
        """Beyond what was fitted, whose normal matrix has that factor, and which would go on by that step."""
        half = torch.linalg.solve_triangular(factor, sums.crossed, upper=False)
        return cls(sums.score - sums.crossed.T @ step, sums.gram - half.T @ half, sums.gram)

    @property
    def least(self) -> float:
        """What a direction must change, squared, to be looked at."""
        return max(SILENT * float(self.gram.diagonal().max()), 1e-300)

    def combined(self, mix: Tensor) -> "Projected":
        """The same for combinations [number, combination] of the directions."""
        return Projected(mix.T @ self.score, mix.T @ self.information @ mix, mix.T @ self.gram @ mix)


def mixes(effect: Effect, counts: Sequence[int]) -> Iterator[tuple[bool, Tensor]]:
    """Combinations of numbers [number, combination]: each alone and, of one number per pass, summed over passes."""
    yield False, torch.eye(sum(counts), dtype=torch.float64)
    if any(p.scope == "pass" for p in effect.amplitudes):
        yield True, torch.block_diag(*(torch.ones(count, 1, dtype=torch.float64) for count in counts))


class Outcome(NamedTuple):
    """What a score test finds.

    Parameters
    ----------
    fall, freedom : of chi2, by how many numbers
    estimate, sigma : [number]
    retained : share of the signal that the fit leaves visible
    spectrum : what is left of plausible sizes
    """

    fall: float
    freedom: int
    estimate: Array
    sigma: Array
    retained: float
    spectrum: Spectrum


def outcome(projected: Projected, signs: Array | None, size: Tensor, alike: Tensor | None = None) -> Outcome:
    """The score test of numbers of plausible `size` [number].

    `signs` [number] are those that they must have, 0 for either; `alike` is as of a `Spectrum`.
    """
    # A parameter to which nothing is sensitive gets no estimate, rather than a huge one.
    scale = projected.gram.diagonal().clamp_min(projected.least).sqrt()
    values, vectors = torch.linalg.eigh(projected.information / scale[:, None] / scale)
    keep = values > INVISIBLE
    scaled = vectors[:, keep] / scale[:, None]
    seen = (scaled.T @ projected.score) / values[keep].sqrt()
    fall = float(seen.square().sum())
    estimate = ((scaled / values[keep].sqrt()) @ seen).numpy()
    spectrum = Spectrum.of(projected.information, projected.score, size, alike)
    if signs is not None and (estimate * signs < 0).any():
        if len(signs) == 1:
            fall, spectrum = 0.0, replace(spectrum, along=0 * spectrum.along)
        else:
            root = (vectors[:, keep] * values[keep].sqrt()).T * scale
            estimate, fall = bounded(root.numpy(), seen.numpy(), signs)
    sigma = (scaled.square() / values[keep]).sum(1).sqrt()
    retained = float((values[keep].sum() / len(values)).clamp(max=1))
    return Outcome(fall, int(keep.sum()), estimate, sigma.numpy(), retained, spectrum)


def bounded(root: Array, seen: Array, signs: Array) -> tuple[Array, float]:
    """The numbers of given signs that bring `root` [direction, number] nearest to `seen` [direction], and the fall.

    >>> found, fall = bounded(np.eye(2), np.array([3.0, -4.0]), np.array([1.0, 1.0]))
    >>> found.round(6).tolist(), round(fall, 6)
    ([3.0, 0.0], 9.0)
    """
    from scipy.optimize import lsq_linear

    lower, upper = np.where(signs > 0, 0.0, -np.inf), np.where(signs < 0, 0.0, np.inf)
    found = lsq_linear(root, seen, (lower, upper), method="bvls").x
    return found, float(seen @ seen - np.square(seen - root @ found).sum())


def one_sided(effect: Effect, counts: Sequence[int]) -> Array:
    """Signs [number] that an effect's numbers must have as their null is a bound, 0 for either.

    `counts` says how many numbers each amplitude has.
    """
    signs = [float(np.sign(p.lower + p.upper - 2 * p.null)) if p.one_sided else 0.0 for p in effect.amplitudes]
    return np.repeat(signs, counts)
