"""Derivatives of models with a fiber that slips and one more effect on what its gauges sense."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from solver.catalogue.catalogue import built_in
from solver.catalogue.trial_survey import trial_survey
from solver.fit.map_fit import MapFit


@pytest.mark.parametrize("other", ["channel_wander", "slack_spool", "stiffness_contrast", "poisson_gradient"])
@pytest.mark.parametrize("curved", [False, True])
def test_a_fiber_that_slips_and_something_else(other: str, curved: bool) -> None:
    bare, state = trial_survey()
    effects = tuple(built_in()[name] for name in ("conduit_slip", other))
    fit = MapFit(replace(bare.problem, effects=effects, curved=curved))
    rng = np.random.default_rng(3)
    numbers = fit.extension.numbers({"conduit_slip": {"share": 0.7, "place": 1.3, "length": 14.2}})
    for slot in fit.extension.slots:
        if slot.effect.name == other:
            count = slot.where.stop - slot.where.start
            numbers[slot.where] += 0.3 * slot.parameter.plausible * torch.from_numpy(rng.uniform(0.3, 1, count))
    state = replace(state, numbers=numbers)
    evaluation = fit.evaluate(state)
    jacobian, vector = fit.jacobian(state, evaluation.local, evaluation.values), state.vector()
    size, first = fit.layout["route"].stop, fit.layout["numbers"].start
    for column in [*rng.choice(size, 5, replace=False), *range(size, first, 5), *range(first, len(vector), 2)]:
        step = 1e-5 * max(abs(float(vector[column])), 0.1)
        ahead, behind = vector.clone(), vector.clone()
        ahead[column] += step
        behind[column] -= step
        numeric = (fit.model(state.moved(ahead)) - fit.model(state.moved(behind))) / (2 * step)
        expected = jacobian[column]
        rounding = 1e-14 * float(evaluation.model.abs().max()) / step
        torch.testing.assert_close(numeric, expected, rtol=1e-3, atol=2e-4 * float(expected.abs().max()) + rounding)
