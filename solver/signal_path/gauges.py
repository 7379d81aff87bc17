"""Points at which each gauge samples the ground, and weights: strain rate is a weighted sum of velocities there."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import torch
from torch import Tensor
from torch.nn.functional import pad

from solver.cable.fiber import Fiber, GaugeEnds, stations, turning, unit
from solver.interrogator.interrogator import Interrogator
from solver.signal_path.observation import BASE, Description


@dataclass(frozen=True)
class Gauges:
    """Gauges: points in the ground, and weights of its velocity there.

    Parameters
    ----------
    points : [channel, point, 3], m
    weights : [channel, point, 3], 1/m: strain rate is the sum of weight . velocity of the ground over the points
    change : [channel, point], added to Poisson's ratio there; None: nothing
    """

    points: Tensor
    weights: Tensor
    change: Tensor | None = None

    @property
    def tensors(self) -> tuple[Tensor, ...]:
        """Points, weights, and the change of Poisson's ratio if there is one."""
        return (self.points, self.weights) if self.change is None else (self.points, self.weights, self.change)

    def ratio(self, poisson_ratio: Tensor) -> Tensor:
        """Poisson's ratio at the points: a scalar, or [channel, point]."""
        return poisson_ratio if self.change is None else poisson_ratio + self.change

    def part(self, chosen: Tensor) -> "Gauges":
        """Some of the points, [point] bool."""
        return Gauges(*(x[:, chosen] for x in self.tensors))

    @classmethod
    def of(cls, fiber: Fiber, stages: Description, curved: bool) -> "Gauges":
        """Gauges from the fiber's geometry, and from ground, cable and interrogator as the stages describe them.

        The mean of t . du/ds over a gauge, t the unit tangent, is [t . u] between its ends less the integral of
        u . dt/ds. Where the ground's compliance or Poisson's ratio changes along the gauge, strain is summed piece by
        piece, each piece with the mean of the values at its ends: strain is local, and a different ratio at each end
        would add a difference in settlement that is not strain.

        Parameters
        ----------
        fiber : with the stations inside the gauge, where these matter
        stages : of the signal path
        curved : include the integral in full; else the share that the cable sets
        """
        ground, cable = stages.ground, stages.cable
        points = ordered(fiber.behind, fiber.inner, fiber.ahead)
        tangents = followed(ordered(fiber.behind_slope, fiber.inner_slope, fiber.ahead_slope), cable.vertical)
        compliance = None if ground.compliance is None else ground.compliance(points)
        change = None if ground.poisson_change is None else ground.poisson_change(points)
        gauge = torch.as_tensor(stages.gauge, dtype=torch.float64)
        pieces = (1 / gauge).expand(len(points))[:, None].expand(-1, points.shape[1] - 1)
        if compliance is not None:
            pieces = pieces * between(compliance)
        bends = None
        if fiber.inner_slope is not None and fiber.inner_bend is not None:
            share = stations(fiber.inner_slope.shape[-2])[1] * (1.0 if curved else cable.path_integral)
            if compliance is not None:
                share = share * compliance[:, 1:-1]
            bends = -share[..., None] * turning(fiber.inner_slope, fiber.inner_bend)
        places, ratio = list(range(points.shape[1])), None
        along = pad(pieces, (1, 0)) - pad(pieces, (0, 1))
        if change is not None:
            # Both ends of each piece, with the ratio of that piece.
            places, along = [*places[:-1], *places[1:]], torch.cat([-pieces, pieces], 1)
            ratio = between(change).repeat(1, 2)
        parts = [(points[:, places], along, tangents[:, places], ratio)]
        if cable.loose is not None:
            assert fiber.first is not None and fiber.first_slope is not None
            assert fiber.last is not None and fiber.last_slope is not None
            offsets = [] if fiber.inner is None else stations(fiber.inner.shape[-2])[0].tolist()
            reach = torch.tensor([-0.5, *offsets, 0.5], dtype=torch.float64)
            at = cable.distance[:, None] + gauge[..., None] * reach
            held = torch.stack([fiber.first, fiber.last], -2).expand(len(points), -1, -1)
            tight = followed(torch.stack([fiber.first_slope, fiber.last_slope], -2), cable.vertical)
            own, *shares = cable.loose.shares(at[:, places])
            pulled = torch.stack([(along * share).sum(1) for share in shares], 1)
            there = None if ground.poisson_change is None else ground.poisson_change(held)
            parts = [(points[:, places], along * own, tangents[:, places], ratio), (held, pulled, tight, there)]
        weights = [scale[..., None] * tangent for _, scale, tangent, _ in parts]
        where, ratios = [place for place, *_ in parts], [added for *_, added in parts if added is not None]
        if bends is not None and change is None:
            weights[0] = weights[0] + pad(bends, (0, 0, 1, 1))
        elif bends is not None and change is not None:
            where, weights, ratios = [*where, points[:, 1:-1]], [*weights, bends], [*ratios, change[:, 1:-1]]
        gain = torch.as_tensor(cable.gain, dtype=torch.float64).expand(len(points))[:, None, None]
        return cls(torch.cat(where, 1), gain * torch.cat(weights, 1), torch.cat(ratios, 1) if ratios else None)


