"""The signal path in one piece: trajectory -> load -> ground -> cable -> interrogator.

Rows are (pass, sample) pairs of all passes, one after the other, so that any number of vehicles, meeting or apart, is
one tensor operation; rows of the same sample superpose.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields

import numpy as np
import torch
from torch import Tensor

from solver.cable import GaugeEnds, axial, unit
from solver.ground import displacement_rate
from solver.interrogator import gauge_strain_rate
from solver.load import layout_of, wheel_loads
from solver.trajectory import Pass


@dataclass(frozen=True)
class Traffic:
    """Where every vehicle was at every sample it matters for.

    Parameters
    ----------
    passes : number of passes
    pass_index : [row], which pass
    sample_index : [row], which of `samples`
    samples : [sample], rows of the record, ascending
    position, velocity : [row, 2], m and m/s
    heading : [row, 2], unit vector along travel
    sigma : [row, 2], standard deviation of the position, m
    """

    passes: int
    pass_index: Tensor
    sample_index: Tensor
    samples: np.ndarray
    position: Tensor
    velocity: Tensor
    heading: Tensor
    sigma: Tensor

    @classmethod
    def of(cls, passes: Sequence[Pass]) -> "Traffic":
        """Stack passes."""
        record_rows = np.concatenate([p.rows for p in passes])
        samples, sample_index = np.unique(record_rows, return_inverse=True)
        stack = {
            name: torch.from_numpy(np.concatenate([getattr(p, name) for p in passes]))
            for name in ("position", "velocity", "sigma")
        }
        heading = torch.from_numpy(np.concatenate([_heading(p) for p in passes]))
        index = np.repeat(np.arange(len(passes)), [len(p.rows) for p in passes])
        return cls(
            len(passes),
            torch.from_numpy(index),
            torch.from_numpy(sample_index),
            samples,
            heading=heading,
            **stack,
        )

    def take(self, chosen: np.ndarray) -> "Traffic":
        """Keep only `chosen` (ascending indices into `samples`)."""
        place = torch.full((len(self.samples),), -1)
        place[torch.from_numpy(chosen)] = torch.arange(len(chosen))
        keep = place[self.sample_index] >= 0
        rows = {name: getattr(self, name)[keep] for name in ("pass_index", "position", "velocity", "heading", "sigma")}
        return Traffic(self.passes, sample_index=place[self.sample_index][keep], samples=self.samples[chosen], **rows)

    def superpose(self, rows: Tensor) -> Tensor:
        """Sum responses [row, ...] of the same sample -> [sample, ...]."""
        total = rows.new_zeros((len(self.samples), *rows.shape[1:]))
        return total.index_add(0, self.sample_index, rows)


def _heading(one: Pass) -> np.ndarray:
    # A vehicle that stands still keeps the direction of its whole passage.
    chord = one.position[-1] - one.position[0]
    speed = np.linalg.norm(one.velocity, axis=1, keepdims=True)
    moving = np.where(speed > 0.5, one.velocity, chord)
    return moving / np.maximum(np.linalg.norm(moving, axis=1, keepdims=True), 1e-9)


@dataclass
class Vehicles:
    """What the fit may change about each vehicle.

    Parameters
    ----------
    amplitude : [pass], F / (4 pi G) times coupling, m^2
    along, across : [pass], shift of the load along travel and to its right, m
    wheelbase, track : [pass], m
    front_share : [pass], share of the load on the front axle
    """

    amplitude: Tensor
    along: Tensor
    across: Tensor
    wheelbase: Tensor
    track: Tensor
    front_share: Tensor

    @classmethod
    def of(cls, passes: Sequence[Pass]) -> "Vehicles":
        """Class defaults, unit amplitude, no shift."""
        layouts = [layout_of(p.vehicle_class) for p in passes]
        zeros = torch.zeros(len(passes), dtype=torch.float64)
        columns = {
            name: torch.tensor([getattr(layout, name) for layout in layouts], dtype=torch.float64)
            for name in ("wheelbase", "track", "front_share")
        }
        return cls(amplitude=torch.ones_like(zeros), along=zeros.clone(), across=zeros.clone(), **columns)

    def rows(self, traffic: Traffic) -> "Vehicles":
        """Per row instead of per pass."""
        return Vehicles(*(getattr(self, f.name)[traffic.pass_index] for f in fields(self)))


@dataclass(frozen=True)
class Fiber:
    """The ends of every gauge and the fiber's direction there.

    Parameters
    ----------
    ahead, behind : [..., channel, 3], positions, m
    ahead_slope, behind_slope : [..., channel, 3], derivative of position with distance
    """

    ahead: Tensor
    behind: Tensor
    ahead_slope: Tensor
    behind_slope: Tensor

    @classmethod
    def of(cls, ends: GaugeEnds, coefficients: Tensor) -> "Fiber":
        """Ends of a spline route with `coefficients` [knot, 3], m."""
        return cls(*(getattr(ends, f.name) @ coefficients for f in fields(cls)))


@dataclass(frozen=True)
class SignalPath:
    """Strain rate that traffic makes in a fiber.

    Parameters
    ----------
    traffic : vehicles' places
    gauge_length : m
    """

    traffic: Traffic
    gauge_length: float

    def rows(self, fiber: Fiber, vehicles: Vehicles, poisson_ratio: Tensor) -> Tensor:
        """Strain rate [row, channel] of each vehicle alone, 1/s.

        Fields of `fiber` are [channel, 3] or [row, channel, 3]; of `vehicles` (per row) [row] or [row, channel];
        `poisson_ratio` is a scalar or [row, channel].
        """
        traffic, v = self.traffic, vehicles
        # Fields per row get a channel axis, so that per-row and per-sample fields mix freely.
        v = Vehicles(*(x if x.ndim > 1 else x[:, None] for x in (getattr(v, f.name) for f in fields(v))))
        heading = traffic.heading[:, None, :]
        right = torch.stack([-heading[..., 1], heading[..., 0]], -1)
        position = traffic.position[:, None, :] + v.along[..., None] * heading + v.across[..., None] * right
        heading = heading.expand(position.shape)
        wheels, weights = wheel_loads(position, heading, v.wheelbase, v.track, v.front_share)
        if not bool(v.wheelbase.any() | v.track.any()):
            wheels, weights = wheels[..., :1, :], torch.ones_like(weights[..., :1])
        velocity = traffic.velocity[:, None, None, :]
        nu = torch.as_tensor(poisson_ratio)
        nu = nu[..., None] if nu.ndim else nu

        def axial_velocity(point: Tensor, slope: Tensor) -> Tensor:
            across = point[..., None, :2] - wheels
            down = point[..., None, 2:].expand(*across.shape[:-1], 1)
            motion = displacement_rate(torch.cat([across, down], -1), velocity, nu)
            return axial((weights[..., None] * motion).sum(-2), unit(slope))

        ahead = axial_velocity(fiber.ahead, fiber.ahead_slope)
        behind = axial_velocity(fiber.behind, fiber.behind_slope)
        return v.amplitude * gauge_strain_rate(ahead, behind, self.gauge_length)

    def strain_rate(self, fiber: Fiber, vehicles: Vehicles, poisson_ratio: Tensor) -> Tensor:
        """Strain rate [sample, channel] of all vehicles together, 1/s."""
        return self.traffic.superpose(self.rows(fiber, vehicles.rows(self.traffic), poisson_ratio))

    def sensitivities(self, fiber: Fiber, vehicles: Vehicles, poisson_ratio: Tensor) -> "Sensitivities":
        """Strain rate of each row and its derivative by every local quantity, in one backward pass.

        Each sample depends on its own copy of the local quantities only, so the gradient of the sum over samples
        holds all derivatives.
        """
        shape = (len(self.traffic.pass_index), fiber.ahead.shape[-2])

        def leaf(x: Tensor, *tail: int) -> Tensor:
            return x.expand(*shape, *tail).clone().requires_grad_()

        local_fiber = Fiber(*(leaf(getattr(fiber, f.name), 3) for f in fields(fiber)))
        per_row = vehicles.rows(self.traffic)
        local_vehicles = Vehicles(*(leaf(getattr(per_row, f.name)[:, None]) for f in fields(per_row)))
        local_nu = leaf(poisson_ratio)
        rate = self.rows(local_fiber, local_vehicles, local_nu)
        leaves = {"poisson_ratio": local_nu}
        for group in (local_fiber, local_vehicles):
            leaves |= {f.name: getattr(group, f.name) for f in fields(group)}
        gradients = torch.autograd.grad(rate.sum(), list(leaves.values()), materialize_grads=True)
        return Sensitivities(rate.detach(), dict(zip(leaves, gradients, strict=True)))


@dataclass(frozen=True)
class Sensitivities:
    """Strain rate and its local derivatives.

    Parameters
    ----------
    rate : [row, channel], 1/s
    by : name of a local quantity -> derivative [row, channel] or [row, channel, 3]
    """

    rate: Tensor
    by: dict[str, Tensor] = field(repr=False)
