"""The paper's network with what the default fit sees: whitened noise, its priors, its anchors, its vehicles.

The network of `solver.published.network` draws the route's spline coefficients, and Adam trains it, with every other
free number, on -2 ln of the posterior that the default fit minimizes (`solver.fit.map_fit`). All are counted in
posterior standard deviations about where a round of training begins: v = v0 + L^-T z, with L L' the normal matrix
there. Without that scale Adam takes thousands of steps along the valleys that tracks and route share.
"""

import math
import time
from collections.abc import Callable

import torch
from torch import Tensor, nn

from solver.fit.chain import Chain
from solver.fit.map_fit import MapFit
from solver.fit.posterior import assemble
from solver.fit.problem import Problem
from solver.fit.result import FitResult
from solver.fit.state import State, Weights
from solver.fit.stretches import is_long
from solver.published.network import LEARNING_RATE, RouteNetwork
from vision.contract import InputError

#: Rounds of training, and steps of each; a round begins with weights and scale from where the last one ended.
ROUNDS, STEPS = 5, 80
ITERATIONS = ROUNDS * STEPS
#: Learning rate of the numbers beside the route, which no layers multiply.
DIRECT = 0.1
#: Length of the Newton step, in posterior sigmas, below which training counts as converged.
NEAR = 0.5


class Whitened(nn.Module):
    """The network and the numbers beside the route -> all free parameters, in posterior sigmas from a round's start.

    Parameters
    ----------
    knots : coefficients of the route, per dimension
    others : free parameters beside the route
    """

    def __init__(self, knots: int, others: int):
        super().__init__()
        self.network = RouteNetwork(torch.zeros(knots, 3, dtype=torch.float64))
        self.others = nn.Parameter(torch.zeros(others, dtype=torch.float64))
        nn.init.ones_(self.network.scale)

    def forward(self) -> Tensor:
        """[free], the route first."""
        return torch.cat([self.network(1.0).reshape(-1), self.others])


def objective(fit: MapFit, state: State, weights: Weights, precision: Tensor) -> Tensor:
    """-2 ln of the posterior density at a state, but for a constant; differentiable.

    Parameters
    ----------
    weights : of the samples
    precision : [parameter], of the priors on all but the route
    """
    misfit = (fit.whitened_of(fit.model(state), weights) ** 2).sum()
    known = (precision * (state.vector() - fit.mean) ** 2)[fit.free].sum()
    return misfit + known + sum((one.rows.residual**2).sum() for one in fit.prior.route_rows(state))


def train_round(fit: MapFit, model: Whitened, state: State, advance: Callable[[int], None]) -> State:
    """One round from a state: weights and scale there, then Adam."""
    at = fit.linearized(state)
    matrix, right = Chain.single(fit).dense(state, [at])
    factor = torch.linalg.cholesky(matrix)
    newton = torch.linalg.solve_triangular(factor, right[:, None], upper=False)[:, 0]
    size = max(1.0, float(newton.square().mean().sqrt()))
    begin, free, precision = state.vector(), torch.nonzero(fit.free).flatten(), fit.prior.precision(state)
    with torch.no_grad():
        zero = model()

    def moved() -> State:
        step = torch.linalg.solve_triangular(factor.T, size * (model() - zero)[:, None], upper=True)[:, 0]
        return fit.state_of(begin.index_add(0, free, step))

    groups = [{"params": model.network.parameters(), "lr": LEARNING_RATE}, {"params": [model.others], "lr": DIRECT}]
    adam = torch.optim.Adam(groups)
    schedule = torch.optim.lr_scheduler.LambdaLR(adam, lambda step: (1 + math.cos(math.pi * step / STEPS)) / 2)
    best, least = state, float("inf")
    for _ in range(STEPS):
        there = moved()
        loss = objective(fit, there, at.weights, precision)
        if loss.item() < least:
            best, least = there, loss.item()
        adam.zero_grad()
        loss.backward()
        adam.step()
        schedule.step()
        advance(1)
    return fit.bounded(best.moved(best.vector().detach()))


def fit_whitened_network(
    problem: Problem, advance: Callable[[int], None] = lambda n: None, *, rounds: int = ROUNDS, seed: int = 0
) -> FitResult:
    """Fit a route with the paper's network to the default fit's posterior.

    Parameters
    ----------
    problem : the survey, up to 200 m
    advance : called with 1 after each step
    rounds : of training
    seed : of the network's random start

    Returns
    -------
    result : with the covariance of the linearized posterior where training ended

    Raises
    ------
    InputError
        If the fiber is longer.
    """
    if is_long(problem):
        raise InputError("--likelihood whitened: is for up to 200 m of fiber; name a stretch in [das] channels")
    begun = time.perf_counter()
    fit = MapFit(problem)
    state = fit.start()
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        model = Whitened(fit.basis.size, int(fit.free.sum()) - fit.layout["route"].stop)
        for _ in range(rounds):
            state = train_round(fit, model, state, advance)
    chain = Chain.single(fit)
    end = chain.visit(state)
    return assemble(
        problem,
        chain,
        end.state,
        method="network, whitened",
        iterations=rounds * STEPS,
        seconds=time.perf_counter() - begun,
        converged=end.open.decrement < NEAR,
        near=end,
    )
