"""Laws of the ground summed over gauges in one pass, against the same laws at single points."""

import pytest
import torch
from torch import Tensor

from solver.catalogue.bells import Belled
from solver.catalogue.packets import Packet
from solver.ground.gibson import stiffening
from solver.ground.ground import Both
from solver.ground.ground_law import Law, Waves
from solver.ground.lanes import LANES
from solver.ground.layered import layered, paved
from solver.ground.moving import Moving
from solver.ground.one_pass import law_response, waves_response
from solver.ground.radiated import Radiated

ROWS, POINTS, WHEELS = 5, 3, 4


def number(value: float) -> Tensor:
    """A number in double precision."""
    return torch.tensor(value, dtype=torch.float64)


BELLS = Belled(None, (1.5, 4.0), *([number(a), number(b)] for a, b in ((0.3, -0.2), (0.1, 0.0), (0.0, 0.4))))
LAWS = {
    "layered": layered(number(1.0), number(2.0)),
    "paved": paved(number(3.0)),
    "stiffening": stiffening(number(0.7)),
    "moving": Moving(number(2e-4)),
    "bells": BELLS,
    "both": Both(layered(number(-0.5), number(1.0)), Moving(number(1e-4))),
}


def given(channels: int, ratio: Tensor) -> tuple[Tensor, ...]:
    """Gauges and wheels some meters to a hundred meters apart."""
    random = torch.Generator().manual_seed(channels)

    def drawn(*shape: int) -> Tensor:
        return torch.rand(*shape, generator=random, dtype=torch.float64)

    point = torch.cat([100 * drawn(channels, POINTS, 2), 0.3 + 2 * drawn(channels, POINTS, 1)], -1)
    place, share = 100 * drawn(ROWS, 1, WHEELS, 2), drawn(ROWS, 1, WHEELS)
    return point, drawn(channels, POINTS, 3) - 0.5, place, share, 30 * drawn(ROWS, 1, 2) - 15, ratio


def moved(given: tuple[Tensor, ...]) -> tuple[Tensor, Tensor]:
    """Offsets [row, channel, point, wheel, 3] and velocities that broadcast with them."""
    point, _, place, _, velocity, _ = given
    flat = torch.cat([place, torch.zeros(ROWS, 1, WHEELS, 1)], -1)
    return point[:, :, None] - flat[:, :, None], velocity[:, :, None, None]


def summed(given: tuple[Tensor, ...], each: Tensor) -> Tensor:
    """Sums [row, channel] of weight . motion [row, channel, point, wheel, 3]."""
    return ((given[3][:, :, None, :, None] * each).sum(-2) * given[1]).sum((-1, -2))


@pytest.mark.parametrize("channels", [1, LANES + 3])
@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_a_law_of_one_poisson_ratio(law: Law, channels: int) -> None:
    at = given(channels, number(0.3))
    expected = summed(at, law(*moved(at), at[-1]))
    found = law_response(law, *at)
    assert found is not None
    torch.testing.assert_close(found, expected, rtol=1e-9, atol=1e-12 * float(expected.detach().abs().max()))


@pytest.mark.parametrize("law", ["layered", "stiffening", "bells"])
def test_a_law_of_poisson_ratios_that_differ(law: str) -> None:
    at = given(7, torch.linspace(0.2, 0.4, 7 * POINTS, dtype=torch.float64).reshape(7, POINTS))
    expected = summed(at, LAWS[law](*moved(at), at[-1][..., None]))
    found = law_response(LAWS[law], *at)
    assert found is not None
    torch.testing.assert_close(found, expected, rtol=1e-9, atol=1e-12 * float(expected.detach().abs().max()))


@pytest.mark.parametrize("law", ["layered", "paved", "stiffening", "bells"])
def test_derivatives_as_automatic_differentiation_has_them(law: str) -> None:
    """Beyond a table's last distance, too."""
    at = list(given(7, torch.linspace(0.2, 0.4, 7 * POINTS, dtype=torch.float64).reshape(7, POINTS)))
    at[2][0, 0, 0, 0] = 3e4
    with_axes = [one.requires_grad_() for one in at]
    found = law_response(LAWS[law], *with_axes)
    assert found is not None
    expected = summed(tuple(at), LAWS[law](*moved(tuple(at)), at[-1][..., None]))
    pull = torch.linspace(-1, 1, expected.numel(), dtype=torch.float64).reshape(expected.shape)
    torch.testing.assert_close(found, expected, rtol=1e-9, atol=1e-12 * float(expected.detach().abs().max()))
    by_found, by_expected = (torch.autograd.grad((one * pull).sum(), with_axes) for one in (found, expected))
    for mine, theirs in zip(by_found, by_expected, strict=True):
        torch.testing.assert_close(mine, theirs, rtol=1e-8, atol=1e-11 * float(theirs.abs().max()))


@pytest.mark.parametrize("law", ["moving", "both"])
def test_derivatives_with_inertia_as_automatic_differentiation_has_them(law: str) -> None:
    """Of one Poisson's ratio, of which each point has its own copy."""
    at = list(given(7, torch.full((7, POINTS), 0.3, dtype=torch.float64)))
    with_axes = [one.requires_grad_() for one in at]
    found = law_response(LAWS[law], *with_axes)
    assert found is not None
    expected = summed(tuple(at), LAWS[law](*moved(tuple(at)), at[-1][..., None]))
    by_found, by_expected = (torch.autograd.grad(one.sum(), with_axes) for one in (found, expected))
    for mine, theirs in zip(by_found, by_expected, strict=True):
        torch.testing.assert_close(mine, theirs, rtol=1e-6, atol=1e-9 * float(theirs.abs().max()))


@pytest.mark.parametrize("kind", [Packet, Radiated])
@pytest.mark.parametrize("sine", [0.0, 0.3])
def test_waves_of_a_phase_of_each_vehicle(kind: type[Packet] | type[Radiated], sine: float) -> None:
    at, time = given(LANES + 3, number(0.3)), torch.arange(ROWS, dtype=torch.float64)[:, None]
    sizes = sine * (time + 1), 0.1 * torch.tensor([[0.0], [1.0], [-2.0], [0.0], [1.0]], dtype=torch.float64)
    waves: Waves = kind(*sizes, number(12.0), number(18.0 if kind is Packet else 150.0))
    expected = summed(at, waves(*moved(at), time[..., None, None]))
    found = waves_response(waves, *at[:5], time)
    assert found is not None
    torch.testing.assert_close(found, expected, rtol=1e-9, atol=1e-12 * float(expected.detach().abs().max()))


def test_no_pass_where_a_derivative_is_asked_for_or_a_law_has_none() -> None:
    at, various = given(2, number(0.3)), torch.linspace(0.2, 0.4, 2 * POINTS, dtype=torch.float64).reshape(2, POINTS)
    leaf = at[0].expand(ROWS, *at[0].shape).clone().requires_grad_()
    assert law_response(LAWS["moving"], leaf, *at[1:]) is None, "points that differ by row"
    at = given(2, various)
    assert law_response(LAWS["moving"], *at) is None
    assert law_response(LAWS["both"], *at) is None
    bells = Belled(LAWS["layered"], (1.5,), *([number(0.1)] for _ in range(3)))
    assert law_response(bells, *at) is None
    grown = Moving(number(1e-4).requires_grad_())
    assert law_response(grown, *given(2, number(0.3))) is None
