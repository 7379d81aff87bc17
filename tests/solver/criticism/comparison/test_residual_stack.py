"""Stacks in the vehicle's frame, on records written out."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from solver.criticism.comparison.cells import Approach, strength
from solver.criticism.comparison.stack import GROUPS, REACH, WIDTH, stack_of

SAMPLES, CHANNELS, SPEED = 60, 40, 10.0


def shape(ahead: np.ndarray) -> np.ndarray:
    return -ahead * np.exp(-((ahead / 6) ** 2))


@pytest.fixture
def made() -> tuple[Any, Any]:
    """One vehicle at 10 m/s over 40 channels a meter apart, in a record that is a tenth louder than its model."""
    x = np.arange(CHANNELS, dtype=float)
    place = np.linspace(-10, 50, SAMPLES)
    ahead = np.round(x - place[:, None]) + 0.0  # whole meters: in the middle of the stack's bins
    model = 3.0 * shape(ahead)
    approach = Approach(
        np.zeros(ahead.shape, int), ahead, np.abs(ahead), np.full(ahead.shape, SPEED), np.zeros(1), np.array([True])
    )
    there = np.ones(ahead.shape, bool)
    cells = SimpleNamespace(approach=approach, there=there)
    result = SimpleNamespace(
        fitted_channel=100 + np.arange(CHANNELS),
        weight=np.ones(ahead.shape),
        noise=np.linspace(1.0, 2.0, CHANNELS),
        measured=1.1 * model,
        model=model,
    )
    return SimpleNamespace(result=result, passes=[SimpleNamespace()]), cells


def test_the_model_stacks_to_its_own_shape(made: tuple[Any, Any]) -> None:
    stack = stack_of(*made)
    expected = shape(stack.ahead) / np.abs(shape(stack.ahead)).max()
    seen = np.isfinite(stack.model[0])
    np.testing.assert_allclose(stack.model[0][seen], expected[seen], atol=1e-12)
    assert seen[np.abs(stack.ahead) < 30].all()


def test_a_gain_leaves_its_share_of_the_model(made: tuple[Any, Any]) -> None:
    stack = stack_of(*made)
    np.testing.assert_allclose(stack.residual, 0.1 * stack.model, atol=1e-12)
    np.testing.assert_allclose(stack.antisymmetric[0], stack.residual[0], atol=1e-9)
    assert np.nanmax(np.abs(stack.symmetric[0])) < 1e-9


def test_bins_are_symmetric_about_the_vehicle(made: tuple[Any, Any]) -> None:
    ahead = stack_of(*made).ahead
    np.testing.assert_allclose(ahead, -ahead[::-1], atol=1e-12)
    np.testing.assert_allclose(np.diff(ahead), WIDTH)
    assert ahead[-1] == REACH


def test_groups_of_channels_follow_on_all_of_them(made: tuple[Any, Any]) -> None:
    stack = stack_of(*made)
    assert stack.channels.tolist() == [[100, 139], [100, 109], [110, 119], [120, 129], [130, 139]]
    assert stack.residual.shape == (GROUPS + 1, len(stack.ahead))


def test_sigma_is_that_of_least_squares_in_noise(made: tuple[Any, Any]) -> None:
    """A bin's value is sum(A d / s^2) / sum(A^2 / s^2), of variance 1 / sum(A^2 / s^2)."""
    run, cells = made
    stack = stack_of(run, cells)
    drive = strength(run, cells)
    at = int(np.flatnonzero(stack.ahead == 4.0)[0])
    inside = cells.approach.ahead == 4.0
    noise = np.broadcast_to(run.result.noise, inside.shape)
    norm = float((drive[inside] ** 2 / noise[inside] ** 2).sum())
    raw = float((drive[inside] * run.result.model[inside] / noise[inside] ** 2).sum()) / norm
    peak = raw / stack.model[0, at]
    assert stack.sigma[0, at] == pytest.approx(norm**-0.5 / peak)


def test_what_was_not_measured_is_in_no_bin(made: tuple[Any, Any]) -> None:
    run, cells = made
    cells.there[:, 10:20] = False
    run.result.measured = np.where(cells.there, run.result.measured, np.nan)
    stack = stack_of(run, cells)
    assert np.isnan(stack.measured[2]).all(), "the second group was all of it"
    seen = np.isfinite(stack.residual[0])
    np.testing.assert_allclose(stack.residual[0][seen], 0.1 * stack.model[0][seen], atol=1e-12)


def test_strength_is_the_models_root_mean_square_per_speed_times_the_speed(made: tuple[Any, Any]) -> None:
    run, cells = made
    near = cells.approach.near
    expected = float(np.sqrt((run.result.model[near] ** 2).mean()))
    np.testing.assert_allclose(strength(run, cells), expected)
    cells.approach.speed[5] *= 2
    found = strength(run, cells)
    assert found[5, 0] == pytest.approx(2 * found[6, 0])
    cells.approach.owner[7], cells.approach.gap[7], cells.approach.speed[7] = -1, np.inf, np.nan
    assert (strength(run, cells)[7] == 0).all()
