"""Measured - model is one thing to the fit, to its result and to what criticizes it."""

from dataclasses import replace

import numpy as np
import torch

from solver.criticism.repairs import unexplained as over_the_record
from solver.fit.map_fit import MapFit
from solver.fit.residual import unexplained


def test_nothing_is_left_and_nothing_pulls_where_nothing_was_measured() -> None:
    measured = torch.tensor([3.0, torch.nan], dtype=torch.float64)
    model = torch.tensor([1.0, 5.0], dtype=torch.float64, requires_grad=True)
    left = unexplained(measured, model, measured.isfinite())
    (slope,) = torch.autograd.grad((left**2).sum(), model)
    assert left.tolist() == [2.0, 0.0] and slope.tolist() == [-4.0, 0.0]


def test_a_fit_and_its_result_leave_the_same(survey) -> None:
    problem = replace(survey.problem, record=survey.problem.record.copy())
    problem.record[survey.result.samples[3], 5] = np.nan
    fit = MapFit(problem)
    state = fit.start()
    result = replace(survey.result, measured=problem.strain_rate.numpy(), model=fit.model(state).numpy())
    left = fit.residual(state).numpy()
    assert np.isnan(result.residual[3, 5]) and left[3, 5] == 0
    np.testing.assert_array_equal(np.nan_to_num(result.residual), left)
    np.testing.assert_array_equal(result.unexplained((slice(None), [4, 6])), result.unexplained()[:, [4, 6]])
    record = over_the_record(fit, state)
    near = np.abs(left) < 50
    np.testing.assert_array_equal(record[result.samples][near], fit.unexplained(fit.model(state)).numpy()[near])
