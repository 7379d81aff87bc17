"""Covariance of a fit to few points: their scatter is known roughly, and one of them may be misread."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

TRUST = 4.0  # degrees of freedom assigned to the stated sigmas, which are known to a factor of about 1.5
MISREAD = 0.02  # probability that a point is misread, and
FAR = 10.0  # its error then, in sigmas
OPEN = 1e-13  # information, of 1, in an undetermined direction


def scatter(chi2: float, freedom: int) -> float:
    """Variance of the points' errors relative to the stated one, estimated from their misfit.

    Of a scaled inverse chi-square: `TRUST` degrees of freedom for the stated sigmas, and those of the fit; its mean, so
    that few of them count as in Student's t (Gelman et al. 2013, Bayesian Data Analysis, section 3.2).

    >>> scatter(2.0, 0), scatter(96.0, 100)
    (3.0, 0.9803921568627451)
    """
    return (TRUST + chi2) / (TRUST + freedom - 2)


def posterior_covariance(off: Array, slope: Array, penalty: Array, bend: Array) -> Array:
    """Covariance [p, p] of parameters at the least squares minimum.

    Second moments, about the minimum, of a mixture: no point is misread, or one of them is, with `FAR` times its sigma.
    To first order, a larger sigma removes a point's share from the normal equations, and Laplace's method tells how
    much better or worse the others then fit. This hardly matters for points that others check; a parameter that one
    point alone decides becomes as uncertain as that point's possible misreading makes it.

    Parameters
    ----------
    off, slope : [point, 2], errors over their sigmas, and their derivatives [point, 2, p]
    penalty, bend : [q], deviations from the prior, and their derivatives [q, p]
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
    """How many of the parameters the data decide rather than the prior: the trace of the data's leverage.

    Parameters
    ----------
    slope, bend : derivatives [m, p] of the data and [q, p] of the deviations from the prior, in their sigmas

    >>> round(decided(np.array([[3.0, 0.0], [3.0, 0.0]]), np.array([[0.0, 1.0]])), 6)
    1.0
    >>> round(decided(np.eye(1), np.eye(1)), 6)
    0.5
    """
    length = np.maximum(np.linalg.norm(np.concatenate([slope, bend]), axis=0), 1e-12)
    both = np.concatenate([slope, bend]) / length
    left = np.linalg.svd(both, full_matrices=False)[0]
    return float((left[: len(slope)] ** 2).sum())
