"""Strain rate of single vehicles at single gauges, and its derivatives with respect to all inputs: the chain rule."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import torch
from torch import Tensor

from solver.load.load import Load
from solver.signal_path.gauges import Gauges

#: Fields of `Vehicles` by which derivatives are kept for the weights of samples.
SHIFTS = ("along", "across")
#: Name, see `Load.tensors` -> derivative [row, channel, ...] of strain rate per unit amplitude.
ByLoad = Mapping[str, Tensor]


@dataclass(frozen=True)
class Sensitivities:
    """Strain rate of each vehicle alone, and its local derivatives.

    Parameters
    ----------
    amplitude : [row], m^2
    gauges, load : where the derivatives are taken
    alone : [row, channel], strain rate per unit amplitude, 1/(m^2 s)
    by_point, by_weight : [row, channel, point, 3], derivatives of that
    by_ratio : [row, channel, point], with respect to Poisson's ratio at the point
    by_load : with respect to the tensors of the loads
    by_vehicle : field of `Vehicles` -> [row, channel], with respect to what may be fitted about each vehicle
    """

    amplitude: Tensor
    gauges: Gauges
    load: Load
    alone: Tensor = field(repr=False)
    by_point: Tensor = field(repr=False)
    by_weight: Tensor = field(repr=False)
    by_ratio: Tensor = field(repr=False)
    by_load: ByLoad = field(repr=False)
    by_vehicle: Mapping[str, Tensor] = field(repr=False)

    @property
    def rate(self) -> Tensor:
        """Strain rate [row, channel], 1/s."""
        return self.amplitude[:, None] * self.alone

    @property
    def bytes(self) -> int:
        """Their size in memory."""
        own = (self.alone, self.by_point, self.by_weight, self.by_ratio)
        every = (*own, *self.by_load.values(), *self.by_vehicle.values())
        return sum(one.numel() * one.element_size() for one in every)

    @property
    def shifts(self) -> "Sensitivities":
        """Only the derivatives with respect to shifts of the vehicles, which amplitudes and sample weights need."""
        none = self.alone.new_zeros(0)
        by_vehicle = {name: self.by_vehicle[name] for name in SHIFTS}
        return replace(self, by_point=none, by_weight=none, by_ratio=none, by_load={}, by_vehicle=by_vehicle)

    @property
    def poisson_ratio(self) -> Tensor:
        """Derivative [row, channel] with respect to Poisson's ratio everywhere."""
        return self.amplitude[:, None] * self.by_ratio.sum(-1)

    def vehicle(self, name: str) -> Tensor:
        """Derivative [row, channel] with respect to a field of `Vehicles`."""
        return self.alone if name == "amplitude" else self.amplitude[:, None] * self.by_vehicle[name]

    def along_gauges(self, change: Gauges, among: Tensor | None = None) -> Tensor:
        """Directional derivative [row, channel] for these changes of the gauges' points and weights.

        Only the points `among` [point] bool change; all where None.
        """
        total = torch.zeros_like(self.alone)
        for point in range(self.by_point.shape[2]) if among is None else among.nonzero()[:, 0].tolist():
            for by, moved in ((self.by_point, change.points), (self.by_weight, change.weights)):
                add_products(total, by[:, :, point], moved[..., point, :])
            if change.change is not None:
                total.addcmul_(self.by_ratio[:, :, point], change.change[..., point])
        return self.amplitude[:, None] * total


def along_load(by: ByLoad, change: Mapping[str, Tensor]) -> Tensor:
    """Directional derivative [row, channel], per unit amplitude, for these changes of the loads."""
    total = torch.zeros(next(iter(by.values())).shape[:2], dtype=torch.float64)
    for name, tangent in change.items():
        add_products(total, by[name], tangent)
    return total


def add_products(total: Tensor, one: Tensor, other: Tensor) -> None:
    """Add to a total [row, channel] products [row, channel, ...] summed over the further axes.

    Numbers of one row lie side by side by channel; a sum over the last axes would go from one to the next across them.
    """
    if one.ndim == 2:
        if bool(other.any()):
            total.addcmul_(one, other)
        return
    for mine, theirs in zip(one.unbind(-1), other.unbind(-1), strict=True):
        add_products(total, mine, theirs)
