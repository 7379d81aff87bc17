"""What to add next to a calibration: a mark where the error is largest; and which mark to look at again."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.ground import GroundFit
from calib.maps import COARSEST, meters_per_pixel, pixel_lattice
from vision.camera import Calibration

Array = NDArray[np.float64]

#: px; error that a mark is clicked with, and m; that its place is measured with.
CLICKED, MEASURED = 1.0, 0.03
#: Places across the picture that are looked at.
CELLS = 48
#: m; the error below which no mark is worth adding; and times the expected leave-one-out error that is too much.
SMALL, ODD = 0.1, 3.0
#: Share of the error that a mark must take away to be worth adding, and m.
LITTLE, LEAST = 0.15, 0.03


@dataclass(frozen=True)
class Advice:
    """A mark worth adding.

    Parameters
    ----------
    x, y : where, m
    pixel : where in the picture, px
    before, after : largest standard deviation there without it and with it, m
    """

    x: float
    y: float
    pixel: tuple[float, float]
    before: float
    after: float


def next_mark(view: Calibration) -> Advice | None:
    """Where in the surveyed area one more mark would lower the error most, and what it would make of it.

    With the covariance C of the place by the calibration and R of the mark itself, it is (1/C + 1/R)^-1 with the mark:
    the Kalman update at the mark's own place. None where there are no marks, or no mark would help.
    """
    if not view.control_points or view.covariance is None:
        return None
    pixels, _ = pixel_lattice(view.image_size, CELLS)
    ground, marks = view.to_ground(pixels), np.array([(point.x, point.y) for point in view.control_points])
    low, high = marks.min(0), marks.max(0)
    inside = np.isfinite(ground).all(1) & (ground >= low).all(1) & (ground <= high).all(1)
    inside &= meters_per_pixel(view, pixels) < COARSEST
    if not inside.any():
        return None
    pixels, ground = pixels[inside], ground[inside]
    known, slope = view.position_covariance(pixels), view.jacobian(pixels)
    mark = CLICKED**2 * slope @ slope.transpose(0, 2, 1) + MEASURED**2 * np.eye(2)
    before, after = map(largest, (known, known @ np.linalg.solve(known + mark, mark)))
    best = int((before - after).argmax())
    if not (before.max() > SMALL and before[best] - after[best] > max(LITTLE * before[best], LEAST)):
        return None
    (x, y), (u, v) = ground[best].tolist(), pixels[best].tolist()
    return Advice(x, y, (u, v), float(before[best]), float(after[best]))


def largest(covariance: Array) -> Array:
    """Largest principal standard deviation [n] of covariances [n, 2, 2]."""
    return np.asarray(np.sqrt(np.linalg.norm(covariance, ord=2, axis=(1, 2))))


def side_words(pixel: tuple[float, float], size: tuple[int, int]) -> str:
    """Where in a picture that is.

    >>> side_words((10.0, 20.0), (640, 360)), side_words((320.0, 350.0), (640, 360))
    ('at the upper left of the picture', 'at the bottom of the picture')
    """
    across = ("left", "", "right")[min(int(3 * pixel[0] / size[0]), 2)]
    down = ("upper", "middle", "lower")[min(int(3 * pixel[1] / size[1]), 2)]
    if across:
        return f"at the {down} {across} of the picture"
    return {"upper": "at the top", "middle": "in the middle", "lower": "at the bottom"}[down] + " of the picture"


def odd_marks(fit: GroundFit) -> list[tuple[str, float, float]]:
    """Marks by their leave-one-out error, the largest first: name, error, and what is expected of it, m."""
    names = [point.name for point in fit.calibration.control_points]
    found = fit.calibration.leave_one_out_m or ()
    stated = fit.calibration.leave_one_out_sigma_m or (None,) * len(found)
    rows = [
        (name, float(off), np.nan if sigma is None else float(sigma))
        for name, off, sigma in zip(names, found, stated, strict=True)
        if off is not None
    ]
    return sorted(rows, key=lambda row: -row[1])


def advice_lines(fit: GroundFit) -> list[str]:
    """What to do next, a sentence each."""
    lines, rows = list[str](), odd_marks(fit)
    doubtful = [row for row in rows if row[1] > ODD * row[2]]
    if doubtful:
        name, off, expected = max(doubtful, key=lambda row: row[1] / row[2])
        lines.append(
            f"Look at {name or 'the unnamed mark'} again: the others put it {off:.2f} m away, where {expected:.2f} m "
            "is expected. Is it the same mark in the picture and on the road?"
        )
    if (one := next_mark(fit.calibration)) is not None:
        where = side_words(one.pixel, fit.calibration.image_size)
        lines.append(
            f"Add a mark {where}, near x = {one.x:.0f} m, y = {one.y:.1f} m: "
            f"the error there would go from {one.before:.2f} to {one.after:.2f} m (1 sigma)."
        )
    return lines or ["Nothing: no mark is out of line, and one more would lower the error little."]
