"""Fit the homography between the image and the road plane to control points, and say how good it is."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.control_points import ControlPoints
from calib.homography import Scaling, apply, inverse, refine, reprojection, weighted_residual
from calib.layout import MIRRORED, flaw_of, require_below_horizon, require_layout, require_spread
from vision.camera import Calibration, ControlPoint
from vision.contract import InputError, LocalFrame

Array = NDArray[np.float64]
THRESHOLD = 5.0  # px; a mark further off than this is left out
ROBUST_FROM = 6  # points; with fewer, no majority can outvote an outlier
WEAK = 5.0  # uncertainty of a projected pixel over that of a control point that deserves a warning
BRITTLE, LARGE = 4.0, 0.5  # leave-one-out error over fit error, and m, that together deserve a warning


@dataclass(frozen=True)
class GroundFit:
    """A calibration and what to think of it.

    Attributes
    ----------
    calibration : homography, the control points it was fitted to, their residuals
    used : [point] of all control points given; False where the point was left out as an outlier
    residuals_px, residuals_m : [point], of all control points given
    worst_sigma : m; largest standard deviation of the ground position of a pixel known to one sigma of the control
        points, over the corners of the surveyed area
    warnings : one line each
    """

    calibration: Calibration
    used: NDArray[np.bool_]
    residuals_px: Array
    residuals_m: Array
    worst_sigma: float
    warnings: tuple[str, ...]


def fit_ground(
    points: ControlPoints,
    image_size: tuple[int, int],
    *,
    threshold: float = THRESHOLD,
    frame: LocalFrame | None = None,
) -> GroundFit:
    """Fit a homography to control points.

    From six points on, MAGSAC++ (Barath et al. 2020) leaves out those further than `threshold` from where the others
    put them. Then the sum over points of ((pixel - projected pixel) / sigma)^2, which is the maximum likelihood
    criterion for pixels read with a Gaussian error (Hartley & Zisserman 2004, section 4.3), is minimized.

    Parameters
    ----------
    points : at least four, no line through all of them or all but one
    image_size : width, height, px
    threshold : px
    frame : origin and azimuth to note in the file

    Raises
    ------
    InputError
        Too few points, collinear ones, some above the horizon of the others, a mirrored frame, pixels outside the
        image, or no homography that most of them agree with.

    Examples
    --------
    >>> import numpy as np
    >>> pixels = np.array([[100.0, 400], [500, 400], [250, 250], [350, 250], [300, 300]])
    >>> straight_down = pixels[:, ::-1] * [-0.1, 0.1]
    >>> points = ControlPoints(tuple("abcde"), pixels, straight_down, np.ones(5))
    >>> fit_ground(points, (640, 480)).calibration.to_ground([[50, 100]]).round(6).tolist()
    [[-10.0, 5.0]]
    """
    require_layout(points, image_size)
    to_image = _first_guess(points, threshold)
    used = np.ones(len(points), bool)
    if len(points) >= ROBUST_FROM:
        used = reprojection(to_image, points) <= threshold
    kept = points.select(used)
    require_spread(kept)
    to_image = refine(kept, to_image)
    require_below_horizon(points, to_image)
    left_out = leave_one_out(kept, to_image)
    calibration = _calibration(kept, image_size, to_image, left_out, frame)
    residuals_m = np.linalg.norm(calibration.to_ground(points.pixels) - points.ground, axis=1)
    worst, dilution = _uncertainty(kept, to_image, calibration)
    return GroundFit(
        calibration,
        used,
        reprojection(to_image, points),
        residuals_m,
        worst,
        tuple(_warnings(points, used, residuals_m, left_out, dilution)),
    )


def leave_one_out(points: ControlPoints, to_image: Array) -> Array | None:
    """Distance [point], m, of each point from where the others put it; None where the others cannot."""
    errors = []
    for index in range(len(points)):
        others = points.select(np.arange(len(points)) != index)
        if len(others) < 4 or flaw_of(others) is not None:
            return None
        from_others = inverse(refine(others, to_image))
        errors.append(np.linalg.norm(apply(from_others, points.pixels[[index]]) - points.ground[index]))
    return np.array(errors)


def _first_guess(points: ControlPoints, threshold: float) -> Array:
    """Homography [3, 3], ground -> pixels: robust where there are points enough, else by least squares."""
    import cv2

    cv2.setRNGSeed(0)
    if len(points) < ROBUST_FROM:
        return np.asarray(cv2.findHomography(points.ground, points.pixels, 0)[0], float)

    def robust(ground: Array) -> Array | None:
        found, inside = cv2.findHomography(
            ground, points.pixels, cv2.USAC_MAGSAC, threshold, maxIters=10_000, confidence=0.9999
        )
        return None if found is None or inside.sum() < max(5, len(points) // 2 + 1) else np.asarray(found, float)

    if (found := robust(points.ground)) is not None:
        return found
    # MAGSAC++ draws only samples seen from above, so that a mirrored frame has none that fits.
    if robust(points.ground * [1, -1]) is not None:
        raise InputError(MIRRORED)
    raise InputError(
        f"control points: no homography puts most of them within {threshold:g} px; "
        "check that px, py and x, y belong together"
    )


def _calibration(
    points: ControlPoints,
    image_size: tuple[int, int],
    to_image: Array,
    left_out: Array | None,
    frame: LocalFrame | None,
) -> Calibration:
    marks = tuple(
        ControlPoint(u=u, v=v, x=x, y=y, name=name)
        for name, (u, v), (x, y) in zip(points.names, points.pixels.tolist(), points.ground.tolist(), strict=True)
    )
    calibration = Calibration(image_size=image_size, homography=inverse(to_image), control_points=marks)
    in_meters = np.linalg.norm(calibration.to_ground(points.pixels) - points.ground, axis=1)
    return calibration.model_copy(
        update={
            "residuals_px": tuple(reprojection(to_image, points).tolist()),
            "residuals_m": tuple(in_meters.tolist()),
            "leave_one_out_m": None if left_out is None else tuple(left_out.tolist()),
            "origin": frame and frame.origin,
            "x_azimuth": frame and frame.x_azimuth,
        }
    )


def _uncertainty(points: ControlPoints, to_image: Array, calibration: Calibration) -> tuple[float, float]:
    """Largest standard deviation over the corners of the surveyed area: m on the ground, and px over sigma.

    The covariance of the eight parameters, (J'J)^-1 with J the derivative of the weighted residuals, carried to the
    pixel and on to the ground to first order. Errors larger than sigma enlarge it.
    """
    low, high = points.ground.min(axis=0), points.ground.max(axis=0)
    corners = np.array([[x, y] for x in (low[0], high[0]) for y in (low[1], high[1])])
    pixels = calibration.to_image(corners)
    seen = np.isfinite(pixels).all(axis=1)
    scaling = Scaling.of(points)
    h = scaling.parameters(to_image)
    information = (scaling.jacobian(h, points.ground) / points.sigma[:, None, None]).reshape(-1, 8)
    residual = weighted_residual(to_image, points)
    excess = max(1.0, float(residual @ residual) / (residual.size - 8)) if residual.size > 8 else 1.0
    covariance = inverse(information.T @ information) * excess
    in_pixels = scaling.jacobian(h, corners[seen])
    in_meters = calibration.jacobian(pixels[seen]) @ in_pixels
    dilution = _largest(in_pixels, covariance) / float(np.sqrt(excess) * np.median(points.sigma))
    return _largest(in_meters, covariance), dilution


def _largest(jacobian: Array, covariance: Array) -> float:
    """Largest principal standard deviation among points, jacobian [point, 2, 8]."""
    return float(np.sqrt(np.linalg.eigvalsh(jacobian @ covariance @ jacobian.transpose(0, 2, 1)).max()))


def _warnings(
    points: ControlPoints, used: NDArray[np.bool_], residuals_m: Array, left_out: Array | None, dilution: float
) -> list[str]:
    messages = []
    if not used.all():
        names = ", ".join(name for name, good in zip(points.names, used, strict=True) if not good)
        messages.append(f"left out as outliers: {names}; check their pixels and places")
    if used.sum() == 4:
        messages.append("four points fit any homography exactly: nothing checks them; add more")
    elif left_out is None:
        messages.append("without one of the points the others no longer determine the homography; add more")
    elif (brittle := float(np.sqrt(np.mean(left_out**2)))) > max(
        BRITTLE * float(np.sqrt(np.mean(residuals_m[used] ** 2))), LARGE
    ):
        messages.append(
            f"leave-one-out errors of {brittle:.2f} m: every point bears much; add points between and beyond"
        )
    if dilution > WEAK:
        messages.append(
            f"the layout is weak: at the edge of the surveyed area pixels are {dilution:.0f} times as uncertain as a "
            "control point; spread the points over the road, near and far, left and right"
        )
    return messages
