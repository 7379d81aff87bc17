"""The paper's fit: a small neural network draws the route, Adam trains it on one survey.

A learnable latent vector of 128 goes through three hidden layers of 128 (ReLU) to 3 N outputs, which a learnable scale
and shift turn into meters about the starting route. The loss is the data misfit plus regularizers on angle, length,
anchors and curvature; depth gradients are attenuated 100 times and enabled in the second half. Beyond the paper, each
vehicle's amplitude and shift along travel are learned too, as the spline fit has them.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from solver.cable.fiber import Fiber
from solver.fit.map_fit import MapFit
from solver.fit.posterior import assemble
from solver.fit.problem import Problem
from solver.fit.residual import unexplained
from solver.fit.result import FitResult
from solver.fit.robust import huber
from solver.fit.state import State
from solver.published.regularizers import anchor_loss, angle_loss, curvature_loss, depth_loss, length_loss
from solver.signal_path.signal_path import SignalPath
from solver.signal_path.traffic import Vehicles

LATENT = HIDDEN = 128
LEARNING_RATE = 0.005
ITERATIONS = 1000
DEPTH_ATTENUATION = 0.01
STRIDE = 4
#: Meters per unit of the network's output at the start, and sd of a segment's relative length: tighter ones leave Adam
#: straightening the random first route instead of moving it.
SCALE, STRETCH = 0.1, 0.01


@dataclass(frozen=True)
class Polyline:
    """A route through N nodes joined by straight lines; `at` is the same interface as a spline basis.

    Parameters
    ----------
    nodes : [node], distance along the fiber, m, evenly spaced

    >>> Polyline(np.array([0.0, 1.0, 2.0])).at(np.array([0.25])).tolist()
    [[0.75, 0.25, 0.0]]
    """

    nodes: NDArray[np.float64]

    def at(self, distance: NDArray[np.float64], derivative: int = 0) -> NDArray[np.float64]:
        """Matrix [distance, node] of the position, or of its first derivative by distance."""
        spacing = self.nodes[1] - self.nodes[0]
        left = np.clip(((distance - self.nodes[0]) / spacing).astype(int), 0, len(self.nodes) - 2)
        fraction = (distance - self.nodes[left]) / spacing
        out = np.zeros((len(distance), len(self.nodes)))
        rows = np.arange(len(distance))
        out[rows, left], out[rows, left + 1] = (
            (1 - fraction, fraction) if derivative == 0 else (-1 / spacing, 1 / spacing)
        )
        return out


class RouteNetwork(nn.Module):
    """Latent vector -> route [node, 3], m."""

    def __init__(self, start: Tensor):
        super().__init__()
        self.start = start
        self.latent = nn.Parameter(torch.randn(LATENT, dtype=torch.float64))
        widths = (LATENT, HIDDEN, HIDDEN, HIDDEN)
        hidden = [layer for a, b in pairwise(widths) for layer in (nn.Linear(a, b, dtype=torch.float64), nn.ReLU())]
        self.layers = nn.Sequential(*hidden, nn.Linear(HIDDEN, start.numel(), dtype=torch.float64))
        self.scale = nn.Parameter(torch.full((3,), SCALE, dtype=torch.float64))
        self.shift = nn.Parameter(torch.zeros(3, dtype=torch.float64))

    def forward(self, depth_gradient: float) -> Tensor:
        """Route [node, 3]; the gradient through depth is multiplied by `depth_gradient`."""
        route = self.start + self.scale * self.layers(self.latent).reshape(-1, 3) + self.shift
        depth = route[:, 2:]
        depth = depth.detach() + depth_gradient * (depth - depth.detach())
        return torch.cat([route[:, :2], depth], 1)


def regularizers(problem: Problem, line: Polyline, route: Tensor) -> Tensor:
    """Angle between segments, their length, curvature, anchors, mean depth: squared, in prior standard deviations.

    Parameters
    ----------
    route : [node, 3], m
    """
    prior, spacing = problem.prior, float(line.nodes[1] - line.nodes[0])
    # The priors are per independent stretch of the fiber, about a gauge length; nodes are denser.
    per_node = spacing / problem.gauge_length
    loss = per_node * angle_loss(route) / (prior.curvature * spacing) ** 2
    loss = loss + per_node * length_loss(route, spacing) / STRETCH**2
    loss = loss + per_node * curvature_loss(route, spacing, slice(2, 3)) / prior.depth_curvature**2
    loss = loss + depth_loss(route, *prior.depth)
    at = torch.from_numpy(line.at(problem.anchor_distance)) @ route
    known = torch.tensor([[a.x, a.y, a.z] for a in problem.anchors], dtype=torch.float64).reshape(-1, 3)
    sigma = torch.tensor([[a.sigma_xy, a.sigma_xy, a.sigma_z] for a in problem.anchors], dtype=torch.float64)
    return loss + anchor_loss(at, known, sigma.reshape(-1, 3))


def train(
    problem: Problem, line: Polyline, start: State, route: Tensor, iterations: int, advance: Callable[[int], None]
) -> tuple[Tensor, Vehicles]:
    """Adam on the network and on each vehicle's amplitude and shift; returns route [node, 3] and vehicles.

    Every step sees one sample in four, a different quarter each time.
    """
    network = RouteNetwork(route)
    gain = nn.Parameter(torch.ones_like(start.vehicles.amplitude))
    along = nn.Parameter(torch.zeros_like(gain))
    adam = torch.optim.Adam([*network.parameters(), gain, along], lr=LEARNING_RATE)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(adam, iterations, eta_min=LEARNING_RATE / 50)
    batches = [problem.traffic.take(np.arange(first, len(problem.traffic.samples), STRIDE)) for first in range(STRIDE)]
    ends = problem.ends(line)
    base = start.vehicles

    def vehicles() -> Vehicles:
        return Vehicles(base.amplitude * gain, along, base.across, base.wheelbase, base.track, base.front_share)

    for number in range(iterations):
        first = number % STRIDE
        rows = slice(first, None, STRIDE)
        path = SignalPath(batches[first], problem.gauge_length)
        current = network(DEPTH_ATTENUATION if number >= iterations // 2 else 0.0)
        model = path.strain_rate(Fiber.of(ends, current), vehicles(), start.poisson_ratio)
        measured = problem.measured[rows]
        residual = unexplained(problem.strain_rate[rows], model, measured) / problem.noise
        misfit = STRIDE * (huber(residual.detach(), measured) * residual**2).sum()
        loss = misfit + regularizers(problem, line, current) + ((along / problem.prior.along) ** 2).sum()
        adam.zero_grad()
        (loss / problem.measured.sum()).backward()
        adam.step()
        schedule.step()
        advance(1)
    with torch.no_grad():
        return network(0.0), replace(vehicles(), along=along.detach())


def fit_network(
    problem: Problem, advance: Callable[[int], None] = lambda n: None, *, iterations: int = ITERATIONS, seed: int = 0
) -> FitResult:
    """Fit a route with the paper's neural network.

    Parameters
    ----------
    problem : the survey
    advance : called with 1 after each step
    iterations : of Adam
    seed : of the network's random start

    Returns
    -------
    result : its covariance is the spline posterior's, linearized at the network's route (the network itself has none)
    """
    begun = time.perf_counter()
    fit = MapFit(problem)
    start = fit.start()
    line = Polyline(problem.distance_of(problem.route_channel))
    rough = torch.from_numpy(fit.basis.at(line.nodes)) @ start.coefficients
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        route, vehicles = train(problem, line, start, rough, iterations, advance)
    coefficients = torch.from_numpy(fit.basis.interpolate(line.nodes, route.numpy()))
    return assemble(
        problem,
        fit,
        State(coefficients, vehicles, start.poisson_ratio, start.numbers),
        method="network",
        iterations=iterations,
        seconds=time.perf_counter() - begun,
        converged=True,
    )
