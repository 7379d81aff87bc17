"""Derivatives of the strain-rate map by an effect's parameters, by forward-mode automatic differentiation."""

from dataclasses import replace
from functools import partial

import torch
from torch import Tensor
from torch.func import jvp

from solver.signal_path.autodiff import pushed
from solver.signal_path.extension import Slot, Values
from solver.signal_path.local import Seen
from solver.signal_path.shortcuts import SHORTCUTS, placements
from solver.signal_path.signal_path import SignalPath

#: Columns that are filtered at once.
COLUMNS = 16


def observed_tangents(path: SignalPath, alone: Tensor, tangents: Tensor, values: Values) -> Tensor:
    """What interrogator and processing make of small changes [column, sample, computed channel] of a map."""
    stages = path.described(values)
    plain = not stages.nonlinear and not stages.processing.steps

    def seen(some: Tensor) -> Tensor:
        if plain:
            return path.observed(some, values)
        return jvp(lambda m: path.observed(m, values), (alone.expand_as(some).clone(),), (some.contiguous(),))[1]

    # Spectra of all columns at once would not fit into memory.
    return torch.cat([seen(some) for some in tangents.split(COLUMNS)])


def derivative(seen: Seen, slot: Slot, numbers: Tensor) -> Tensor:
    """Derivative of the observed map by the numbers of one parameter, [number, sample, channel].

    What a row or a channel feels depends on the parameter's value there alone, so that one forward pass with the
    tangent 1 everywhere holds the derivatives by all numbers.
    """
    path, extension = seen.path, seen.path.extension
    values = extension.local(numbers)
    effect, p, scope = slot.effect, slot.parameter, slot.parameter.scope

    def changed(name: str, value: Tensor) -> dict[str, dict[str, Tensor]]:
        return {**values, effect.name: {**values[effect.name], name: value}}

    def rows(new: Values) -> Tensor:
        return path.rows(seen.fiber(new, 0), seen.local.vehicles.rows(path.traffic), seen.local.poisson_ratio, new)

    def tangent(name: str) -> Tensor:
        found = SHORTCUTS[effect.stage](seen, partial(changed, name), values[effect.name][name])
        if found is not None:
            return found
        here = values[effect.name][name]
        return jvp(lambda v: rows(changed(name, v)), (here,), (torch.ones_like(here),))[1]

    def spread(by_row: Tensor, matrix: Tensor) -> Tensor:
        return torch.stack([path.traffic.superpose(by_row * c[:, None]) for c in matrix.unbind(1)])

    here, change = values[effect.name][p.name], partial(changed, p.name)
    one = torch.ones_like(here)
    assert extension.scopes is not None
    ways = [one] if scope == "one" else [w.reshape(here.shape) for w in extension.scopes.along(scope).unbind(1)]
    if not acts_on_rows(seen, slot, values):
        return torch.stack([pushed(lambda v: path.observed(seen.local.alone, change(v)), here, way) for way in ways])
    if effect.stage == "cable" and (placed := placements(seen, change, here, ways)) is not None:
        return observed_tangents(path, seen.local.alone, placed, values)
    if scope == "one":
        whole = SHORTCUTS[effect.stage](seen, change, here)
        if whole is None:
            every = jvp(lambda v: path.observed(path.traffic.superpose(rows(change(v))), change(v)), (here,), (one,))
            return every[1][None]
        columns = path.traffic.superpose(whole)[None]
    elif scope == "fiber":
        columns = path.traffic.superpose(tangent(p.name))[None] * extension.scopes.fiber.T[:, None, :]
    else:
        columns = spread(tangent(p.name), extension.scopes.rows[scope])
        if p.rated:
            columns = columns + spread(tangent(p.rate_name), extension.scopes.rates[scope])
    return observed_tangents(path, seen.local.alone, columns, values)


def acts_on_rows(seen: Seen, slot: Slot, values: Values) -> bool:
    """Whether an effect changes what single vehicles do to single channels, and not just the whole map."""
    if slot.effect.stage in ("trajectory", "load"):
        return True
    alone = replace(seen.path.extension, effects=(slot.effect,)).described(values, seen.path.gauge_length)
    return alone.in_rows or alone.cable.moved
