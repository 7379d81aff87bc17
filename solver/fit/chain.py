"""A survey of any length as a chain of small problems that share one route: linear in the length of the fiber.

A camera's view is a chain of one. On a longer fiber each stretch and each crowd of vehicles in it is a problem of its
own (`solver.fit.stretches`), with the noise taken for independent between them; the route's spline runs through all.
"""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import numpy as np
import torch
from torch import Tensor

from solver.cable.fiber import SplineBasis
from solver.fit.links import Link, linked
from solver.fit.map_fit import MapFit
from solver.fit.normal import Block, Normal, Part
from solver.fit.parameter_layout import of_route
from solver.fit.parameter_prior import ParameterPrior, RouteRows
from solver.fit.parameter_space import ParameterSpace
from solver.fit.problem import Problem
from solver.fit.robust import HUBER, SPIKE
from solver.fit.state import State, Weights
from solver.fit.stretches import parts

T = TypeVar("T")
THREADS = 2


@dataclass(frozen=True)
class Looked:
    """One link near a state.

    Parameters
    ----------
    amplitude : [pass], that fit best
    cost : misfit by the weights given
    misfit : by the new `weights`
    model : [sample, channel], 1/s
    part : of the normal equations
    shared, right : of the data, over what the stretch shares, [shared, shared] and [shared]
    """

    amplitude: Tensor
    cost: float
    misfit: float
    weights: Weights
    model: Tensor
    part: Part
    shared: np.ndarray
    right: np.ndarray


@dataclass(frozen=True)
class Visit:
    """A chain near a state, its amplitudes settled.

    Parameters
    ----------
    state : visited
    cost : misfit by the weights of the visit before, and priors
    misfit : chi2 of the whitened residual by its own weights
    normal : equations there
    border, own : which of the shared parameters beside the route, and of each link's own, are at a bound and would
        leave it
    weights, models : of each link
    """

    state: State
    cost: float
    misfit: float
    normal: Normal
    border: np.ndarray
    own: list[np.ndarray]
    weights: list[Weights]
    models: list[Tensor]

    @cached_property
    def open(self) -> Normal:
        """The equations of the next step, without what stays at its bound."""
        return self.normal.holding(self.border, self.own)


@contextmanager
def one_thread_each(many: bool) -> Iterator[None]:
    """Where links are worked on side by side, each has one thread."""
    before = torch.get_num_threads()
    torch.set_num_threads(1 if many else before)
    try:
        yield
    finally:
        torch.set_num_threads(before)


