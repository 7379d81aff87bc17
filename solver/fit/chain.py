"""A survey of any length as a chain of small problems that share one route: linear in the length of the fiber.

A camera's view is a chain of one. On a longer fiber each stretch and each crowd of vehicles in it is a problem of its
own (`solver.fit.stretches`), with the noise taken for independent between them; the route's spline runs through all.
"""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from typing import TypeVar

import numpy as np
import torch
from torch import Tensor

from solver.cable.fiber import SplineBasis
from solver.fit.chain_layout import ChainLayout
from solver.fit.convoy import Glance, Sums, best_amplitudes, glances, jacobians, settled, weighed, whitened
from solver.fit.links import Link, linked
from solver.fit.map_fit import MapFit
from solver.fit.normal import Assembly
from solver.fit.normal_parts import Block, Part
from solver.fit.parameter_layout import of_route
from solver.fit.parameter_prior import RouteRows
from solver.fit.problem import Problem
from solver.fit.robust import HUBER, SPIKE
from solver.fit.state import Linearized, State, Weights
from solver.fit.stretches import parts
from solver.fit.visit import Looked, Visit

T = TypeVar("T")
THREADS = 2


@contextmanager
def one_thread_each(many: bool) -> Iterator[None]:
    """Where links are worked on side by side, each has one thread."""
    before = torch.get_num_threads()
    torch.set_num_threads(1 if many else before)
    try:
        yield
    finally:
        torch.set_num_threads(before)


