"""A fit as a calibration, and its leave-one-out errors."""

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from calib.control_points import ControlPoints
from calib.estimate import Estimate, estimate, slope_of
from calib.homography import inverse
from calib.models import with_sigmas
from vision.camera import Calibration, ControlPoint
from vision.contract import LocalFrame

Array = NDArray[np.float64]


def calibration_of(
    fit: Estimate, points: ControlPoints, image_size: tuple[int, int], frame: LocalFrame | None
) -> Calibration:
    """Calibration of a fit, complete: its covariance, what it was fitted to, and how well that fits."""
    marks = tuple(
        ControlPoint(u=u, v=v, x=x, y=y, name=name, sigma=sigma, sigma_xy=sigma_xy)
        for name, (u, v), (x, y), sigma, sigma_xy in zip(
            points.names,
            points.pixels.tolist(),
            points.ground.tolist(),
            points.sigma.tolist(),
            points.sigma_xy.tolist(),
            strict=True,
        )
    )

    def vector(theta: Array) -> Array:
        view = fit.model.view(theta)
        return np.append(np.linalg.inv(view.to_image).ravel(), [] if view.lens is None else view.lens.vector)

    def numbers(theta: Array) -> Array:
        return np.array([value for value, _ in fit.model.describe(theta).values()])

    slope = slope_of(vector, fit.theta, fit.covariance)
    described = fit.model.describe(fit.theta)
    by_theta = slope_of(numbers, fit.theta, fit.covariance)
    sigmas = np.sqrt(np.einsum("ip,pq,iq->i", by_theta, fit.covariance, by_theta)) if described else np.zeros(0)
    bare = Calibration(
        image_size=image_size,
        homography=inverse(fit.view.to_image),
        lens=fit.view.lens,
        model=fit.model.name,
        covariance=_symmetric(slope @ fit.covariance @ slope.T),
        parameters=with_sigmas(described, sigmas),
        control_points=marks,
    )
    in_meters = np.linalg.norm(bare.to_ground(points.pixels) - points.ground, axis=1)
    return bare.model_copy(
        update={
            "residuals_px": tuple(fit.errors(points).tolist()),
            "residuals_m": tuple(in_meters.tolist()),
            "origin": frame and frame.origin,
            "x_azimuth": frame and frame.x_azimuth,
        }
    )


def _symmetric(matrix: Array) -> Array:
    return np.asarray((matrix + matrix.T) / 2)


def leave_one_out(fit: Estimate, points: ControlPoints, image_size: tuple[int, int]) -> tuple[Array, Array, Array]:
    """Distance of each point from where the other points put it.

    Returns
    -------
    distances [point], px and m, and the root mean square distance, m, expected from the covariance of the others and
    the point's sigma; inf where the others do not determine it
    """
    found = [_left_out(fit, points, index, image_size) for index in range(len(points))]
    in_pixels, in_meters, expected = np.array(found).T
    return in_pixels, in_meters, expected


def _left_out(fit: Estimate, points: ControlPoints, index: int, image_size: tuple[int, int]) -> Array:
    rest, alone = points.without(index), points.select(np.arange(len(points)) == index)
    found = np.full(3, np.inf)
    if not fit.model.determined_by(rest):
        return found
    others = estimate(fit.model, rest, fit.theta)
    found[0] = others.errors(alone)[0]
    try:
        calibration = calibration_of(others, rest, image_size, None)
    except ValidationError:  # it shows the road from below
        return found
    off = np.linalg.norm(calibration.to_ground(alone.pixels) - alone.ground)
    slope = calibration.jacobian(alone.pixels)[0]
    variance = np.trace(calibration.position_covariance(alone.pixels)[0]) + alone.sigma[0] ** 2 * (slope**2).sum()
    if np.isfinite([off, variance]).all():
        found[1:] = off, np.sqrt(variance + 2 * alone.sigma_xy[0] ** 2)
    return found
