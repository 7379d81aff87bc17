"""Boussinesq's displacement rate in machine code is the formula that PyTorch differentiates."""

import torch

from solver.ground.boussinesq import displacement_rate

OFFSET = torch.randn(40, 5, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(1)).abs() * 10
VELOCITY = torch.tensor([12.0, -3.0], dtype=torch.float64).expand(40, 1, 2)
RATIO = torch.linspace(0.1, 0.45, 5, dtype=torch.float64)


def test_machine_code_gives_the_values_of_the_formula() -> None:
    by_machine = displacement_rate(OFFSET, VELOCITY, RATIO)
    by_formula = displacement_rate(OFFSET.clone().requires_grad_(), VELOCITY, RATIO)
    assert by_formula.requires_grad and not by_machine.requires_grad
    assert by_machine.shape == by_formula.shape == (40, 5, 3)
    torch.testing.assert_close(by_machine, by_formula.detach(), rtol=1e-13, atol=1e-15)


def test_single_precision_stays_single_precision() -> None:
    assert displacement_rate(OFFSET.float(), VELOCITY.float(), 0.25).dtype == torch.float32


def test_forward_mode_and_reverse_mode_still_differentiate_it() -> None:
    def rate(offset: torch.Tensor) -> torch.Tensor:
        return displacement_rate(offset, VELOCITY[0, 0], 0.25)

    point = OFFSET[0, 0]
    step = 1e-6 * torch.eye(3, dtype=torch.float64)
    numeric = torch.stack([(rate(point + s) - rate(point - s)) / 2e-6 for s in step], -1)
    for jacobian in (torch.func.jacfwd(rate), torch.func.jacrev(rate)):
        torch.testing.assert_close(jacobian(point), numeric, rtol=1e-6, atol=1e-8)
