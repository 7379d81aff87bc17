"""The trial survey in noise, with or without an effect in its record."""

from dataclasses import replace
from typing import Any

import numpy as np
import torch

from solver.catalogue.trial_survey import trial_survey
from solver.effect import Effect
from solver.fit.map_fit import MapFit


def noisy(ratio: float, seed: int, effect: Effect | None = None, size: float = 0.0, **changes: Any) -> MapFit:
    """Its fit, in white noise of which the largest signal is `ratio` sigmas.

    Parameters
    ----------
    effect, size : in the record, and not in the model; of one number
    changes : to the problem
    """
    fit, state = trial_survey()
    record = fit.problem.record.copy()
    if effect is not None:
        grown = MapFit(replace(fit.problem, effects=(effect,)))
        there = replace(state, numbers=torch.tensor([size], dtype=torch.float64))
        record[fit.problem.traffic.samples] = grown.model(there).numpy()
    level = float(np.abs(record).max()) / ratio
    record += level * np.random.default_rng(seed).normal(size=record.shape)
    return MapFit(replace(fit.problem, record=record, noise=torch.full_like(fit.problem.noise, level), **changes))
