"""Which channels are fitted, and which ends are left out."""

from dataclasses import replace

import numpy as np
import pytest

from solver.fit.result import FitResult
from solver.pose import bent_ends

GAUGE, COUNT = 10, 60


@pytest.fixture
def straight(survey) -> FitResult:
    """A straight route of 60 channels that explains its data down to the noise."""
    channel = np.arange(COUNT)
    noise = np.random.default_rng(0).normal(size=(200, COUNT))
    return replace(
        survey.result,
        channel=channel,
        fitted_channel=channel,
        route=np.column_stack([channel * 1.0, np.full(COUNT, 4.0), np.full(COUNT, 0.9)]),
        measured=noise,
        model=np.zeros_like(noise),
        noise=np.ones(COUNT),
        weight=np.ones_like(noise),
    )


def turned(result: FitResult) -> FitResult:
    """The last seven channels turn off by 45 degrees."""
    route = result.route.copy()
    route[-7:, 1] += np.arange(1, 8)
    return replace(result, route=route)


def failing(result: FitResult) -> FitResult:
    """The model misses the last ten channels."""
    measured = result.measured.copy()
    measured[:, -10:] *= 2
    return replace(result, measured=measured)


def test_a_straight_route_keeps_all_channels(straight: FitResult) -> None:
    assert bent_ends(straight, GAUGE) == slice(0, COUNT)


def test_an_end_that_turns_and_fails_is_left_out(straight: FitResult) -> None:
    assert bent_ends(failing(turned(straight)), GAUGE) == slice(0, COUNT - GAUGE)


def test_neither_a_turn_nor_a_misfit_alone_is_a_bend(straight: FitResult) -> None:
    assert bent_ends(turned(straight), GAUGE) == slice(0, COUNT)
    assert bent_ends(failing(straight), GAUGE) == slice(0, COUNT)


def test_a_fiber_of_two_gauge_lengths_is_not_shortened(straight: FitResult) -> None:
    assert bent_ends(failing(turned(straight)), COUNT // 2) == slice(0, COUNT)
