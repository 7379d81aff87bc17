"""What the laws of effects in a model may be off by, and how far that may have moved the route.

A law that is off by a share of its own signal, here more and there less, leaves c_j s g_j in the record: s is what the
effect changes in it, g_j are smooth functions along the fiber, c_j numbers of that share. The record tells some of
them; what it leaves open, and what it tells, the route may have followed: A (P + m m') A' with their posterior mean m
and covariance P, and the moves A of the route with each.
"""

from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from solver.criticism.policy import POLICY
from solver.criticism.route_change import moved_by
from solver.criticism.scorer import Scorer
from solver.effect import Effect

Array = NDArray[np.float64]


def law_errors(scorer: Scorer) -> dict[str, Array]:
    """Covariance [channel, 3, 3], m^2, for what the law of each effect in the model may be off by, by effect.

    Parameters
    ----------
    scorer : at the fit with the effects
    """
    return {one.name: law_error(scorer, signal_of(scorer, one)) for one in scorer.fit.problem.effects}


def signal_of(scorer: Scorer, effect: Effect) -> Tensor:
    """What an effect in the model changes in the record [sample, channel], 1/s."""
    fit, state = scorer.fit, scorer.state
    numbers = state.numbers.clone()
    for slot in scorer.fit.extension.slots:
        if slot.effect is effect and not slot.parameter.is_shape:
            numbers[slot.where] = slot.parameter.null
    return fit.model(state) - fit.model(replace(state, numbers=numbers))


def law_error(scorer: Scorer, signal: Tensor) -> Array:
    """Covariance [channel, 3, 3], m^2, for a law that is off by its tolerance of a signal [sample, channel]."""
    extension = scorer.fit.extension
    assert extension.scopes is not None
    along = extension.scopes.fiber if extension.chosen is None else extension.scopes.fiber[extension.chosen]
    columns = scorer.whitened(signal * along.T[:, None, :])
    left = scorer.project([columns])[0]
    none = torch.eye(len(left.score), dtype=torch.float64)
    precision = none / POLICY.tolerance**2 + left.information / scorer.variance
    covariance = torch.linalg.inv(precision)
    mean = covariance @ left.score / scorer.variance
    values, vectors = torch.linalg.eigh(covariance + torch.outer(mean, mean))
    ways = vectors * values.clamp_min(0).sqrt()
    total = np.zeros((len(scorer.fit.problem.channel), 3, 3))
    for change in scorer.led(columns, ways).unbind(1):
        move = moved_by(scorer, change)
        total += move[:, :, None] * move[:, None, :]
    return total
