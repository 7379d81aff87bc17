"""First guesses that are robust to outliers, and the points that agree with them."""

import logging
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calib.control_points import ControlPoints
from calib.estimate import Estimate, estimate
from calib.homography import Scaling, inverse
from calib.layout import HANDED, MIRRORED, require_below_horizon
from calib.lens_prior import LensPrior, weak_prior
from calib.models import CameraModel, GroundModel, HomographyModel, View, rotation_by
from vision.contract import InputError
from vision.lens import Lens

log = logging.getLogger("roadfiber.calibrate")

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
ROBUST_FROM = 6  # points; with fewer, no majority can outvote an outlier
FOCALS = (-2.0, -1.0, 0.0, 1.0, 2.0)  # guesses of the focal length, in standard deviations of its prior
REFINED = 6  # best guesses that are refined
BENT = 6.0  # thresholds within which a distorted picture of a plane agrees with a homography
SIGMAS = 4.0  # a point may be off by this many of its sigmas and still agree


def agree(view: View, points: ControlPoints, threshold: float) -> Mask:
    """Which points [point] a view puts within `threshold`, px, or four of their sigmas."""
    if len(points) < ROBUST_FROM:
        return np.ones(len(points), bool)
    spread = points.sigma
    if points.sigma_xy.any():
        moved = view.project(points.ground + 1e-3) - view.project(points.ground)
        spread = np.hypot(spread, points.sigma_xy * np.nan_to_num(np.linalg.norm(moved, axis=1)) / 1e-3 / np.sqrt(2))
    return np.asarray(view.errors(points) <= np.maximum(threshold, SIGMAS * spread))


