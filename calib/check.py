"""Check a calibration on a frame: grid and horizon over the picture, known lengths predicted against measured."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib.lengths import Lengths, Predicted
from calib.lens_prior import weak_prior
from calib.maps import meters_per_pixel, pixel_lattice, seen_area
from calib.picture import (
    GREEN,
    LABEL,
    MAGENTA,
    RED,
    draw_grid,
    draw_horizon,
    draw_line,
    draw_point,
    enlarged,
    write_at,
    write_note,
)
from vision.camera import Calibration
from vision.contract.rounding import with_sigma

Array = NDArray[np.float64]
Image = NDArray[np.uint8]
SUSPECT = 3.0  # standard deviations that a length may be off
REACH = 80.0  # m; largest distance of the grid


def draw_check(image: Image, calibration: Calibration, lengths: Lengths | None, found: Predicted | None) -> Image:
    """Draw grid, horizon, control points and known lengths on a copy of a frame [height, width, 3]."""
    canvas, scale = enlarged(image)
    draw_grid(canvas, calibration, grid_area(calibration), scale)
    shown = draw_horizon(canvas, calibration, scale)
    for point in calibration.control_points:
        draw_point(canvas, point.name, scale * np.array([point.u, point.v]), GREEN)
    if lengths is not None and found is not None:
        for index in range(len(lengths)):
            good = abs(found.length[index] - lengths.length[index]) <= SUSPECT * found.sigma[index]
            color = GREEN if good else RED
            ends = scale * lengths.ends[index]
            draw_line(canvas, ends, color, 2)
            text = f"{lengths.names[index]}: {found.length[index]:.2f} m ({lengths.length[index]:g})"
            write_at(canvas, text, ends.mean(axis=0) + np.array([8, 0]), color, LABEL)
    words = "magenta: horizon" if shown else "the horizon is outside the picture"
    write_note(canvas, f"grid 10 x 2 m; {words}", MAGENTA)
    return canvas


def grid_area(calibration: Calibration) -> Array:
    """Corners [2, 2], m, of the grid: around the control points, or the visible road within `REACH`."""
    if calibration.control_points:
        return np.array([(point.x, point.y) for point in calibration.control_points])
    low, high = seen_area(calibration)
    middle = np.nanmedian(calibration.to_ground(pixel_lattice(calibration.image_size, 20)[0]), axis=0)
    return np.clip(np.stack([low, high]), middle - REACH / 2, middle + REACH / 2)


def facts(calibration: Calibration, lengths: Lengths | None, found: Predicted | None) -> dict[str, Any]:
    """What the check found, JSON-ready."""
    pixels, _ = pixel_lattice(calibration.image_size, 40)
    scale = meters_per_pixel(calibration, pixels)
    camera = calibration.pinhole()
    result: dict[str, Any] = {
        "model": calibration.model,
        "image_size": list(calibration.image_size),
        "road_share": float(np.isfinite(scale).mean()),
        "finest_m_per_px": float(np.nanmin(scale)) if np.isfinite(scale).any() else None,
        "has_covariance": calibration.covariance is not None,
        "camera_height_m": None if camera is None else float(-camera.position[2]),
        "camera_focal_px": None if camera is None else float(camera.focal),
        "camera_doubt": None
        if calibration.lens is None
        else weak_prior(calibration.image_size).doubt(calibration.lens),
        "lengths": [],
    }
    if lengths is None or found is None:
        return result
    result["lengths"] = [
        {
            "name": name,
            "measured_m": float(measured),
            "predicted_m": float(length),
            "sigma_m": float(sigma),
            "deviation": float((length - measured) / sigma),
        }
        for name, measured, length, sigma in zip(lengths.names, lengths.length, found.length, found.sigma, strict=True)
    ]
    weight = (lengths.length / found.sigma) ** 2
    result["scale"] = float((weight * found.length / lengths.length).sum() / weight.sum())
    result["scale_sigma"] = float(weight.sum() ** -0.5)
    return result


def words(found: dict[str, Any]) -> str:
    """Lines of text of `facts`."""
    seen = found["finest_m_per_px"]
    lines = [f"{found['model']}; road in {found['road_share']:.0%} of the picture, {seen:.3f} m per pixel at best"]
    if found["camera_height_m"] is not None:
        lines.append(f"camera {found['camera_height_m']:.1f} m above the road, focal {found['camera_focal_px']:.0f} px")
    if found["camera_doubt"]:
        lines.append(
            f"warning: {found['camera_doubt']}: right only if the picture is cropped, or the lens was measured"
        )
    if not found["has_covariance"]:
        lines.append("the file has no covariance: fit it again to know its uncertainty")
    if not found["lengths"]:
        return "\n".join(lines)
    width = max(6, *(len(row["name"]) for row in found["lengths"]))
    lines.append(f"{'length':<{width}}  measured m  predicted m  sigma m  off, sigmas")
    for row in found["lengths"]:
        lines.append(
            f"{row['name']:<{width}}  {row['measured_m']:10.2f}  {row['predicted_m']:11.2f}  {row['sigma_m']:7.2f}  "
            f"{row['deviation']:+11.1f}"
        )
    lines.append(f"scale {with_sigma(found['scale'], found['scale_sigma'])} (predicted over measured)")
    if wrong := [row["name"] for row in found["lengths"] if abs(row["deviation"]) > SUSPECT]:
        lines.append(
            f"warning: {', '.join(wrong)} over {SUSPECT:g} sigmas off: the calibration, the ends or the length"
        )
    return "\n".join(lines)
