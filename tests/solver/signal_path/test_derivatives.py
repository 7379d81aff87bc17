"""Derivatives of the ground's laws by a parameter, from its values nearby."""

import pytest
import torch

from solver.effect import Parameter
from solver.ground.gibson import gibson_displacement_rate
from solver.signal_path.autodiff import pushing
from solver.signal_path.derivatives import by_channel, slope


@pytest.mark.parametrize("here", [0.0, 0.4, 2.0])
def test_a_law_is_never_asked_for_beyond_its_bounds(here: float) -> None:
    asked = []

    def law(value: torch.Tensor) -> torch.Tensor:
        asked.append(value)
        return torch.sin(3 * value) * torch.tensor([[1.0], [2.0]])

    at = torch.tensor([[here], [0.4]], dtype=torch.float64)
    found = slope(law, at, Parameter("share", "1", 0.2, lower=0, upper=2), law(at))
    torch.testing.assert_close(found, 3 * torch.cos(3 * at) * torch.tensor([[1.0], [2.0]]), rtol=1e-6, atol=1e-8)
    assert torch.stack(asked).min() >= 0
    assert torch.stack(asked).max() <= 2


@pytest.mark.parametrize("gradient", [0.0, 0.7])
def test_of_a_tabulated_law_as_automatic_differentiation_has_it(gradient: float) -> None:
    """At the bound, too, where the law is Boussinesq's."""
    offset = torch.tensor([[3.0, 1.0, 0.9], [-8.0, 4.0, 1.5]], dtype=torch.float64)
    velocity = torch.tensor([10.0, 1.0], dtype=torch.float64)

    def law(value: torch.Tensor) -> torch.Tensor:
        return gibson_displacement_rate(offset, velocity, 0.25, value)

    here = torch.tensor(gradient, dtype=torch.float64)
    found = slope(law, here, Parameter("gradient", "1/m", 1.0, lower=0, upper=3), law(here))
    torch.testing.assert_close(found, torch.func.jvp(law, (here,), (torch.ones_like(here),))[1], rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize("chosen", [None, torch.tensor([True, False, True, True])])
def test_what_each_channel_makes_of_its_own_value_holds_all_derivatives_only_where_no_other_matters(
    chosen: torch.Tensor | None,
) -> None:
    here = torch.tensor([0.1, 0.4, -0.3, 0.2], dtype=torch.float64)
    record = torch.arange(12.0, dtype=torch.float64).reshape(3, 4)
    measured = slice(None) if chosen is None else chosen
    alone = pushing(lambda v: ((record * v.exp())[:, measured],), here)
    mixed = pushing(lambda v: ((record * (v - v.mean()).exp())[:, measured],), here)
    each = by_channel(alone, here, chosen)
    assert each is not None
    torch.testing.assert_close(each, (record * here.exp())[:, measured])
    assert by_channel(mixed, here, chosen) is None
