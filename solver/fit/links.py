"""Where the small problems along a route have their parameters among those of the whole."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from solver.cable.fiber import GaugeEnds, SplineBasis
from solver.fit.map_fit import MapFit
from solver.fit.numbers import Numbers
from solver.fit.parameter_layout import PER_PASS, of_route
from solver.fit.parameter_prior import ParameterPrior
from solver.fit.problem import Problem
from solver.fit.stretches import is_long, looked_back_at, reach_of
from solver.noise.whitening import Whitener
from solver.trajectory.trajectory_effects import COMMON_ERRORS


@dataclass(frozen=True)
class Link:
    """One small problem of a chain.

    Parameters
    ----------
    fit : the small problem
    stretch : which stretch of fiber it is on
    first : number of its first coefficient in the whole route
    where : [parameter], its parameters among those of the chain
    back : [sample], samples before its own, of the links before, that its noise is told from
    """

    fit: MapFit
    stretch: int
    first: int
    where: Tensor
    back: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))

    @cached_property
    def whiten(self) -> Whitener:
        """Makes the noise of [sample, channel] white, samples looked back at before its own."""
        if not len(self.back):
            return self.fit.whiten
        problem = self.fit.problem
        samples = np.concatenate([self.back, problem.traffic.samples])
        return Whitener(problem.noise, samples, problem.channel, problem.law, len(self.back))

    @cached_property
    def own(self) -> Tensor:
        """Which of its parameters [parameter] no other link has: those of its vehicles."""
        layout = self.fit.layout
        own = torch.zeros(layout.size, dtype=torch.bool)
        own[layout.vehicles] = True
        own[layout["numbers"]] = self.fit.prior.numbers.single
        return own

    @cached_property
    def numbers(self) -> Tensor:
        """Where the chain's vector holds the numbers [number] of its effects."""
        return self.where[self.fit.layout["numbers"]]


def along(basis: SplineBasis, group: Sequence[Problem], stretch: int) -> Iterator[tuple[int, int, MapFit]]:
    """Number of the stretch, of its first coefficient, and the fit of each small problem on it."""
    distance, reach = group[0].distance, reach_of(group[0])
    first, last = basis.interval([distance[0] - reach, distance[-1] + reach]) + np.array([0, 1])
    part = basis.part(first, last)
    ends = GaugeEnds.of(part, distance, group[0].gauge_length, group[0].curved)
    for one in group:
        yield stretch, first, MapFit(one, basis=part, ends=ends)


def numbered(fits: Sequence[tuple[int, int, MapFit]], problem: Problem) -> tuple[list[Tensor], Numbers]:
    """Which of the chain's numbers each link's are, and all of them.

    All links share the numbers of scope "one"; those along fiber and road belong to a stretch, others to a link. So do
    those of `COMMON_ERRORS`, to a stretch: surveys that are fitted together have a camera each.
    """
    mine: list[list[Tensor]] = [[] for _ in fits]
    every, taken = list[Numbers](), dict[tuple[int, int], Tensor]()
    count = 0
    for which, slot in enumerate(fits[0][2].extension.slots):
        for link, (stretch, _, fit) in enumerate(fits):
            one = stretch if slot.effect in COMMON_ERRORS else 0
            key = which, {"one": one, "fiber": stretch, "road": stretch}.get(slot.parameter.scope, link)
            if key not in taken:
                values = fit.extension.numbers()[fit.extension.slots[which].where]
                taken[key] = torch.arange(count, count + len(values))
                count += len(values)
                every.append(Numbers.of_slot(slot, values, problem.prior))
            mine[link].append(taken[key])
    return [torch.cat([torch.zeros(0, dtype=torch.int64), *one]) for one in mine], Numbers.joined(every)


def linked(
    problem: Problem,
    groups: Sequence[Sequence[Problem]],
    basis: SplineBasis,
    held: bool,
    backs: Sequence[NDArray[np.int64]] | None = None,
) -> tuple[ParameterPrior, list[Link]]:
    """Prior of a whole survey and its links, from the small problems of each stretch; `held`: route and ground are."""
    fits = [fit for number, group in enumerate(groups) for fit in along(basis, group, number)]
    if backs is None:
        alone = [np.zeros(0, np.int64)] * len(fits)
        backs = alone if is_long(problem) else looked_back_at(problem, groups[0])
    passes = [one for _, _, fit in fits for one in fit.problem.passes]
    which, numbers = numbered(fits, problem)
    prior = ParameterPrior(basis, problem.prior, passes, problem.anchors, problem.anchor_distance, numbers, held)
    every = torch.arange(prior.layout.size)
    links, leg = [], 0
    for (stretch, first, fit), mine, back in zip(fits, which, backs, strict=True):
        legs = slice(leg, leg + len(fit.passes))
        leg = legs.stop
        where = [
            every[of_route(first, fit.basis.size)],
            *(every[prior.layout[name]][legs] for name in PER_PASS),
            every[prior.layout["poisson_ratio"]],
            every[prior.layout["numbers"]][mine],
        ]
        links.append(Link(fit, stretch, first, torch.cat(where), back))
    return prior, links
