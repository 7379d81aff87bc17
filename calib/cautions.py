"""Warnings about a calibration: outliers, points that nothing checks, weak layouts, misfit."""

import numpy as np
from numpy.typing import NDArray

from calib.control_points import ControlPoints
from calib.estimate import Estimate
from vision.camera import Calibration

Array = NDArray[np.float64]
WEAK = 5.0  # ratio of the uncertainties of a projected pixel and a control point from which on to warn
BRITTLE, LARGE = 4.0, 0.5  # leave-one-out error over fit error, and in m, that together cause a warning


def cautions(
    points: ControlPoints,
    used: NDArray[np.bool_],
    errors_px: Array,
    errors_m: Array,
    calibration: Calibration,
    fit: Estimate,
    dilution: float,
) -> list[str]:
    """One line each.

    Parameters
    ----------
    points, used : all control points; [point], False where left out
    errors_px, errors_m : [point], of the fit
    calibration : with the leave-one-out errors of the points used, if known
    fit : from which the calibration was made
    dilution : largest sd of the fit over the surveyed area, sigmas of a control point
    """
    messages = []
    if not used.all():
        names = ", ".join(points.select(~used).names)
        messages.append(f"left out as outliers: {names}; check their pixels and places")
    if used.sum() == 4:
        messages.append(
            f"four points are 8 equations, of which the {fit.model.name} takes {fit.decided:.1f}: nothing checks them, "
            "and a misread one would not show; add more"
        )
    elif calibration.leave_one_out_m is None:
        messages.append("without any one of the points the others no longer determine the view; add more")
    else:
        messages += brittle(calibration.leave_one_out_m, calibration.leave_one_out_sigma_m or (), errors_m[used])
    prior, lens = fit.model.prior, calibration.lens
    if prior is not None and lens is not None and (doubt := prior.doubt(lens)):
        messages.append(f"{doubt}: a cropped picture, or misread points")
    if dilution > WEAK:
        messages.append(
            f"the layout is weak: at the edge of the surveyed area pixels are {dilution:.0f} times as uncertain as a "
            "control point; spread the points over the road, near and far, left and right"
        )
    if fit.excess > 1:
        rms, worse = float(np.sqrt(np.mean(errors_px[used] ** 2))), float(np.sqrt(fit.excess))
        messages.append(
            f"the points fit to {rms:.1f} px only, {worse:.1f} times worse than their sigma says: a misread point, an "
            f"uneven road or {'more' if calibration.lens else 'a'} lens distortion; sigmas are enlarged for it"
        )
    return messages


def brittle(left_out: tuple[float | None, ...], expected: tuple[float | None, ...], errors: Array) -> list[str]:
    """What errors of points left out one at a time say: nothing where the fit holds them, too; m."""
    known = np.array([value for value in left_out if value is not None])
    if len(known) < len(left_out):
        count = len(left_out) - len(known)
        return [f"without {count} of the points, one at a time, the others cannot place it; add points near and far"]
    held_out, stated, fitted = (
        float(np.sqrt(np.nanmean(np.array(values, float) ** 2))) for values in (left_out, expected, errors)
    )
    if held_out <= max(BRITTLE * fitted, LARGE):
        return []
    return [
        f"leave-one-out errors of {held_out:.2f} m ({stated:.2f} m expected of so few), {known.max():.1f} m at most, "
        f"against a fit within {fitted:.2f} m: every point bears much, and a misread one would hardly show; add points "
        "between and beyond"
    ]
