"""Report how good a calibration is: a table for people, a dict for machines."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib.control_points import ControlPoints
from calib.ground import GroundFit
from vision.contract.rounding import with_sigma

Array = NDArray[np.float64]


def summary(points: ControlPoints, fit: GroundFit) -> dict[str, Any]:
    """Everything the command found, JSON-ready; lengths in px or m as the keys say."""
    calibration = fit.calibration
    held_out_m, expected_m = (
        _spread(fit, values) for values in (calibration.leave_one_out_m, calibration.leave_one_out_sigma_m)
    )
    held_out_px = np.full(len(points), np.nan) if fit.held_out_px is None else fit.held_out_px
    return {
        "model": calibration.model,
        "leave_one_out_rms_px_by_model": fit.scores,
        "homography": calibration.homography.tolist(),
        "lens": calibration.lens and calibration.lens.model_dump(),
        "parameters": {name: value.model_dump() for name, value in calibration.parameters.items()},
        "image_size": list(calibration.image_size),
        "origin": calibration.origin,
        "x_azimuth": calibration.x_azimuth,
        "rms_px": _rms(fit.residuals_px[fit.used]),
        "rms_m": _rms(fit.residuals_m[fit.used]),
        "leave_one_out_rms_px": _number(_rms(held_out_px[fit.used])),
        "leave_one_out_rms_m": _number(_rms(held_out_m[fit.used])),
        "leave_one_out_sigma_m": _number(_rms(expected_m[fit.used])),
        "equations": 2 * int(fit.used.sum()),
        "decided": fit.decided,
        "worst_sigma_m": fit.worst_sigma,
        "warnings": list(fit.warnings),
        "points": [
            {
                "name": name,
                "used": bool(used),
                "residual_px": _number(px),
                "residual_m": _number(m),
                "leave_one_out_px": _number(out_px),
                "leave_one_out_m": _number(out_m),
                "leave_one_out_sigma_m": _number(expected),
            }
            for name, used, px, m, out_px, out_m, expected in zip(
                points.names,
                fit.used,
                fit.residuals_px,
                fit.residuals_m,
                held_out_px,
                held_out_m,
                expected_m,
                strict=True,
            )
        ],
    }


def _spread(fit: GroundFit, values: tuple[float | None, ...] | None) -> Array:
    """Spread the values of the points used over all points [point], NaN for the others."""
    spread = np.full(len(fit.used), np.nan)
    spread[fit.used] = np.nan if values is None else np.array(values, float)
    return spread


COLUMNS = {
    "residual_px": ("residual px", 2),
    "residual_m": ("residual m", 3),
    "leave_one_out_px": ("leave-one-out px", 2),
    "leave_one_out_m": ("leave-one-out m", 3),
    "leave_one_out_sigma_m": ("expected m", 3),
}
TOTALS = {
    "residual_px": "rms_px",
    "residual_m": "rms_m",
    "leave_one_out_px": "leave_one_out_rms_px",
    "leave_one_out_m": "leave_one_out_rms_m",
    "leave_one_out_sigma_m": "leave_one_out_sigma_m",
}


def table(points: ControlPoints, fit: GroundFit) -> str:
    """Lines of text: one per point, the totals, the camera, the warnings."""
    facts = summary(points, fit)
    width = max(5, *(len(name) for name in points.names))
    lines = [f"{'point':<{width}}  " + "  ".join(title for title, _ in COLUMNS.values())]
    for row in facts["points"]:
        lines.append(f"{row['name']:<{width}}  {_cells(row)}" + ("" if row["used"] else "  left out"))
    totals = {key: facts[TOTALS[key]] for key in COLUMNS}
    lines.append(f"{'rms':<{width}}  {_cells(totals)}")
    lines.append(f"model: {facts['model']}; leave-one-out rms {scores_text(fit)}")
    lines.append(
        f"{facts['equations']} equations; the points decide {facts['decided'][facts['model']]:.1f} numbers{_prior(fit)}"
    )
    for name, value in facts["parameters"].items():
        lines.append(f"  {name:<9} {with_sigma(value['value'], value['sigma']):>17} {value['unit']}")
    lines.append(f"uncertainty within the surveyed area: {facts['worst_sigma_m']:.3f} m at most (one sigma)")
    return "\n".join(lines + [f"warning: {message}" for message in fit.warnings])


def _prior(fit: GroundFit) -> str:
    return ", and what lenses are like the others" if fit.calibration.parameters else ""


def _cells(row: dict[str, Any]) -> str:
    return "  ".join(
        f"{'-' if row[key] is None else format(row[key], f'.{digits}f'):>{len(title)}}"
        for key, (title, digits) in COLUMNS.items()
    )


def scores_text(fit: GroundFit) -> str:
    """Leave-one-out errors of the models tried, in words."""
    parts = [
        f"{name} {score:.2f} px" if isinstance(score, float) else f"{name}: {score}"
        for name, score in fit.scores.items()
    ]
    numbers = {name: score for name, score in fit.scores.items() if isinstance(score, float)}
    if fit.calibration.model == "camera" and numbers and min(numbers, key=numbers.__getitem__) != "camera":
        parts[-1] += " (no larger than chance makes it)"
    return ", ".join(parts)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
