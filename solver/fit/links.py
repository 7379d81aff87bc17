"""Where the small problems along a route have their parameters among those of the whole."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from solver.cable.fiber import GaugeEnds, SplineBasis
from solver.fit.map_fit import MapFit
from solver.fit.parameter_prior import ParameterPrior, number_sd
from solver.fit.problem import Problem
from solver.fit.state import PER_PASS
from solver.fit.stretches import reach_of
from solver.trajectory.vehicle_pass import Pass


@dataclass(frozen=True)
class Link:
    """One small problem of a chain.

    Parameters
    ----------
    fit : the small problem
    stretch : which stretch of fiber it is on
    first : number of its first coefficient in the whole route
    where : [parameter], its parameters among those of the chain
    own : [parameter] bool, which of them no other link has
    """

    fit: MapFit
    stretch: int
    first: int
    where: Tensor
    own: Tensor


def along(basis: SplineBasis, group: Sequence[Problem], stretch: int) -> Iterator[tuple[int, int, MapFit]]:
    """Number of the stretch, of its first coefficient, and the fit of each small problem on it."""
    distance, reach = group[0].distance, reach_of(group[0])
    first = int(np.clip(np.floor((distance[0] - reach - basis.start) / basis.step), 0, basis.intervals - 1))
    last = int(np.clip(np.ceil((distance[-1] + reach - basis.start) / basis.step), first + 1, basis.intervals))
    part = basis.part(first, last)
    ends = GaugeEnds.of(part, distance, group[0].gauge_length, group[0].curved)
    for one in group:
        yield stretch, first, MapFit(one, basis=part, ends=ends)


def layout(
    basis: SplineBasis, fits: Sequence[tuple[int, int, MapFit]], passes: Sequence[Pass], problem: Problem
) -> tuple[list[Tensor], Tensor, Tensor, Tensor]:
    """Where each link's parameters are among all; means, standard deviations of the numbers, and which are of passes.

    All links share Poisson's ratio and the numbers of scope "one"; those along fiber and road belong to a stretch.
    """
    route, legs = 3 * basis.size, len(passes)
    after = route + len(PER_PASS) * legs
    slots = fits[0][2].extension.slots
    numbers: list[list[Tensor]] = [[] for _ in fits]
    mean, sd, own, taken = [], [], [], dict[tuple[int, int], Tensor]()
    count = 0
    for which, slot in enumerate(slots):
        scope = slot.parameter.scope
        for link, (stretch, _, fit) in enumerate(fits):
            key = which, {"one": 0, "fiber": stretch, "road": stretch}.get(scope, link)
            if key not in taken:
                values = fit.extension.numbers()[fit.extension.slots[which].where]
                taken[key] = torch.arange(count, count + len(values))
                count += len(values)
                mean.append(values)
                sd.append(torch.full_like(values, number_sd(slot, problem.prior)))
                own.append(torch.full((len(values),), scope in ("pass", "track")))
            numbers[link].append(after + 1 + taken[key])
    where, leg = [], 0
    for (_, first, fit), mine in zip(fits, numbers, strict=True):
        vehicles = torch.arange(leg, leg + len(fit.problem.passes))
        leg += len(vehicles)
        quantities = [route + number * legs + vehicles for number in range(len(PER_PASS))]
        spline = torch.arange(3 * first, 3 * (first + fit.basis.size))
        where.append(torch.cat([spline, *quantities, torch.tensor([after]), *mine]))
    none = [torch.zeros(0, dtype=torch.float64)]
    return where, torch.cat(mean or none), torch.cat(sd or none), torch.cat(own or [torch.zeros(0, dtype=torch.bool)])


def linked(
    problem: Problem, groups: Sequence[Sequence[Problem]], basis: SplineBasis, held: bool
) -> tuple[ParameterPrior, list[Link]]:
    """Prior of a whole survey and its links, from the small problems of each stretch; `held`: route and ground are."""
    fits = [fit for number, group in enumerate(groups) for fit in along(basis, group, number)]
    passes = [one for _, _, fit in fits for one in fit.problem.passes]
    where, numbers, sd, own = layout(basis, fits, passes, problem)
    prior = ParameterPrior(
        basis, problem.prior, passes, problem.anchors, problem.anchor_distance, numbers, sd, own, held
    )
    first_number = len(prior.mean) - len(numbers)
    links = []
    for (stretch, first, fit), at in zip(fits, where, strict=True):
        mine = torch.zeros(len(at), dtype=torch.bool)
        route, after = 3 * fit.basis.size, 3 * fit.basis.size + len(PER_PASS) * len(fit.problem.passes)
        mine[route:after] = True
        mine[after + 1 :] = own[at[after + 1 :] - first_number]
        links.append(Link(fit, stretch, first, at, mine))
    return prior, links