class Chain(ParameterSpace):
    """Small problems along one route, fitted together.

    Parameters
    ----------
    links : of the whole survey
    prior : on all that is fitted
    problem : the whole survey
    """

    def __init__(self, problem: Problem, prior: ParameterPrior, links: Sequence[Link]):
        super().__init__(problem, prior)
        self.links = list(links)

    @classmethod
    def single(cls, fit: MapFit) -> "Chain":
        """A chain of one."""
        return cls(fit.problem, fit.prior, [Link(fit, 0, 0, torch.arange(fit.layout.size))])

    @classmethod
    def of(
        cls,
        problem: Problem,
        known_ground: bool = False,
        basis: SplineBasis | None = None,
        groups: Sequence[Sequence[Problem]] | None = None,
    ) -> "Chain":
        """The chain of a survey, or of some small problems of each stretch of it; parameters as of `MapFit`."""
        groups = parts(problem) if groups is None else groups
        if len(groups) == 1 and groups[0][0] is problem:
            return cls.single(MapFit(problem, known_ground, basis))
        return cls(problem, *linked(problem, groups, basis or problem.basis, known_ground))

    @property
    def long(self) -> bool:
        """Whether there is more than one link."""
        return len(self.links) > 1

    def each(self, work: Callable[[int], T]) -> Iterator[T]:
        """Results of a work on each link, in order; links of a long chain side by side."""
        numbers = range(len(self.links))
        with one_thread_each(self.long):
            if not self.long:
                yield from map(work, numbers)
                return
            with ThreadPoolExecutor(THREADS) as pool:
                yield from pool.map(work, numbers)

    def part_of(self, state: State, link: Link) -> State:
        """The state of one link."""
        return link.fit.state_of(state.vector()[link.where])

    def begun(self, state: State) -> State:
        """The same vehicles with the amplitudes that fit best; along a long fiber the first visit finds them.

        To look twice at all stretches would be slow.
        """
        return state if self.long else self.links[0].fit.begun(state)

    def unsettled(self, state: State) -> list[Weights] | None:
        """Weights to settle the amplitudes of a start by; None where they are settled."""
        if not self.long or bool((state.vehicles.amplitude != 1).any()):
            return None
        return [Weights(link.fit.measured, link.fit.measured.float()) for link in self.links]

    def with_amplitudes(self, state: State, amplitudes: Sequence[Tensor]) -> State:
        """The same state with the amplitudes [pass] of each link."""
        return replace(state, vehicles=replace(state.vehicles, amplitude=torch.cat(list(amplitudes))))

    def cost(self, visit: "Visit") -> float:
        """-2 ln of the posterior density at a visit, but for a constant that all fits of one problem have in common.

        A weight is what is left of a sample's precision, so that a fit that trusts its samples less pays for it; a
        sample that was left out costs what one of its size costs at least.
        """
        trusted = 0.0
        for link, weights in zip(self.links, visit.weights, strict=True):
            weight = (weights.good * weights.soft)[link.fit.measured].double()
            used = weight > 0
            trusted += float(weight[used].log().sum()) - HUBER * SPIKE * int((~used).sum())
        return visit.misfit - trusted + self.prior.total(visit.state)

    def stopped(self, state: State, where: Tensor, push: np.ndarray) -> np.ndarray:
        """Which of some parameters [where] of a state are at a bound that they are pushed [where] against."""
        lower, upper = (one[where].numpy() for one in self.prior.bounds)
        at = state.vector()[where].numpy()
        return np.asarray(((at <= lower) & (push < 0)) | ((at >= upper) & (push > 0)))

    @property
    def size(self) -> int:
        """How many of the route's parameters are fitted."""
        return 0 if self.prior.held else self.layout["route"].stop

    @cached_property
    def border(self) -> Tensor:
        """What all stretches share beside the route, among the chain's parameters."""
        shared = torch.ones(self.layout.size, dtype=torch.bool)
        shared[self.layout["route"]] = False
        for link in self.links:
            shared[link.where[link.own]] = False
        return torch.nonzero(shared & self.free).flatten()

    @cached_property
    def _places(self) -> list[tuple[Tensor, Tensor, np.ndarray]]:
        """Of each link: its own free parameters, those it shares in the order of its block, and which of the border."""
        rank = torch.full((self.layout.size,), -1)
        rank[self.border] = torch.arange(len(self.border))
        places = []
        for link in self.links:
            free = self.free[link.where]
            own = torch.nonzero(link.own & free).flatten()
            shared = torch.nonzero(~link.own & free).flatten()
            border = rank[link.where[shared]]
            places.append((own, shared, border[border >= 0].numpy()))
        return places

    @property
    def own_places(self) -> list[Tensor]:
        """Of each link, where the chain holds the free parameters that no other link has."""
        return [link.where[own] for link, (own, _, _) in zip(self.links, self._places, strict=True)]

    @cached_property
    def slots(self) -> list[Tensor]:
        """Where the chain's numbers hold each parameter of the effects."""
        first, places = self.layout["numbers"].start, []
        for which, _ in enumerate(self.links[0].fit.extension.slots):
            every = [link.numbers[link.fit.extension.slots[which].where] for link in self.links]
            places.append(torch.unique(torch.cat(every)) - first)
        return places

    def _block(self, number: int, matrix: np.ndarray) -> Block:
        link, border = self.links[number], self._places[number][2]
        return Block(of_route(link.first, 0).start if self.size else 0, len(matrix) - len(border), border, matrix)

    def look(self, number: int, state: State, before: Weights | None, precision: Tensor, shift: Tensor) -> Looked:
        """One link near the chain's `state` [parameter]; with its amplitudes settled by the weights `before`."""
        link = self.links[number]
        fit, here = link.fit, self.part_of(state, link)
        evaluation = fit.evaluate(here)
        if before is not None:
            here, evaluation = fit.resettled(here, evaluation, before)
        at = fit.linearized(here, evaluation)
        cost = at.misfit if before is None else float((fit.whitened_of(evaluation.model, before) ** 2).sum())
        own, shared, _ = self._places[number]
        jacobian = at.jacobian.index_select(1, torch.cat([own, shared]))
        matrix, right = (jacobian.T @ jacobian).numpy(), (jacobian.T @ at.residual).numpy()
        count, mine = len(own), link.where[own]
        known = precision[mine].numpy()
        part = Part(
            matrix[:count, :count] + np.diag(known),
            matrix[:count, count:],
            right[:count] + known * shift[mine].numpy(),
            known,
            link.stretch,
        )
        weights = Weights(at.weights.good.bool(), at.weights.soft.float()) if self.long else at.weights
        model = evaluation.model.float() if self.long else evaluation.model
        amplitude = here.vehicles.amplitude
        return Looked(amplitude, cost, at.misfit, weights, model, part, matrix[count:, count:], right[count:])

    def visit(self, state: State, before: Sequence[Weights] | None = None) -> Visit:
        """The chain near a state; with amplitudes that fit best by the weights of the visit `before`."""
        precision, shift = self.prior.precision(state), self.mean - state.vector()
        blocks: dict[int, Block] = {}
        cost, misfit = 0.0, 0.0
        right = np.zeros(self.size + len(self.border))
        weights, models, own, amplitudes = [], [], [], []

        def work(number: int) -> Looked:
            return self.look(number, state, None if before is None else before[number], precision, shift)

        for number, seen in enumerate(self.each(work)):
            cost, misfit = cost + seen.cost, misfit + seen.misfit
            block = self._block(number, seen.shared)
            right[block.where(self.size)] += seen.right
            if seen.part.stretch in blocks:
                blocks[seen.part.stretch].matrix[...] += seen.shared
            else:
                blocks[seen.part.stretch] = block
            weights.append(seen.weights)
            models.append(seen.model)
            own.append(seen.part)
            amplitudes.append(seen.amplitude)
        state = self.with_amplitudes(state, amplitudes)
        known = self.known(state, precision)
        right += self.pull(state, precision)
        normal = Normal(self.size, len(self.border), [blocks[key] for key in sorted(blocks)], list(known), own, right)
        border = self.stopped(state, self.border, right[self.size :])
        stopped = [self.stopped(state, where, part.right) for where, part in zip(self.own_places, own, strict=True)]
        return Visit(state, cost + self.prior.total(state), misfit, normal, border, stopped, weights, models)

    def rows(self, state: State) -> list[RouteRows]:
        """Rows of the priors on the route: its shape and its anchors; none where it is held."""
        if self.prior.held:
            return []
        return self.prior.route_rows(state)

    def known(self, state: State, precision: Tensor) -> Iterator[Block]:
        """Normal matrices of the priors on what is shared."""
        for one in self.rows(state):
            matrix = (one.rows.jacobian.T @ one.rows.jacobian).numpy()
            yield Block(one.route.start, one.count, self.rank(one.other), matrix)
        yield Block(0, 0, np.arange(len(self.border)), np.diag(precision[self.border].numpy()))

    def pull(self, state: State, precision: Tensor) -> np.ndarray:
        """Right-hand side [shared] of the priors on what is shared."""
        right = np.zeros(self.size + len(self.border))
        right[self.size :] = (precision * (self.mean - state.vector()))[self.border].numpy()
        for one in self.rows(state):
            where = np.concatenate([np.arange(one.route.start, one.route.stop), self.size + self.rank(one.other)])
            right[where] -= (one.rows.jacobian.T @ one.rows.residual).numpy()
        return right

    def rank(self, where: Tensor) -> np.ndarray:
        """Which of the border some of its parameters [where] are."""
        return np.searchsorted(self.border.numpy(), where.numpy())

    def stepped(self, state: State, step: tuple[np.ndarray, list[np.ndarray]]) -> State:
        """The state after a step of `Normal.step`."""
        vector, (shared, own) = state.vector().clone(), step
        vector[: self.size] += torch.from_numpy(shared[: self.size])
        vector[self.border] += torch.from_numpy(shared[self.size :])
        for link, (mine, _, _), part in zip(self.links, self._places, own, strict=True):
            vector[link.where[mine]] += torch.from_numpy(part)
        return self.bounded(state.moved(vector))
