"""Basis matrices that are kept are those of the places asked for."""

import pytest
import torch

from solver.cable.fiber import GaugeEnds, SplineBasis
from solver.cable.known_ends import ends_at

BASIS, DISTANCE = SplineBasis.even(0.0, 100.0, 10.0), torch.tensor([30.0, 40.0, 50.0], dtype=torch.float64)


@pytest.mark.parametrize("gauge", [10.0, torch.tensor([8.0, 10.0, 12.0], dtype=torch.float64)])
@pytest.mark.parametrize("held", [None, (torch.tensor(20.0).double(), torch.tensor(60.0).double())])
def test_ends_are_those_of_each_place(gauge: float | torch.Tensor, held: tuple[torch.Tensor, torch.Tensor]) -> None:
    for where in (DISTANCE, DISTANCE + 1, DISTANCE):
        found, expected = ends_at(BASIS, where, gauge, 4, held), GaugeEnds.at(BASIS, where, gauge, 4, held)
        assert found.present().keys() == expected.present().keys()
        for name, matrix in expected.present().items():
            torch.testing.assert_close(found.present()[name], matrix, rtol=0, atol=0)


def test_only_what_asks_for_no_derivative_is_kept() -> None:
    assert ends_at(BASIS, DISTANCE, 10.0, 0, None) is ends_at(BASIS, DISTANCE.clone(), 10.0, 0, None)
    moved = DISTANCE.clone().requires_grad_()
    assert ends_at(BASIS, moved, 10.0, 0, None).ahead.requires_grad
    assert not ends_at(BASIS, DISTANCE, 10.0, 0, None).ahead.requires_grad
