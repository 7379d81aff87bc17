"""The compiled response of gauges to wheels against PyTorch's own derivatives of the textbook's law."""

import pytest
import torch

from solver.ground.boussinesq import displacement_rate
from solver.ground.lanes import LANES
from solver.ground.wheel_motion import gauge_response


@pytest.mark.parametrize("channels", [1, 7, LANES, 2 * LANES + 3])
def test_all_derivatives_whatever_the_number_of_channels(channels: int) -> None:
    """Channels are worked on several at a time: the last few, and those of a second batch, as the others."""
    random = torch.Generator().manual_seed(3)
    rows, points, wheels = 3, 2, 4

    def drawn(*shape: int) -> torch.Tensor:
        return torch.rand(*shape, generator=random, dtype=torch.float64)

    point = 20 * drawn(1, channels, points, 3) + torch.tensor([0.0, 0.0, 0.5])
    given = [
        point,
        drawn(1, channels, points, 3) - 0.5,
        20 * drawn(rows, 1, wheels, 2),
        drawn(rows, 1, wheels),
        20 * drawn(rows, 1, 2) - 10,
        0.4 * drawn(1, channels, points),
    ]
    given = [one.requires_grad_() for one in given]
    at, weight, place, share, velocity, ratio = given
    offset = at[..., None, :] - torch.cat([place, torch.zeros(rows, 1, wheels, 1)], -1)[:, :, None]
    moved = displacement_rate(offset, velocity[:, :, None, None], ratio[..., None]) * share[:, :, None, :, None]
    plain = (moved.sum(-2) * weight).sum((-1, -2))
    found = gauge_response(*given)
    assert found is not None
    pull = drawn(*plain.shape)
    torch.testing.assert_close(found, plain, rtol=1e-11, atol=1e-13)
    by_found, by_plain = (torch.autograd.grad((one * pull).sum(), given) for one in (found, plain))
    for mine, theirs in zip(by_found, by_plain, strict=True):
        torch.testing.assert_close(mine, theirs, rtol=1e-9, atol=1e-11)
