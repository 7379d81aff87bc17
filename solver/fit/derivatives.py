"""Derivatives of the strain-rate map by an effect's parameters, by forward-mode automatic differentiation."""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.func import jvp

from solver.extension import Slot, Values
from solver.model import Fiber, SignalPath, Vehicles


@dataclass(frozen=True)
class Seen:
    """A model at a state, with what its derivatives share.

    Parameters
    ----------
    path : with the effects
    fiber : of the effects' values
    vehicles, poisson_ratio : of the state
    alone : [sample, computed channel], map before whatever acts on the whole of it, 1/s
    """

    path: SignalPath
    fiber: Callable[[Values], Fiber]
    vehicles: Vehicles
    poisson_ratio: Tensor
    alone: Tensor


def observed_tangents(path: SignalPath, alone: Tensor, tangents: Tensor, values: Values) -> Tensor:
    """What interrogator and processing make of small changes [column, sample, computed channel] of a map."""
    stages = path.described(values)
    if not stages.nonlinear and not stages.processing.steps:
        return path.observed(tangents, values)
    base = alone.expand_as(tangents)
    return jvp(lambda m: path.observed(m, values), (base,), (tangents,))[1]


def derivative(seen: Seen, slot: Slot, numbers: Tensor) -> Tensor:
    """Derivative of the observed map by the numbers of one parameter, [number, sample, channel].

    What a row or a channel feels depends on the parameter's value there alone, so that one forward pass with the
    tangent 1 everywhere holds the derivatives by all numbers.
    """
    path, extension = seen.path, seen.path.extension
    values = extension.local(numbers)
    effect, name, scope = slot.effect, slot.parameter.name, slot.parameter.scope
    here = values[effect.name][name]

    def changed(value: Tensor) -> dict[str, dict[str, Tensor]]:
        return {**values, effect.name: {**values[effect.name], name: value}}

    def rows(value: Tensor) -> Tensor:
        new = changed(value)
        return path.rows(seen.fiber(new), seen.vehicles.rows(path.traffic), seen.poisson_ratio, new)

    one = torch.ones_like(here)
    if scope == "one":
        if effect.stage in ("interrogator", "processing", "ground", "cable") and not acts_on_rows(seen, slot, values):
            return jvp(lambda v: path.observed(seen.alone, changed(v)), (here,), (one,))[1][None]
        whole = jvp(lambda v: path.observed(path.traffic.superpose(rows(v)), changed(v)), (here,), (one,))[1]
        return whole[None]
    tangent = jvp(rows, (here,), (one,))[1]
    assert extension.scopes is not None
    if scope == "fiber":
        columns = path.traffic.superpose(tangent)[None] * extension.scopes.fiber.T[:, None, :]
    else:
        spread = extension.scopes.rows[scope]
        columns = torch.stack([path.traffic.superpose(tangent * c[:, None]) for c in spread.unbind(1)])
    return observed_tangents(path, seen.alone, columns, values)


def acts_on_rows(seen: Seen, slot: Slot, values: Values) -> bool:
    """Whether an effect changes what single vehicles do to single channels, and not just the whole map."""
    extension = seen.path.extension
    alone = type(extension)(
        (slot.effect,), extension.surroundings, extension.scopes, extension.chosen, extension.time
    ).described(values, seen.path.gauge_length)
    assert extension.surroundings is not None
    return alone.in_rows or alone.cable.distance is not extension.surroundings.distance
