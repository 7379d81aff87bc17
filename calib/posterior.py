"""How sure a fit to few points is: their scatter is known roughly, and one of them may be misread."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

TRUST = 4.0  # degrees of freedom that the stated sigmas are worth: they are known to a factor of about 1.5
MISREAD = 0.02  # chance that a point is misread, and
FAR = 10.0  # then by this many of its sigmas
OPEN = 1e-13  # information, of 1, in a direction that is open


def scatter(chi2: float, freedom: int) -> float:
    """Variance of the points' errors over the stated one, as far as their misfit shows it.

    Of a scaled inverse chi-square: `TRUST` degrees of freedom for the stated sigmas, and those of the fit; its mean, so
    that few of them count as in Student's t (Gelman et al. 2013, Bayesian Data Analysis, section 3.2).

    >>> scatter(2.0, 0), scatter(96.0, 100)
    (3.0, 0.9803921568627451)
    """
    return (TRUST + chi2) / (TRUST + freedom - 2)


def posterior_covariance(off: Array, slope: Array, penalty: Array, bend: Array) -> Array:
    """Covariance [p, p] of parameters at the least squares minimum.

    A mixture, to second moments about the minimum: no point is misread, or one of them, with `FAR` times its sigma. To
    first order a point's sigma only takes its share out of the normal equations, and Laplace's method says how much
    better or worse the others then fit. Points that others check gain nothing by it; one that alone decides something
    makes that as uncertain as its being misread does.

    Parameters
    ----------
    off, slope : [point, 2], errors over their sigmas, and their derivative [point, 2, p]
    penalty, bend : [q], deviations from what is known beforehand, and their derivative [q, p]
    """
    count, parameters = len(off), slope.shape[2]
    length = np.maximum(np.sqrt((slope**2).sum(axis=(0, 1)) + (bend**2).sum(axis=0)), 1e-12)
    slope, bend = slope / length, bend / length
    noise = scatter(float((off**2).sum() + (penalty**2).sum()), 2 * count + len(penalty) - parameters)
    information = np.einsum("nip,niq->npq", slope, slope) / noise
    whole = information.sum(axis=0) + bend.T @ bend
    lost = 1 - 1 / (1 + FAR**2)
    without = whole - lost * information
    pull = lost * np.einsum("nip,ni->np", slope, off) / noise
    values, vectors = np.linalg.eigh(np.concatenate([whole[None], without]))
    values = np.maximum(values, OPEN)
    inverses = (vectors / values[:, None, :]) @ vectors.transpose(0, 2, 1)
    moved = np.einsum("npq,nq->np", inverses[1:], pull)
    gain = (lost * (off**2).sum(axis=1) / noise + (moved * pull).sum(axis=1)) / 2
    gain += (np.log(values[0]) - np.log(values[1:])).sum(axis=1) / 2 - np.log(1 + FAR**2)
    weight = np.append(0.0, gain + np.log(MISREAD / (1 - MISREAD)))
    weight = np.exp(weight - weight.max())
    weight /= weight.sum()
    shift = np.concatenate([np.zeros((1, parameters)), moved])
    spread = inverses + shift[:, :, None] * shift[:, None, :]
    return np.asarray(np.einsum("n,npq->pq", weight, spread) / np.outer(length, length))


def decided(slope: Array, bend: Array) -> float:
    """How many of the parameters data decide, of which others are known beforehand: the trace of their leverage.

    Parameters
    ----------
    slope, bend : derivatives [m, p] of the data and [q, p] of the deviations from what is known, in their sigmas

    >>> round(decided(np.array([[3.0, 0.0], [3.0, 0.0]]), np.array([[0.0, 1.0]])), 6)
    1.0
    >>> round(decided(np.eye(1), np.eye(1)), 6)
    0.5
    """
    length = np.maximum(np.linalg.norm(np.concatenate([slope, bend]), axis=0), 1e-12)
    both = np.concatenate([slope, bend]) / length
    left = np.linalg.svd(both, full_matrices=False)[0]
    return float((left[: len(slope)] ** 2).sum())
