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
#: Sizes of slow errors that are as probable: what the tracks say, down to a negligible share of it.
SCALES = (1.0, POLICY.negligible**0.5, POLICY.negligible)


def slow_variance(fit: MapFit) -> Tensor:
    """Variance [number], m^2, of the tracks' slow errors along and then across travel, as the tracks have it there.

    Out of view, where a vehicle may slow down or speed up, that is far more than in view.
    """
    extension = fit.problem.extension([*fit.extension.effects, SLOW_ERROR])
    assert extension.scopes is not None
    spread, traffic = extension.scopes.along("track"), fit.path.with_effects(extension).traffic
    cosine, sine = (traffic.heading**2).unbind(-1)
    x, y = (traffic.sigma**2).unbind(-1)
    rows = torch.stack([cosine * x + sine * y, sine * x + cosine * y])
    total = spread.sum(0)
    usual = max(track_sigma(fit.problem.passes), SMALLEST) ** 2
    return (rows @ spread / total.where(total > 0, 1.0)).clamp_min(usual).flatten()


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
    spectrum = Spectrum.of(left.information, left.score, (slow_variance(at.fit) / SPLINE_VARIANCE).sqrt())
    return mixture([spectrum.scaled(variance, scale) for scale in SCALES])