def ordered(behind: Tensor, inner: Tensor | None, ahead: Tensor) -> Tensor:
    """Vectors [channel, point, 3] at the rear end, the stations inside the gauge, if any, and the front end."""
    behind, ahead = behind[:, None], ahead[:, None]
    return torch.cat([behind, ahead] if inner is None else [behind, inner, ahead], 1)


def followed(slope: Tensor, vertical: Tensor | float) -> Tensor:
    """Directions [..., 3] in which the fiber follows the ground: tangents with a share of their vertical component."""
    tangent = unit(slope)
    if not isinstance(vertical, Tensor):
        return tangent
    return torch.cat([tangent[..., :2], tangent[..., 2:] * vertical], -1)


def between(values: Tensor) -> Tensor:
    """Means [channel, piece] of the values [channel, point] at both ends of each piece."""
    return (values[:, 1:] + values[:, :-1]) / 2


def route_jacobian(ends: GaugeEnds, coefficients: Tensor, stages: Description, curved: bool) -> tuple[Tensor, Tensor]:
    """Derivatives of the gauges with respect to a route's coefficients [coefficient, 3].

    Parameters
    ----------
    ends : of the gauges
    coefficients : of the route, m
    stages, curved : see `Gauges.of`

    Returns
    -------
    places : [channel, point, coefficient], of the points; the same in each dimension
    others : [channel, 3 point (+ point), 3 coefficient], of the weights and, if there is one, the change of Poisson's
        ratio
    """
    if stages.in_rows:
        return _jacobian(ends, coefficients, stages, curved)
    return _of_base(ends, coefficients.numpy().tobytes(), float(stages.interrogator.gauge_length), curved)


@lru_cache(maxsize=4)
def _of_base(ends: GaugeEnds, coefficients: bytes, gauge_length: float, curved: bool) -> tuple[Tensor, Tensor]:
    """`route_jacobian` of the base model, shared by all vehicles on one stretch.

    The weights at a point depend on the fiber there alone, so that three gradients hold the derivatives of all.
    """
    route = torch.frombuffer(bytearray(coefficients), dtype=torch.float64).reshape(-1, 3)
    bases = ends.present()
    fiber = {name: (basis @ route).requires_grad_() for name, basis in bases.items()}
    with torch.enable_grad():
        weights = Gauges.of(Fiber(**fiber), replace(BASE, interrogator=Interrogator(gauge_length)), curved).weights
    given = list(fiber.values())
    gradients = (torch.autograd.grad(x.sum(), given, None, True, materialize_grads=True) for x in weights.unbind(-1))
    each = [dict(zip(fiber, found, strict=True)) for found in gradients]
    places = _at_points(bases, "")
    others = torch.zeros(*weights.shape, *route.shape, dtype=weights.dtype)
    for order in ("_slope", "_bend"):
        if f"inner{order}" in bases or order == "_slope":
            by_field = torch.stack([_at_points(one, order) for one in each], 2)
            others += torch.einsum("cqkd,cqm->cqkmd", by_field, _at_points(bases, order))
    return places, others.flatten(1, 2).flatten(2)


def _at_points(fields: Mapping[str, Tensor], order: str) -> Tensor:
    """Of a fiber's fields, or what belongs to them, those of one order of derivative, [channel, point, ...]."""
    inner = fields.get(f"inner{order}")
    if f"behind{order}" in fields:
        return ordered(fields[f"behind{order}"], inner, fields[f"ahead{order}"])
    assert inner is not None, "second derivatives are wanted within the gauge alone"
    return pad(inner, (0, 0, 1, 1))


def _jacobian(ends: GaugeEnds, coefficients: Tensor, stages: Description, curved: bool) -> tuple[Tensor, Tensor]:
    # Each channel gets its own copy of the shared coefficients, so that one gradient holds the derivatives of all
    # channels.
    bases = {name: matrix.expand(len(ends.ahead), *matrix.shape[1:]) for name, matrix in ends.present().items()}
    fiber = {name: (basis @ coefficients).requires_grad_() for name, basis in bases.items()}
    with torch.enable_grad():
        gauges = Gauges.of(Fiber(**fiber), stages, curved)
        others = [gauges.weights.flatten(1)] if gauges.change is None else [gauges.weights.flatten(1), gauges.change]
        every = torch.cat([gauges.points[..., 0], *others], 1)
    given = list(fiber.values())
    # Loading PyTorch's batched gradients would take longer than they save.
    each = [torch.autograd.grad(x.sum(), given, retain_graph=True, materialize_grads=True) for x in every.unbind(1)]
    found = [torch.stack(gradients, 1) for gradients in zip(*each, strict=True)]
    total = torch.zeros(*every.shape, len(coefficients), 3, dtype=every.dtype)
    for basis, gradient in zip(bases.values(), found, strict=True):
        by_field, by_station = (x if gradient.ndim == 4 else x.unsqueeze(-2) for x in (gradient, basis))
        total += torch.einsum("cqsk,csm->cqmk", by_field, by_station)
    points = gauges.points.shape[1]
    return total[:, :points, :, 0].contiguous(), total[:, points:].flatten(2)
