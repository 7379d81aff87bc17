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
from solver.fit.normal import Assembly, Block, Normal, Part
from solver.fit.parameter_layout import of_route
from solver.fit.parameter_prior import ParameterPrior, RouteRows
from solver.fit.parameter_space import ParameterSpace
from solver.fit.problem import Problem
from solver.fit.robust import HUBER, SPIKE
from solver.fit.state import Linearized, State, Weights
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
    equations : as `Assembly.add` takes them
    """

    amplitude: Tensor
    cost: float
    misfit: float
    weights: Weights
    model: Tensor
    equations: tuple[Block, np.ndarray, Part]


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
        equations = self.equations_of(number, at, precision, shift)
        weights = Weights(at.weights.good.bool(), at.weights.soft.float()) if self.long else at.weights
        model = evaluation.model.float() if self.long else evaluation.model
        return Looked(here.vehicles.amplitude, cost, at.misfit, weights, model, equations)

    def equations_of(
        self, number: int, at: Linearized, precision: Tensor, shift: Tensor
    ) -> tuple[Block, np.ndarray, Part]:
        """Normal equations of one link that is linearized, as `Assembly.add` takes them.

        Parameters
        ----------
        precision, shift : [parameter], of the priors, and from the state to their means
        """
        link, (own, shared, _) = self.links[number], self._places[number]
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
        return self._block(number, matrix[count:, count:]), right[count:], part

    def dense(self, state: State, at: Sequence[Linearized]) -> tuple[Tensor, Tensor]:
        """Normal matrix [free, free] and right-hand side [free] at a state, from its links' linearizations there."""
        precision, shift = self.prior.precision(state), self.mean - state.vector()
        assembly = Assembly(self.size, len(self.border))
        for number, one in enumerate(at):
            assembly.add(*self.equations_of(number, one, precision, shift))
        matrix, right = assembly.normal(*self.priors(state, precision)).dense()
        where = torch.cat([torch.arange(self.size), self.border, *self.own_places])
        order = torch.argsort(where).numpy()
        return torch.from_numpy(matrix[np.ix_(order, order)]), torch.from_numpy(right[order])

    def visit(self, state: State, before: Sequence[Weights] | None = None) -> Visit:
        """The chain near a state; with amplitudes that fit best by the weights of the visit `before`."""
        precision, shift = self.prior.precision(state), self.mean - state.vector()
        cost, misfit = 0.0, 0.0
        assembly = Assembly(self.size, len(self.border))
        weights, models, amplitudes = [], [], []

        def work(number: int) -> Looked:
            return self.look(number, state, None if before is None else before[number], precision, shift)

        for seen in self.each(work):
            cost, misfit = cost + seen.cost, misfit + seen.misfit
            assembly.add(*seen.equations)
            weights.append(seen.weights)
            models.append(seen.model)
            amplitudes.append(seen.amplitude)
        state = self.with_amplitudes(state, amplitudes)
        normal = assembly.normal(*self.priors(state, precision))
        border = self.stopped(state, self.border, normal.right[self.size :])
        places = zip(self.own_places, normal.parts, strict=True)
        stopped = [self.stopped(state, where, part.right) for where, part in places]
        return Visit(state, cost + self.prior.total(state), misfit, normal, border, stopped, weights, models)

    def rows(self, state: State) -> list[RouteRows]:
        """Rows of the priors on the route: its shape and its anchors; none where it is held."""
        if self.prior.held:
            return []
        return self.prior.route_rows(state)

    def priors(self, state: State, precision: Tensor) -> tuple[list[Block], np.ndarray]:
        """Normal matrices and right-hand side [shared] of the priors on what is shared."""
        return list(self.known(state, precision)), self.pull(state, precision)

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
