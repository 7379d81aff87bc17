"""How large the tracks' slow errors may be where a fit's model is questioned."""

from typing import TYPE_CHECKING

import torch
from torch import Tensor

from solver.criticism.marginal import Spectrum, mixture
from solver.criticism.policy import POLICY
from solver.fit.map_fit import SPLINE_VARIANCE, MapFit
from solver.trajectory.trajectory_effects import SLOW_ERROR
from solver.trajectory.vehicle_pass import track_sigma

if TYPE_CHECKING:
    from solver.criticism.directions import Directions

#: Least slow error of a track, m, however small it says that it is.
SMALLEST = 0.01
#: How well a number of a slow error is known where no row of the track tells, over how well in view.
LEAST_KNOWN = 1e-6
#: Sizes of slow errors that are as probable: what the tracks say, down to a negligible share of it.
SCALES = (1.0, POLICY.negligible**0.5, POLICY.negligible)


def slow_precision(fit: MapFit) -> Tensor:
    """Inverse covariance [number, number], 1/m^2, of the tracks' slow errors along and then across travel.

    Each row's error is as the track has it there, rows a knot apart being independent: a number of the spline that
    reaches out of view, where a vehicle may slow down or speed up, is held by the rows in view all the same.
    """
    extension = fit.problem.extension([*fit.extension.effects, SLOW_ERROR])
    assert extension.scopes is not None
    spread, traffic = extension.scopes.along("track"), fit.path.with_effects(extension).traffic
    cosine, sine = (traffic.heading**2).unbind(-1)
    x, y = (traffic.sigma**2).unbind(-1)
    usual = max(track_sigma(fit.problem.passes), SMALLEST) ** 2
    total = spread.sum(0)
    each = spread / torch.where(total > 0, total, 1.0).sqrt()
    held = [each.T @ (each / way.clamp_min(usual)[:, None]) for way in (cosine * x + sine * y, sine * x + cosine * y)]
    least = LEAST_KNOWN * SPLINE_VARIANCE / usual
    return torch.block_diag(*held) + least * torch.eye(2 * len(total), dtype=torch.float64)


def slow_evidence(at: "Directions", variance: float) -> float:
    """Ln of the Bayes factor of the tracks' slow errors at the end of a fit without them; 0 of a fit that has them.

    They may be as large as the tracks say, or smaller: out of view a vehicle may speed up, and mostly does not.

    Parameters
    ----------
    at : what was fitted, where it ended
    variance : that the noise counts as
    """
    left = at.slow_left
    if left is None:
        return 0.0
    # A root [number, way], m, of their covariance.
    root = torch.linalg.inv(torch.linalg.cholesky(slow_precision(at.fit))).T
    spectrum = Spectrum.of_plausible(root.T @ left.information @ root, root.T @ left.score)
    return mixture([spectrum.scaled(variance, scale) for scale in SCALES])
