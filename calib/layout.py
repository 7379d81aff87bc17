"""Check that control points can determine a view and lie where the camera can see them."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib.control_points import ControlPoints
from vision.camera import Calibration
from vision.contract import InputError

Array = NDArray[np.float64]
THIN = 0.01  # width over length below which a set of points counts as one line
FEWEST = 4
HANDED = (
    "y must be to the right of +x seen from above; where x points right and y ahead give --axes right,ahead, where y "
    "points left ahead,left, and east,north for these (or exchange the columns, or the sign of y)"
)
MIRRORED = f"control points: mirrored; {HANDED}"


def require_layout(points: ControlPoints, image_size: tuple[int, int]) -> None:
    """Raise InputError for too few points, points outside the image, or (all but one) collinear ones."""
    if len(points) < FEWEST:
        raise InputError(
            f"control points: {len(points)} given; a homography or camera needs at least 4 (6 to find a mistake)"
        )
    outside = ~((points.pixels >= 0) & (points.pixels <= np.array(image_size))).all(axis=1)
    if outside.any():
        raise InputError(
            f"control point {_names(points, outside)}: outside the {image_size[0]}x{image_size[1]} image; "
            "check px, py or the image size"
        )
    require_spread(points)


def require_spread(points: ControlPoints) -> None:
    """Raise InputError if all points, or all but one, are on a line."""
    if flaw := flaw_of(points):
        raise InputError(f"control points: {flaw}; add marks to the side of that line, as on the other curb")


def flaw_of(points: ControlPoints) -> str | None:
    """Say what keeps the points from determining a homography: it takes four of which no three are collinear."""
    for values, place in ((points.pixels, "in the image"), (points.ground, "on the ground")):
        if _thin(values):
            return f"collinear {place}"
        if any(_thin(np.delete(values, index, axis=0)) for index in range(len(values))):
            return f"all but one collinear {place}"
    return None


def on_a_line(points: ControlPoints) -> bool:
    """Whether all points are collinear."""
    return _thin(points.pixels) or _thin(points.ground)


def _thin(values: Array) -> bool:
    singular = np.linalg.svd(values - values.mean(axis=0), compute_uv=False)
    return bool(singular[1] <= THIN * singular[0])


def require_below_horizon(points: ControlPoints, homography: Array, ideal: Array) -> None:
    """Refuse points that a homography puts behind the camera or beyond the horizon, and a mirrored frame.

    Parameters
    ----------
    homography : [3, 3], ideal pixels -> ground
    ideal : [point, 2], ideal pixels of the points
    """
    depth = np.column_stack([ideal, np.ones(len(ideal))]) @ homography[2]
    side = np.sign(np.median(depth))
    beyond = np.asarray(depth * side <= 0)
    if beyond.any():
        raise InputError(
            f"control point {_names(points, beyond)}: above the horizon that the other points imply; "
            "only marks on the road plane can be used"
        )
    if np.linalg.det(homography) * side < 0:
        raise InputError(MIRRORED)


def require_on_road(points: ControlPoints, calibration: Calibration) -> None:
    """Refuse points whose pixels the calibration finds above the horizon."""
    lost = np.isnan(calibration.to_ground(points.pixels)).any(axis=1)
    if lost.any():
        raise InputError(
            f"control point {_names(points, lost)}: above the horizon that the other points imply; "
            "only marks on the road plane can be used"
        )


def _names(points: ControlPoints, which: Any) -> str:
    return ", ".join(points.select(which).names)
