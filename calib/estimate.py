"""Fit a model to control points by weighted least squares with its priors; its covariance; leave one out."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.control_points import ControlPoints
from calib.lens_prior import DOUBT
from calib.models import GroundModel, View
from calib.posterior import TRUST, decided, posterior_covariance

Array = NDArray[np.float64]

LOST = 1e3  # sigmas; residual given to a point that a trial puts behind the camera
STEP = 1e-5


@dataclass(frozen=True)
class Estimate:
    """A fitted model.

    Attributes
    ----------
    model, theta : family and parameters [p]
    covariance : [p, p] of theta
    chi2, freedom : misfit and its degrees of freedom, of the points and the priors
    decided : how many of the parameters the points decide; the priors decide the others
    """

    model: GroundModel
    theta: Array
    covariance: Array
    chi2: float
    freedom: int
    decided: float

    @property
    def excess(self) -> float:
        """Misfit, chi^2 per degree of freedom; 1 where chance explains it."""
        from scipy.stats import chi2

        surprising = self.freedom > 0 and chi2.sf(self.chi2, self.freedom) < DOUBT
        return self.chi2 / self.freedom if surprising else 1.0

    @property
    def view(self) -> View:
        """The view at theta."""
        return self.model.view(self.theta)

    def errors(self, points: ControlPoints) -> Array:
        """Distance [point], px, of the points from where the view puts them; inf where it cannot see them."""
        return self.view.errors(points)


def estimate(model: GroundModel, points: ControlPoints, start: Array, robust: bool = False) -> Estimate:
    """Minimize the whitened pixel errors and the penalties, squared, from `start` [p].

    The maximum a posteriori for Gaussian errors of pixels and of places on the road, the latter carried to the image
    to first order (Hartley & Zisserman 2004, section 4.3). The covariance is that of `posterior_covariance`.

    Parameters
    ----------
    robust : use a Cauchy loss to find outliers; the covariance is then meaningless
    """
    from scipy.optimize import least_squares

    theta = np.asarray(start, float)
    loss = {"method": "trf", "loss": "cauchy", "f_scale": 2.0} if robust else {"method": "trf"}
    for _ in range(2 if points.sigma_xy.any() else 1):
        white = whitening(model.view(theta), points)

        def residual(theta: Array, white: Array = white) -> Array:
            off = (model.view(theta).project(points.ground) - points.pixels)[:, :, None]
            return np.concatenate([np.nan_to_num(white @ off, nan=LOST).ravel(), model.penalty(theta)])

        def derivative(theta: Array, white: Array = white) -> Array:
            seen = np.isfinite(model.view(theta).errors(points))[:, None, None]
            slopes = np.where(seen, white @ model.slope(theta, points.ground), 0.0)
            return np.concatenate([slopes.reshape(-1, len(theta)), model.penalty_slope(theta)])

        found = least_squares(residual, theta, derivative, x_scale="jac", xtol=1e-8, ftol=1e-10, gtol=1e-9, **loss)
        theta = found.x
    chi2, freedom = float((found.fun**2).sum()), len(found.fun) - len(theta)
    (off, penalty), (slope, bend) = np.split(found.fun, [2 * len(points)]), np.split(found.jac, [2 * len(points)])
    covariance = posterior_covariance(off.reshape(-1, 2), slope.reshape(len(points), 2, -1), penalty, bend)
    return Estimate(model, theta, covariance, chi2, freedom, decided(slope, bend))


def whitening(view: View, points: ControlPoints) -> Array:
    """Matrices [point, 2, 2] that turn pixel errors into independent standard deviations."""
    covariance = points.sigma[:, None, None] ** 2 * np.eye(2)
    if points.sigma_xy.any():
        step = 1e-3 * np.eye(2)
        moved = [view.project(points.ground + d) - view.project(points.ground - d) for d in step]
        slope = np.nan_to_num(np.stack(moved, axis=-1) / 2e-3)
        covariance = covariance + points.sigma_xy[:, None, None] ** 2 * slope @ slope.transpose(0, 2, 1)
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))


def scatters_more(fit: Estimate, other: Estimate) -> bool:
    """Whether the points scatter about one fit more than about another, beyond chance, whatever their common scatter.

    Fisher's test of two variances, in which the stated sigmas count as `TRUST` degrees of freedom.
    """
    from scipy.stats import f

    free, other_free = TRUST + fit.freedom, TRUST + other.freedom
    ratio = ((TRUST + fit.chi2) / free) / ((TRUST + other.chi2) / other_free)
    return bool(f.sf(ratio, free, other_free) < DOUBT)


def slope_of(function: Callable[[Array], Array], theta: Array, covariance: Array) -> Array:
    """Derivative [m, p] of a vector function with respect to theta, with steps scaled by the parameters' covariance."""
    steps = STEP * np.maximum(np.sqrt(np.diagonal(covariance)), 1e-9)
    columns = [(function(theta + d) - function(theta - d)) / (2 * d.max()) for d in np.diag(steps)]
    return np.stack(columns, axis=-1)
