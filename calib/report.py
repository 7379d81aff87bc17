"""Say how good a calibration is: as a table for people, as a dict for machines."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib.control_points import ControlPoints
from calib.ground import GroundFit

Array = NDArray[np.float64]


def summary(points: ControlPoints, fit: GroundFit) -> dict[str, Any]:
    """Everything the command found, JSON-ready; lengths in px or m as the keys say."""
    held_out = iter(fit.calibration.leave_one_out_m or ())
    return {
        "homography": fit.calibration.homography.tolist(),
        "image_size": list(fit.calibration.image_size),
        "rms_px": _rms(fit.residuals_px[fit.used]),
        "rms_m": _rms(fit.residuals_m[fit.used]),
        "leave_one_out_rms_m": _rms(np.array(fit.calibration.leave_one_out_m))
        if fit.calibration.leave_one_out_m
        else None,
        "worst_sigma_m": fit.worst_sigma,
        "warnings": list(fit.warnings),
        "points": [
            {
                "name": name,
                "used": bool(used),
                "residual_px": float(px),
                "residual_m": float(m) if np.isfinite(m) else None,
                "leave_one_out_m": next(held_out, None) if used else None,
            }
            for name, used, px, m in zip(points.names, fit.used, fit.residuals_px, fit.residuals_m, strict=True)
        ],
    }


def table(points: ControlPoints, fit: GroundFit) -> str:
    """Lines of text: one per point, the totals, the warnings."""
    facts = summary(points, fit)
    width = max(5, *(len(name) for name in points.names))
    lines = [f"{'point':<{width}}  residual px   residual m  leave-one-out m"]
    for row in facts["points"]:
        numbers = f"{row['residual_px']:11.2f}  {_meters(row['residual_m']):>11}  {_meters(row['leave_one_out_m']):>15}"
        lines.append(f"{row['name']:<{width}}  {numbers}" + ("" if row["used"] else "  left out"))
    total = f"{facts['rms_px']:11.2f}  {facts['rms_m']:11.3f}  {_meters(facts['leave_one_out_rms_m']):>15}"
    lines.append(f"{'rms':<{width}}  {total}")
    lines.append(f"uncertainty within the surveyed area: {facts['worst_sigma_m']:.3f} m at most (one sigma)")
    return "\n".join(lines + [f"warning: {message}" for message in fit.warnings])


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _meters(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"
