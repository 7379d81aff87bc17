"""Basis matrices at the ends of gauges, computed once for each place that is asked for."""

from functools import lru_cache

import torch
from torch import Tensor

from solver.cable.fiber import GaugeEnds, SplineBasis
from solver.ground.boussinesq import plain_values

#: How many places are kept: candidates of a diagnosis share a few.
KEPT = 32


def ends_at(
    basis: SplineBasis, distance: Tensor, gauge_length: Tensor | float, inner: int, held: tuple[Tensor, Tensor] | None
) -> GaugeEnds:
    """`GaugeEnds.at`, kept where no derivative is asked for."""
    asked = [distance, torch.as_tensor(gauge_length, dtype=torch.float64), *(held or ())]
    values = plain_values(*asked)
    if values is None:
        return GaugeEnds.at(basis, distance, gauge_length, inner, held)
    return _known(basis, inner, *((one.shape, one.tobytes()) for one in values))


@lru_cache(maxsize=KEPT)
def _known(basis: SplineBasis, inner: int, *given: tuple[tuple[int, ...], bytes]) -> GaugeEnds:
    distance, gauge, *held = (torch.frombuffer(bytearray(one), dtype=torch.float64).reshape(s) for s, one in given)
    return GaugeEnds.at(basis, distance, gauge, inner, (held[0], held[1]) if held else None)