def most(count: int) -> int:
    """Fewest points that must agree with a fit to `count` points."""
    return max(5, count // 2 + 1) if count >= ROBUST_FROM else count


def start_homography(points: ControlPoints, threshold: float, prior: LensPrior | None) -> tuple[Estimate, Mask]:
    """Fit a homography to the points that most agree with (MAGSAC++, Barath et al. 2020), and say which.

    Raises
    ------
    InputError
        If no homography puts most of them within `threshold`, px, or only a mirrored one does.
    """
    pixels = prior.lens(np.zeros(prior.size)).undistort(points.pixels) if prior else points.pixels
    if not np.isfinite(pixels).all():
        raise InputError("control points: some are where the lens of --intrinsics shows nothing; check the intrinsics")
    to_image = magsac(points.ground, pixels, threshold)
    if to_image is None and magsac(points.ground * [1, -1], pixels, threshold) is not None:
        # MAGSAC++ draws only samples seen from above, so that none fits a mirrored frame.
        raise InputError(MIRRORED)
    if to_image is None:
        raise InputError(
            f"control points: no homography puts most of them within {threshold:g} px; "
            "check that px, py and x, y belong together"
        )
    if len(points) < ROBUST_FROM:
        require_below_horizon(points, inverse(to_image), pixels)
    model = HomographyModel(Scaling.of(points.ground, pixels), prior)
    start = model.start(to_image)
    used = agree(model.view(start), points, threshold)
    if used.sum() < 4:
        raise InputError(f"control points: fewer than 4 within {threshold:g} px of one homography; check their places")
    return estimate(model, points.select(used), start), used


def magsac(ground: Array, pixels: Array, threshold: float) -> Array | None:
    """Homography [3, 3], ground -> pixels [point, 2]: robust where there are points enough; None without a majority."""
    import cv2

    cv2.setRNGSeed(0)
    if len(ground) < ROBUST_FROM:
        return np.asarray(cv2.findHomography(ground, pixels, 0)[0], float)
    found, inside = cv2.findHomography(ground, pixels, cv2.USAC_MAGSAC, threshold, maxIters=10_000, confidence=0.9999)
    return None if found is None or inside.sum() < most(len(ground)) else np.asarray(found, float)


def start_camera(
    points: ControlPoints, threshold: float, prior: LensPrior, height: tuple[float, float] | None
) -> tuple[Estimate, Mask]:
    """Fit a camera to the points that most agree with, from several focal lengths, and say which.

    Raises
    ------
    InputError
        If no camera above the road puts most of them within `threshold`, px.
    """
    guesses = [
        (model, theta)
        for some in _subsets(points, threshold)
        for model, theta in _poses(points.select(some), prior, height)
    ]
    guesses.sort(key=lambda guess: _cost(guess[0], guess[1], points))
    robust = len(points) >= ROBUST_FROM
    fits = [estimate(model, points, theta, robust=robust) for model, theta in guesses[:REFINED]]
    fits = [fit for fit in fits if fit.theta[-1] < 0]
    if not fits:
        raise InputError(f"control points: no camera above the road sees them so; {HANDED}")
    best = min(fits, key=lambda fit: _cost(fit.model, fit.theta, points))
    if not robust and best.errors(points).max() > BENT * threshold:
        raise InputError(f"control points: no camera puts them within {BENT * threshold:g} px; check their places")
    used = agree(best.view, points, threshold)
    for _ in range(3):
        if used.sum() < most(len(points)):
            raise InputError(
                f"control points: no camera puts most of them within {threshold:g} px; "
                "check that px, py and x, y belong together"
            )
        best = estimate(best.model, points.select(used), best.theta)
        before, used = used, agree(best.view, points, threshold)
        if (used == before).all():
            break
    return best, before


def on_road(
    points: ControlPoints,
    image_size: tuple[int, int],
    lens: LensPrior | None,
    height: tuple[float, float] | None,
    threshold: float,
) -> ControlPoints:
    """Replace marks above or below the road by the places of the road in line with them.

    These follow from the camera's position, which the marks determine, and hardly depend on it: a mark's height over
    the camera's is the share of an error that is left after a round.

    Parameters
    ----------
    points : control points
    image_size, lens, height, threshold : as in `fit_ground`

    Raises
    ------
    InputError
        As `start_camera`, or if a mark is as high as the camera.
    """
    if points.z is None:
        return points
    flat = replace(points, z=None)
    for limit in (BENT * threshold, threshold, threshold):
        fit, _ = start_camera(flat, limit, lens or weak_prior(image_size), height)
        *position, down = fit.theta[-3:]
        if (points.z <= down).any():
            name = points.names[int(points.z.argmin())]
            raise InputError(f"control point {name}: its z is above the camera, {-down:.1f} m high; check z")
        stretch = down / (down - points.z)
        flat = replace(flat, ground=position + stretch[:, None] * (points.ground - position))
    log.warning(
        "%d marks lie off the road by up to %g m (z): taken as the road in line with them, seen from a camera %.1f m "
        "above it", (points.z != 0).sum(), np.abs(points.z).max(), -down,
    )  # fmt: skip
    return flat


def _subsets(points: ControlPoints, threshold: float) -> list[Mask]:
    """All points, and those near one homography."""
    every = np.ones(len(points), bool)
    to_image = magsac(points.ground, points.pixels, BENT * threshold)
    if to_image is None or len(points) < ROBUST_FROM:
        return [every]
    model = HomographyModel(Scaling.of(points.ground, points.pixels), None)
    near = agree(model.view(model.start(to_image)), points, BENT * threshold)
    return [every] if near.all() or near.sum() < most(len(points)) else [every, near]


def _poses(
    points: ControlPoints, prior: LensPrior, height: tuple[float, float] | None
) -> list[tuple[CameraModel, Array]]:
    """Cameras above the road that see the points about right (IPPE, Collins & Bartoli 2014)."""
    import cv2

    ground = np.column_stack([points.ground, np.zeros(len(points))])
    found = []
    for lens in _lenses(prior):
        _, turns, shifts, _ = cv2.solvePnPGeneric(
            ground, points.pixels, lens.matrix, np.array(lens.distortion), flags=cv2.SOLVEPNP_IPPE
        )
        for turn, shift in zip(turns, shifts, strict=True):
            rotation = rotation_by(np.asarray(turn, float).ravel())
            position = np.asarray(-rotation.T @ shift.ravel(), float)
            if np.isfinite(position).all() and position[2] < 0:
                model = CameraModel(prior, rotation, height)
                found.append((model, model.start(lens, position)))
    return found


def _lenses(prior: LensPrior) -> list[Lens]:
    if prior.known:
        return [prior.lens(np.zeros(prior.size))]
    return [prior.lens(np.eye(prior.size)[0] * deviation) for deviation in FOCALS]


def _cost(model: GroundModel, theta: Array, points: ControlPoints) -> float:
    errors = model.view(theta).errors(points) / points.sigma
    return float(np.log1p((errors / 2) ** 2).sum())
