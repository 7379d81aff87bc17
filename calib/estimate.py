"""Fit a model to control points by weighted least squares with its priors; its covariance; leave one out."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.control_points import ControlPoints
from calib.homography import inverse
from calib.models import GroundModel, View
from vision.camera import Calibration

Array = NDArray[np.float64]

LOST = 1e3  # standard deviations; residual of a point that a trial puts behind the camera
DOUBT = 0.01  # chance of so large a misfit below which the stated sigmas are not believed
STEP = 1e-5


@dataclass(frozen=True)
class Estimate:
    """A fitted model.

    Attributes
    ----------
    model, theta : family and parameters [p]
    covariance : [p, p] of theta
    excess : misfit, chi^2 per degree of freedom, that the covariance was enlarged by; 1 where it is no surprise
    """

    model: GroundModel
    theta: Array
    covariance: Array
    excess: float

    @property
    def view(self) -> View:
        """The view at theta."""
        return self.model.view(self.theta)

    def errors(self, points: ControlPoints) -> Array:
        """Distance [point], px, of the points from where the view puts them; inf where it cannot see them."""
        off = np.linalg.norm(self.view.project(points.ground) - points.pixels, axis=1)
        return np.asarray(np.where(np.isfinite(off), off, np.inf))


def estimate(model: GroundModel, points: ControlPoints, start: Array, robust: bool = False) -> Estimate:
    """Minimize the whitened pixel errors and the penalties, squared, from `start` [p].

    The maximum a posteriori for Gaussian errors of pixels and of places on the road, the latter carried to the image
    to first order (Hartley & Zisserman 2004, section 4.3). The covariance is (J'J)^-1; where chi^2 is larger than
    chance allows (1 %), it is enlarged by chi^2 per degree of freedom.

    Parameters
    ----------
    robust : weigh points that are far off by a Cauchy loss, to find outliers; the covariance then means nothing
    """
    from scipy.optimize import least_squares

    theta = np.asarray(start, float)
    loss = {"method": "trf", "loss": "cauchy", "f_scale": 2.0} if robust else {"method": "trf"}
    for _ in range(2 if points.sigma_xy.any() else 1):
        whitening = _whitening(model.view(theta), points)

        def residual(theta: Array, whitening: Array = whitening) -> Array:
            off = (model.view(theta).project(points.ground) - points.pixels)[:, :, None]
            return np.concatenate([np.nan_to_num(whitening @ off, nan=LOST).ravel(), model.penalty(theta)])

        found = least_squares(residual, theta, x_scale="jac", xtol=1e-8, ftol=1e-10, gtol=1e-9, **loss)
        theta = found.x
    excess = _excess(2 * found.cost, len(found.fun) - len(theta))
    return Estimate(model, theta, excess * _inverse_of_square(found.jac), excess)


def _whitening(view: View, points: ControlPoints) -> Array:
    """Matrices [point, 2, 2] that turn pixel errors into independent standard deviations."""
    covariance = points.sigma[:, None, None] ** 2 * np.eye(2)
    if points.sigma_xy.any():
        step = 1e-3 * np.eye(2)
        moved = [view.project(points.ground + d) - view.project(points.ground - d) for d in step]
        slope = np.nan_to_num(np.stack(moved, axis=-1) / 2e-3)
        covariance = covariance + points.sigma_xy[:, None, None] ** 2 * slope @ slope.transpose(0, 2, 1)
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))


def _excess(chi2: float, freedom: int) -> float:
    from scipy.stats import chi2 as distribution

    return chi2 / freedom if freedom > 0 and distribution.sf(chi2, freedom) < DOUBT else 1.0


def _inverse_of_square(jacobian: Array) -> Array:
    """(J'J)^-1, by singular values of J with columns of equal length."""
    length = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-12)
    _, singular, vt = np.linalg.svd(jacobian / length, full_matrices=False)
    root = vt.T / np.maximum(singular, 1e-12) / length[:, None]
    return np.asarray(root @ root.T)


def slope_of(function: Callable[[Array], Array], theta: Array, covariance: Array) -> Array:
    """Derivative [m, p] of a vector function by theta, with steps that suit the parameters' covariance."""
    steps = STEP * np.maximum(np.sqrt(np.diagonal(covariance)), 1e-9)
    columns = [(function(theta + d) - function(theta - d)) / (2 * d.max()) for d in np.diag(steps)]
    return np.stack(columns, axis=-1)


def leave_one_out(fit: Estimate, points: ControlPoints, calibration: Calibration) -> tuple[Array, Array]:
    """Where the others put each point: distances [point] in px and in m; inf where they cannot say."""
    in_pixels, in_meters = [], []
    for index in range(len(points)):
        rest, alone = points.without(index), points.select(np.arange(len(points)) == index)
        if not fit.model.determined_by(rest):
            in_pixels.append(np.inf)
            in_meters.append(np.inf)
            continue
        others = estimate(fit.model, rest, fit.theta)
        in_pixels.append(float(others.errors(alone)[0]))
        moved = with_view(calibration, others.view)
        off = float(np.linalg.norm(moved.to_ground(alone.pixels) - alone.ground)) if moved else np.inf
        in_meters.append(off if np.isfinite(off) else np.inf)
    return np.array(in_pixels), np.array(in_meters)


def with_view(calibration: Calibration, view: View) -> Calibration | None:
    """Return the bare calibration of a view; None where it shows the road from below."""
    from pydantic import ValidationError

    homography = inverse(view.to_image)
    try:
        return Calibration(image_size=calibration.image_size, homography=homography, lens=view.lens)
    except ValidationError:
        return None
