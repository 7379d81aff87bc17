"""The compiled response of gauges to forces that push and change against PyTorch's own derivatives of the laws."""

import pytest
import torch

from solver.ground.boussinesq import displacement
from solver.ground.force_motion import forces_response
from solver.ground.lanes import LANES
from solver.ground.tangential import tangential_displacement, tangential_displacement_rate

ROWS, POINTS, WHEELS = 3, 2, 4


def drawn(channels: int) -> list[torch.Tensor]:
    """Arguments of `forces_response`, each with what it may leave out."""
    random = torch.Generator().manual_seed(3)

    def one(*shape: int) -> torch.Tensor:
        return torch.rand(*shape, generator=random, dtype=torch.float64)

    return [
        20 * one(1, channels, POINTS, 3) + torch.tensor([0.0, 0.0, 0.5]),
        one(1, channels, POINTS, 3) - 0.5,
        20 * one(ROWS, 1, WHEELS, 2),
        one(ROWS, 1, WHEELS) - 0.5,
        one(ROWS, 1, WHEELS, 2) - 0.5,
        one(ROWS, 1, WHEELS, 2) - 0.5,
        20 * one(ROWS, 1, 2) - 10,
        0.4 * one(1, channels, POINTS),
    ]


def by_the_laws(given: list[torch.Tensor]) -> torch.Tensor:
    at, weight, place, share_rate, thrust, thrust_rate, velocity, ratio = given
    offset = at[..., None, :] - torch.nn.functional.pad(place, (0, 1))[:, :, None]
    push, jerk, speed = thrust[:, :, None], thrust_rate[:, :, None], velocity[:, :, None, None]
    moved = tangential_displacement_rate(offset, speed, ratio[..., None], push)
    moved = moved + tangential_displacement(offset, ratio[..., None], jerk)
    moved = moved + share_rate[:, :, None, :, None] * displacement(offset, ratio[..., None])
    return (moved.sum(-2) * weight).sum((-1, -2))


@pytest.mark.parametrize("channels", [1, 7, LANES, 2 * LANES + 3])
def test_all_derivatives_whatever_the_number_of_channels(channels: int) -> None:
    """Channels are worked on several at a time: the last few, and those of a second batch, as the others."""
    bare = drawn(channels)
    given = [one.clone().requires_grad_() for one in bare]
    plain, found, value = by_the_laws(given), forces_response(*given), forces_response(*bare)
    assert found is not None and value is not None
    torch.testing.assert_close(found, plain, rtol=1e-10, atol=1e-12)
    torch.testing.assert_close(value, plain.detach(), rtol=1e-10, atol=1e-12)
    pull = torch.rand(plain.shape, generator=torch.Generator().manual_seed(4), dtype=torch.float64)
    by_found, by_plain = (torch.autograd.grad((one * pull).sum(), given) for one in (found, plain))
    for mine, theirs in zip(by_found, by_plain, strict=True):
        torch.testing.assert_close(mine, theirs, rtol=1e-8, atol=1e-10)


def test_wheels_that_differ_by_channel_are_left_to_the_laws() -> None:
    given = drawn(2)
    given[2] = given[2].repeat(1, 2, 1, 1)
    assert forces_response(*given) is None