class Chain(ChainLayout):
    """Small problems along one route, fitted together.

    Parameters
    ----------
    links : of the whole survey
    prior : on all that is fitted
    problem : the whole survey
    """

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

    def each(self, work: Callable[[list[int]], T]) -> Iterator[T]:
        """Results of a work on each group of convoys, in order; those of a long chain side by side."""
        with one_thread_each(self.long):
            if not self.long:
                yield from map(work, self.groups)
                return
            with ThreadPoolExecutor(THREADS) as pool:
                yield from pool.map(work, self.groups)

    def begun(self, state: State) -> State:
        """The same vehicles with the amplitudes that fit best; along a long fiber the first visit finds them.

        To look twice at all stretches would be slow.
        """
        return state if self.long else self.settled(state)[0]

    def settled(self, state: State) -> tuple[State, float]:
        """A state with the amplitudes that fit best where every sample counts, and its cost then."""
        links = self.links  # Amplitudes of several surveys do not meet: all at once is each by itself.
        every = [Weights(one, one) for one in (link.fit.measured.double() for link in links)]
        if len(links) == 1:
            return links[0].fit.settled_at(state, every[0])
        states = [self.part_of(state, link) for link in links]
        rows = ((link.fit, link.fit.values(one), one) for link, one in zip(links, states, strict=True))
        maps = (fit.alone(fit.unit_rows(one, values), values) for fit, values, one in rows)
        amplitudes, left = best_amplitudes(links, maps, every)
        state = self.with_amplitudes(state, amplitudes)
        return state, sum(float((one**2).sum()) for one in left) + self.prior.total(state)

    def unsettled(self, state: State) -> list[Weights] | None:
        """Weights to settle the amplitudes of a start by; None where they are settled."""
        if not self.long or bool((state.vehicles.amplitude != 1).any()):
            return None
        return [Weights(link.fit.measured, link.fit.measured.float()) for link in self.links]

    def with_amplitudes(self, state: State, amplitudes: Sequence[Tensor]) -> State:
        """The same state with the amplitudes [pass] of each link."""
        return replace(state, vehicles=replace(state.vehicles, amplitude=torch.cat(list(amplitudes))))

    def cost(self, visit: Visit) -> float:
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

    def misfits(self, visit: Visit, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Chi2 [place] of samples and anchors, and the samples' weights [place], between edges [place + 1], m."""
        count = len(edges) - 1
        chi2, weight = np.zeros(count), np.zeros(count)
        for link, residual, weights in zip(self.links, visit.residuals, visit.weights, strict=True):
            at = np.searchsorted(edges[1:-1], link.fit.problem.distance)
            chi2 += np.bincount(at, (residual**2).sum(0), count)
            weight += np.bincount(at, (weights.good * weights.soft).sum(0), count)
        if not self.prior.held and len(self.prior.anchors):
            at = np.searchsorted(edges[1:-1], self.prior.anchor_distance)
            chi2 += np.bincount(at, self.prior.anchor_misfit(visit.state), count)
        return chi2, weight

    def stopped(self, state: State, where: Tensor, push: np.ndarray) -> np.ndarray:
        """Which of some parameters [where] of a state are at a bound that they are pushed [where] against."""
        lower, upper = (one[where].numpy() for one in self.prior.bounds)
        at = state.vector()[where].numpy()
        return np.asarray(((at <= lower) & (push < 0)) | ((at >= upper) & (push > 0)))

    def look(
        self,
        group: Sequence[int],
        state: State,
        before: Sequence[Weights] | None,
        pull: tuple[Tensor, Tensor],
        most: float = float("inf"),
    ) -> Looked | None:
        """Some convoys near the chain's `state` [parameter]; amplitudes settled by the weights `before` of all links.

        Parameters
        ----------
        pull : [parameter] of the priors: their precision, and the way from the state to their means
        most : cost, with priors where this is all of the chain, beyond which there are no equations: None is returned
        """
        numbers = self.links_of(group)
        links = [self.links[number] for number in numbers]
        seen = glances(links, [self.part_of(state, link) for link in links])
        cost, old = 0.0, None if before is None else [before[number] for number in numbers]
        if old is not None:
            seen = settled(seen, old)
            maps = [one.link.fit.unexplained(one.evaluation.model) for one in seen]
            left = whitened(links, (one * w.good for one, w in zip(maps, old, strict=True)))
            cost = sum(float((one**2 * w.soft).sum()) for one, w in zip(left, old, strict=True))
            if cost + self.known_priors(group, state, seen) > most:
                return None
        weights, residuals = weighed(links, seen, old)
        if old is None:
            cost = sum(float((one**2).sum()) for one in residuals)
        every = zip(jacobians(seen, weights, self.free), residuals, strict=True)
        equations = []
        for convoy in group:
            sums = Sums(*self._places[convoy])
            for _ in self.convoys[convoy]:
                (where, jacobian), residual = next(every)
                sums.add(where, jacobian, residual.flatten())
            equations.append(self.equations_of(convoy, sums, *pull))
        models = [one.evaluation.model for one in seen]
        if self.long:
            weights = [Weights(w.good.bool(), w.soft.float()) for w in weights]
            models = [one.float() for one in models]
        return Looked([one.state.vehicles.amplitude for one in seen], cost, weights, models, residuals, equations)

    def known_priors(self, group: Sequence[int], state: State, seen: Sequence[Glance]) -> float:
        """What the priors cost at a state with the amplitudes of some convoys, where these are all; else at least 0."""
        if len(group) < len(self.convoys):
            return 0.0
        return self.prior.total(self.with_amplitudes(state, [one.state.vehicles.amplitude for one in seen]))

    def equations_of(self, convoy: int, sums: Sums, precision: Tensor, shift: Tensor) -> tuple[Block, np.ndarray, Part]:
        """Normal equations of a convoy, priors on what is its own included, as `Assembly.add` takes them."""
        link = self.links[self.convoys[convoy][0]]
        known = precision[sums.own].numpy()
        right = sums.right + known * shift[sums.own].numpy()
        part = Part(sums.matrix + np.diag(known), sums.cross, right, known, link.stretch)
        border = self.rank(sums.shared[sums.shared >= self.layout["route"].stop])
        first = of_route(link.first, 0).start if self.size else 0
        return Block(first, len(sums.shared) - len(border), border, sums.block), sums.shared_right, part

    def dense(self, state: State, at: Sequence[Linearized]) -> tuple[Tensor, Tensor]:
        """Normal matrix [free, free] and right-hand side [free] at a state, from its links' linearizations there.

        No link may look back at another.
        """
        precision, shift = self.prior.precision(state), self.mean - state.vector()
        assembly = Assembly(self.size, len(self.border))
        for number, (link, one) in enumerate(zip(self.links, at, strict=True)):
            sums, free = Sums(*self._places[number]), self.free[link.where]
            sums.add(link.where[free], one.jacobian.taking(free[link.fit.free]), one.residual)
            assembly.add(*self.equations_of(number, sums, precision, shift))
        matrix, right = assembly.normal(*self.priors(state, precision)).dense()
        where = torch.cat([torch.arange(self.size), self.border, *self.own_places])
        order = torch.argsort(where).numpy()
        return torch.from_numpy(matrix[np.ix_(order, order)]), torch.from_numpy(right[order])

    def visit(self, state: State, before: Sequence[Weights] | None = None) -> Visit:
        """The chain near a state; with amplitudes that fit best by the weights of the visit `before`."""
        found = self.tried(state, before, float("inf"))
        assert found is not None
        return found

    def tried(self, state: State, before: Sequence[Weights] | None, most: float) -> Visit | None:
        """The same; None, and no derivatives, where it costs more than `most`, as far as convoys tell one by one."""
        precision, shift = self.prior.precision(state), self.mean - state.vector()
        cost, misfit = 0.0, 0.0
        assembly = Assembly(self.size, len(self.border))
        weights, models, residuals, amplitudes = [], [], [], []

        def work(group: list[int]) -> Looked | None:
            return self.look(group, state, before, (precision, shift), most)

        for seen in self.each(work):
            if seen is None:
                return None
            cost, misfit = cost + seen.cost, misfit + seen.misfit
            for equations in seen.equations:
                assembly.add(*equations)
            weights += seen.weights
            models += seen.models
            residuals += seen.residuals
            amplitudes += seen.amplitudes
        state = self.with_amplitudes(state, amplitudes)
        normal = assembly.normal(*self.priors(state, precision))
        border = self.stopped(state, self.border, normal.right[self.size :])
        places = zip(self.own_places, normal.parts, strict=True)
        stopped = [self.stopped(state, where, part.right) for where, part in places]
        return Visit(state, cost + self.prior.total(state), misfit, normal, border, stopped, weights, models, residuals)

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
            yield Block(one.route.start, one.count, self.rank(one.other), one.gram)
        yield Block(0, 0, np.arange(len(self.border)), np.diag(precision[self.border].numpy()))

    def pull(self, state: State, precision: Tensor) -> np.ndarray:
        """Right-hand side [shared] of the priors on what is shared."""
        right = np.zeros(self.size + len(self.border))
        right[self.size :] = (precision * (self.mean - state.vector()))[self.border].numpy()
        for one in self.rows(state):
            where = np.concatenate([np.arange(one.route.start, one.route.stop), self.size + self.rank(one.other)])
            right[where] -= (one.rows.jacobian.T @ one.rows.residual).numpy()
        return right

    def stepped(self, state: State, step: tuple[np.ndarray, list[np.ndarray]]) -> State:
        """The state after a step of `Normal.step`."""
        vector, (shared, own) = state.vector().clone(), step
        vector[: self.size] += torch.from_numpy(shared[: self.size])
        vector[self.border] += torch.from_numpy(shared[self.size :])
        for mine, part in zip(self.own_places, own, strict=True):
            vector[mine] += torch.from_numpy(part)
        return self.bounded(state.moved(vector))
