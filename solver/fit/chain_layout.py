"""Which problems of a chain hang together, and where the chain's numbers hold what is of each and what they share."""

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor

from solver.fit.parameter_prior import ParameterPrior
from solver.fit.parameter_space import ParameterSpace
from solver.fit.problem import Problem
from solver.fit.state import State
from solver.fit.stretches import is_long

if TYPE_CHECKING:
    from solver.fit.links import Link


class ChainLayout(ParameterSpace):
    """The numbers of a chain of small problems along one route.

    Parameters
    ----------
    links : of the whole survey
    prior : on all that is fitted
    problem : the whole survey
    """

    def __init__(self, problem: Problem, prior: ParameterPrior, links: "Sequence[Link]"):
        super().__init__(problem, prior)
        self.links = list(links)

    @property
    def long(self) -> bool:
        """Whether the route is fitted stretch by stretch: vehicles, weights and noise of each are its own."""
        return len(self.links) > 1 and is_long(self.problem)

    @property
    def edges(self) -> np.ndarray:
        """Distances [stretch + 1] along the fiber, m, at which each stretch begins and the last ends."""
        first = {link.stretch: float(link.fit.problem.distance[0]) for link in self.links}
        return np.array([self.basis.start, *list(first.values())[1:], self.basis.stop])

    def stretch_of(self, distance: np.ndarray) -> np.ndarray:
        """Numbers of the stretches in which places [place] along the fiber, m, lie."""
        return np.searchsorted(self.edges[1:-1], distance)

    @cached_property
    def convoys(self) -> list[list[int]]:
        """Links whose noise hangs together."""
        found: list[list[int]] = []
        for number, link in enumerate(self.links):
            if len(link.back):
                found[-1].append(number)
            else:
                found.append([number])
        return found

    @cached_property
    def groups(self) -> list[list[int]]:
        """Numbers of convoys that are weighed together: all of a survey, but on a long fiber each by itself."""
        every = list(range(len(self.convoys)))
        survey = {one: one if self.long else self.links[self.convoys[one][0]].stretch for one in every}
        return [[one for one in every if survey[one] == key] for key in dict.fromkeys(survey.values())]

    def links_of(self, group: Sequence[int]) -> list[int]:
        """Numbers of the links of some convoys."""
        return [number for convoy in group for number in self.convoys[convoy]]

    def part_of(self, state: State, link: "Link") -> State:
        """The state of one link."""
        return link.fit.state_of(state.vector()[link.where])

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
    def _places(self) -> list[tuple[Tensor, Tensor]]:
        """Of each convoy: free parameters that no other has, and those that it shares in the order of its block."""
        places = []
        for convoy in self.convoys:
            links = [self.links[number] for number in convoy]
            own = torch.cat([link.where[link.own & self.free[link.where]] for link in links])
            shared = links[0].where[~links[0].own & self.free[links[0].where]]
            places.append((own, shared))
        return places

    @property
    def own_places(self) -> list[Tensor]:
        """Of each convoy, where the chain holds the free parameters that no other has."""
        return [own for own, _ in self._places]

    @cached_property
    def slots(self) -> list[Tensor]:
        """Where the chain's numbers hold each parameter of the effects."""
        first, places = self.layout["numbers"].start, []
        for which, _ in enumerate(self.links[0].fit.extension.slots):
            every = [link.numbers[link.fit.extension.slots[which].where] for link in self.links]
            places.append(torch.unique(torch.cat(every)) - first)
        return places

    def rank(self, where: Tensor) -> np.ndarray:
        """Which of the border some of its parameters [where] are."""
        return np.searchsorted(self.border.numpy(), where.numpy())
