"""How large the tracks' slow errors may be where a fit's model is questioned."""

import torch
from torch import Tensor

from solver.fit.map_fit import MapFit
from solver.trajectory.trajectory_effects import SLOW_ERROR
from solver.trajectory.vehicle_pass import track_sigma

#: Least slow error of a track, m, however small it says that it is.
SMALLEST = 0.01


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
