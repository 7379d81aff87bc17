"""Fit the view of the road plane to control points: homography or camera, whichever predicts better."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from calib.calibrated import calibration_of, leave_one_out
from calib.cautions import cautions
from calib.control_points import ControlPoints
from calib.estimate import Estimate, scatters_more, slope_of, whitening
from calib.homography import inverse
from calib.layout import require_below_horizon, require_layout, require_on_road, require_spread
from calib.lens_prior import LensPrior, weak_prior
from calib.starts import ROBUST_FROM, start_camera, start_homography
from vision.camera import Calibration
from vision.contract import InputError, LocalFrame

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
THRESHOLD = 5.0  # px; a mark with a larger error is left out
BEYOND_CHANCE = 2.0  # standard errors by which a homography must predict better than a camera
ROUNDING = 1e-6  # redundancy that counts as zero
Model = Literal["auto", "homography", "camera"]
MODELS: tuple[Model, ...] = ("auto", "homography", "camera")


@dataclass(frozen=True)
class Candidate:
    """One model fitted to the control points.

    Attributes
    ----------
    fit : to the points used
    used : [point]; False where the point was left out as an outlier
    calibration : of the fit, complete
    errors_px : [point], of all points
    held_out_px : [point], error of each point as the others predict it (for points left out, as all used do);
        None where the points cannot be checked so
    """

    fit: Estimate
    used: Mask
    calibration: Calibration
    errors_px: Array
    held_out_px: Array | None

    @property
    def redundancy(self) -> float:
        """Redundancy: equations of the points used minus the parameters that they decide."""
        return 2 * float(self.used.sum()) - self.fit.decided


@dataclass(frozen=True)
class GroundFit:
    """A calibration and its assessment.

    Attributes
    ----------
    calibration : homography or camera, the control points it was fitted to, their residuals
    used : [point] of all control points given; False where the point was left out as an outlier
    residuals_px, residuals_m : [point], of all control points given
    held_out_px : [point], error of each point as the others predict it, or None
    worst_sigma : m; largest standard deviation of the ground position of a pixel known exactly, over the corners of
        the surveyed area
    decided : how many parameters the points decide, for every model that fits
    scores : root mean square of the held-out errors, px, of every model tried, or why it has none
    warnings : one line each
    """

    calibration: Calibration
    used: Mask
    residuals_px: Array
    residuals_m: Array
    held_out_px: Array | None
    worst_sigma: float
    decided: dict[str, float]
    scores: dict[str, float | str]
    warnings: tuple[str, ...]


def fit_ground(
    points: ControlPoints,
    image_size: tuple[int, int],
    *,
    model: Model = "auto",
    threshold: float = THRESHOLD,
    frame: LocalFrame | None = None,
    lens: LensPrior | None = None,
    height: tuple[float, float] | None = None,
) -> GroundFit:
    """Fit a homography or a camera to control points.

    From six points on, those further than `threshold` from where the others put them are left out (MAGSAC++, Barath
    et al. 2020, for the homography; a Cauchy loss for the camera). Then the pixel errors over their sigma, squared,
    are minimized: the maximum likelihood for pixels read with a Gaussian error (Hartley & Zisserman 2004, section
    4.3), for the camera with priors. `auto` takes the camera, unless the homography's leave-one-out errors, px, are
    smaller beyond chance (errors of the fit itself always favor the model with more freedom), or it alone fits.

    Parameters
    ----------
    points : at least four, no line through all of them or all but one
    image_size : width, height, px
    threshold : px
    frame : origin and azimuth to note in the file
    lens : prior of the lens; by default that of an ordinary lens
    height : of the camera above the road and its standard deviation, m

    Raises
    ------
    InputError
        Too few points, collinear ones, some above the horizon of the others, a mirrored frame, pixels outside the
        image, or no model that most of them agree with.

    Examples
    --------
    >>> import numpy as np
    >>> from calib.control_points import control_points
    >>> pixels = np.array([[100.0, 400], [500, 400], [250, 250], [350, 250], [300, 300]])
    >>> straight_down = pixels[:, ::-1] * [-0.1, 0.1]
    >>> points = control_points(tuple("abcde"), pixels, straight_down)
    >>> fit_ground(points, (640, 480), model="homography").calibration.to_ground([[50, 100]]).round(6).tolist()
    [[-10.0, 5.0]]
    """
    require_layout(points, image_size)
    tried: dict[str, Candidate | InputError] = {}
    for name in ("homography", "camera") if model == "auto" else (model,):
        try:
            tried[name] = _candidate(name, points, image_size, threshold, frame, lens, height)
        except InputError as error:
            tried[name] = error
    fitted = {name: found for name, found in tried.items() if isinstance(found, Candidate)}
    errors = [found for found in tried.values() if isinstance(found, InputError)]
    # A camera fits so few points whatever they are: if no homography fits, a point is wrong; it is not the lens.
    if errors and (not fitted or len(points) < ROBUST_FROM):
        raise errors[0]
    scores = _scores(fitted)
    best = fitted[_choice(fitted)]
    residuals_m = np.linalg.norm(best.calibration.to_ground(points.pixels) - points.ground, axis=1)
    worst, dilution = _uncertainty(best, points.select(best.used))
    messages = cautions(points, best.used, best.errors_px, residuals_m, best.calibration, best.fit, dilution)
    return GroundFit(
        calibration=best.calibration,
        used=best.used,
        residuals_px=best.errors_px,
        residuals_m=residuals_m,
        held_out_px=best.held_out_px,
        worst_sigma=worst,
        decided={name: found.fit.decided for name, found in fitted.items()},
        scores=scores | {name: str(found) for name, found in tried.items() if isinstance(found, InputError)},
        warnings=(*messages, *_bent(fitted, best)),
    )


def _candidate(
    name: str,
    points: ControlPoints,
    image_size: tuple[int, int],
    threshold: float,
    frame: LocalFrame | None,
    lens: LensPrior | None,
    height: tuple[float, float] | None,
) -> Candidate:
    if name == "homography":
        fit, used = start_homography(points, threshold, lens)
    else:
        fit, used = start_camera(points, threshold, lens or weak_prior(image_size), height)
    kept = points.select(used)
    require_spread(kept)
    ideal = kept.pixels if fit.view.lens is None else fit.view.lens.undistort(kept.pixels)
    require_below_horizon(kept, inverse(fit.view.to_image), ideal)
    calibration = calibration_of(fit, kept, image_size, frame)
    if name == "homography":
        require_on_road(points, calibration)
    held_out_px = None
    in_pixels, in_meters, expected = leave_one_out(fit, kept, image_size)
    if np.isfinite(in_pixels).any():
        held_out_px = fit.errors(points)
        held_out_px[used] = in_pixels
        both = {"leave_one_out_m": _known(in_meters), "leave_one_out_sigma_m": _known(expected)}
        calibration = calibration.model_copy(update=both)
    return Candidate(fit, used, calibration, fit.errors(points), held_out_px)


def _known(values: Array) -> tuple[float | None, ...]:
    return tuple(float(value) if np.isfinite(value) else None for value in values)


def _scores(fitted: dict[str, Candidate]) -> dict[str, float | str]:
    """Root mean square of the held-out errors, px, over the points that any model uses."""
    judged = np.any([found.used for found in fitted.values()], axis=0)
    return {
        name: "too few points to leave one out"
        if found.held_out_px is None or not np.isfinite(found.held_out_px[judged]).all()
        else float(np.sqrt(np.mean(found.held_out_px[judged] ** 2)))
        for name, found in fitted.items()
    }


def _choice(fitted: dict[str, Candidate]) -> str:
    """Name the model to take.

    First, redundant equations must check the model (four points give as many equations as a homography has parameters;
    for a camera, the lens prior decides some). Second, a homography is a camera with a lens known to be free of
    distortion, which nobody knows. Where noise hides the distortion, a homography predicts the points as well, or by
    chance better, but errs between them by more than its sigma: when it was chosen whenever its held-out errors were
    smaller, 95 % ellipses covered 92 % (`benchmarks/calibration.py`). So its errors must be smaller beyond chance, or
    the points must fit a homography and no camera, as in pictures that were squeezed or rectified.
    """
    checked = {name: found for name, found in fitted.items() if found.redundancy > ROUNDING}
    if len(checked) < 2:
        return next(iter(checked or fitted))
    homography, camera = checked["homography"], checked["camera"]
    if scatters_more(camera.fit, homography.fit):
        return "homography"
    if homography.held_out_px is None or camera.held_out_px is None:
        return "camera"
    judged = (homography.used | camera.used) & np.isfinite(homography.held_out_px) & np.isfinite(camera.held_out_px)
    return (
        "homography" if smaller_beyond_chance(homography.held_out_px[judged], camera.held_out_px[judged]) else "camera"
    )


def smaller_beyond_chance(errors: Array, others: Array) -> bool:
    """Whether the mean square of errors [n] is below that of others [n], of the same points, beyond chance.

    That is by two standard errors or, with few points, by the equivalent in Student's t.

    >>> noise = np.random.default_rng(0).normal(size=(2, 20))
    >>> smaller_beyond_chance(noise[0], noise[1]), smaller_beyond_chance(noise[0], 2 + noise[0])
    (False, True)
    """
    from scipy.stats import norm, t

    gain = others**2 - errors**2
    if len(gain) < 2:
        return False
    most = t.isf(norm.sf(BEYOND_CHANCE), len(gain) - 1) * gain.std(ddof=1) / np.sqrt(len(gain))
    return bool(gain.mean() > most)


def _uncertainty(best: Candidate, points: ControlPoints) -> tuple[float, float]:
    """Largest standard deviation over the corners of the surveyed area: m on the ground, and px over a mark's own."""
    ground = points.ground
    low, high = ground.min(axis=0), ground.max(axis=0)
    corners = np.array([[x, y] for x in (low[0], high[0]) for y in (low[1], high[1])])
    pixels = best.fit.view.project(corners)
    corners, pixels = corners[np.isfinite(pixels).all(axis=1)], pixels[np.isfinite(pixels).all(axis=1)]
    by_theta = slope_of(lambda theta: best.fit.model.view(theta).project(corners), best.fit.theta, best.fit.covariance)
    in_pixels = by_theta @ (best.fit.covariance) @ by_theta.transpose(0, 2, 1)
    typical = float(np.median(np.linalg.norm(np.linalg.inv(whitening(best.fit.view, points)), 2, axis=(1, 2))))
    on_ground = best.calibration.position_covariance(pixels)
    return _largest(on_ground), _largest(in_pixels) / typical


def _largest(covariance: Array) -> float:
    """Largest principal standard deviation among covariances [n, 2, 2]."""
    covariance = covariance[np.isfinite(covariance).all(axis=(1, 2))]
    return float(np.sqrt(np.linalg.eigvalsh(covariance)[:, 1].max())) if len(covariance) else np.inf


def _bent(fitted: dict[str, Candidate], best: Candidate) -> list[str]:
    """Warn of a lens that bends the picture more than a homography can bear."""
    camera = fitted.get("camera")
    if camera is None or camera.calibration.lens is None:
        return []
    pixels = np.array([(point.u, point.v) for point in camera.calibration.control_points])
    bend = float(np.max(np.linalg.norm(camera.calibration.lens.undistort(pixels) - pixels, axis=1)))
    if best is camera and bend > 5.0:
        return [f"the lens bends the picture by up to {bend:.0f} px at the points; measure it with calibrate board"]
    return []
