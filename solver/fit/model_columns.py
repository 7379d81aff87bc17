"""Derivatives of a fit's model by all that is fitted, a few at a time: of all at once they would take gigabytes."""

from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor

from solver.fit.parameter_layout import PER_PASS
from solver.fit.route_response import RouteResponse
from solver.fit.state import State
from solver.signal_path.derivatives import derivatives, observed_tangents
from solver.signal_path.extension import Values
from solver.signal_path.few import few_of
from solver.signal_path.gauges import route_jacobian
from solver.signal_path.local import Local, Section, Seen
from solver.signal_path.sensitivities import Sensitivities
from solver.signal_path.traffic import Traffic

if TYPE_CHECKING:
    from solver.fit.map_fit import MapFit


def columns(
    fit: "MapFit", state: State, local: Sensitivities, values: Values, section: Section | None = None
) -> Iterator[Tensor]:
    """Derivative of a fit's model by every parameter, [parameter, sample, channel], 1/s per unit, a few at a time.

    Parameters
    ----------
    local : of the rows of the section
    values : of the effects' parameters at each row and channel
    section : the samples that are wanted, where each depends on the vehicles at it alone; all where None
    """
    path, traffic = fit.path, fit.path.traffic
    if section is not None:
        traffic = traffic.take(np.arange(section.samples.start, section.samples.stop))
        values = fit.extension.within(values, section.samples)
    base = base_columns(fit, state, local, values, traffic)
    if not fit.extension.effects:
        yield from base
        return
    gauges = partial(fit.gauges_at, path, state.coefficients)
    rows = state.vehicles.rows(path.traffic)
    here = Local(path, gauges, rows, state.poisson_ratio, values, section, known=local)
    stages, alone = path.described(values), here.alone
    for some in base:
        yield observed_tangents(stages, alone, some, lambda maps: stages.observed(maps, traffic.samples))
    for slot in fit.extension.slots:
        yield from derivatives(Seen(path, gauges, here), slot, state.numbers)


def base_columns(
    fit: "MapFit", state: State, local: Sensitivities, values: Values, traffic: Traffic
) -> Iterator[Tensor]:
    """Derivative of what the ground does by all but the effects' numbers, before stages that act on whole maps."""
    shape = len(traffic.samples), local.alone.shape[1]
    few = few_of(shape[0] * shape[1])
    yield from route_columns(fit, state, local, values, traffic, few)
    for name in PER_PASS:
        moved = local.vehicle(name)
        for some in torch.arange(traffic.passes).split(few):
            mine = ((traffic.pass_index >= some[0]) & (traffic.pass_index <= some[-1])).nonzero()[:, 0]
            out = torch.zeros(len(some), *shape, dtype=torch.float64)
            out[traffic.pass_index[mine] - some[0], traffic.sample_index[mine]] += moved[mine]
            yield out
    yield traffic.superpose(local.poisson_ratio)[None]


def route_columns(
    fit: "MapFit", state: State, local: Sensitivities, values: Values, traffic: Traffic, few: int
) -> Iterator[Tensor]:
    """Derivative of the model by the route's coefficients, [3 coefficient, sample, channel], about `few` at a time."""
    path, stages = fit.path, fit.path.described(values)
    jacobian = route_jacobian(fit.ends_of(path, stages), state.coefficients, stages, path.curved)
    response, each = RouteResponse(local, *jacobian), max(1, few // 3)
    for first in range(0, len(state.coefficients), each):
        yield response.maps(slice(first, first + each), traffic.sample_index, len(traffic.samples))
