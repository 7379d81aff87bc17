"""Response of gauges to wheels by a law of the ground, summed in one pass of machine code."""

import numpy as np
import torch
from torch import Tensor

from solver.ground.boussinesq import plain_values
from solver.ground.ground_law import Law, Placed, Waves
from solver.ground.wheel_motion import add_derivatives, add_response, arranged, differentiable, spread


def law_response(
    law: Law, point: Tensor, weight: Tensor, place: Tensor, share: Tensor, velocity: Tensor, ratio: Tensor
) -> Tensor | None:
    """What `solver.ground.wheel_motion.gauge_response` gives, by a law.

    None, too, where points differ by row, and where the law has no pass of its own.
    """
    given = spread(point, weight, place, share, velocity, ratio)
    at = None if given is None else placed(given)
    if given is None or at is None:
        return None
    if torch.is_grad_enabled() and any(one.requires_grad for one in given):
        derivatives = law.derived(at, given[-1][0].detach())
        if derivatives is None:
            return None
        add_derivatives(*at, *derivatives)
        return differentiable(given, derivatives)
    found = law.added(at, ratio)
    if found is None:
        return None
    add_response(*at, found)
    return torch.from_numpy(found)


def waves_response(
    waves: Waves, point: Tensor, weight: Tensor, place: Tensor, share: Tensor, velocity: Tensor, time: Tensor
) -> Tensor | None:
    """Sum [row, channel] over points and wheels of weight . velocity of the ground in waves, at times [row, 1].

    None where a derivative is asked for, and as of `law_response`.
    """
    given = spread(point, weight, place, share, velocity, torch.zeros((), dtype=torch.float64))
    at = None if given is None or plain_values(*given, time) is None else placed(given)
    if at is None or time.shape[1] > 1:
        return None
    found = waves.summed(at, np.ascontiguousarray(time[:, 0].numpy()))
    return None if found is None else torch.from_numpy(found)


def placed(given: tuple[Tensor, ...]) -> Placed | None:
    """What `spread` gives, for one pass over points that are the same in all rows; None of others."""
    point, weight, *_, ratio = given
    if any(len(one) > 1 and one.stride(0) > 0 for one in (point, weight, ratio)):
        return None
    return Placed(*arranged((point[:1], weight[:1], *given[2:5], ratio[:1])))
