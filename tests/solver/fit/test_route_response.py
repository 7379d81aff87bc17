"""How a map changes with the route's coefficients, against sums over everything."""

from types import SimpleNamespace

import pytest
import torch

from solver.fit.route_response import RouteResponse

ROWS, POINTS, COEFFICIENTS, SAMPLES = 5, 3, 4, 4


@pytest.mark.parametrize("ratio", [False, True])
@pytest.mark.parametrize("reach", ["near", "all"])
@pytest.mark.parametrize("channels", [1, 30, 197])
def test_sums_of_all_that_a_coefficient_moves(channels: int, reach: str, ratio: bool) -> None:
    """Of few channels and of many, each moved by one coefficient or by all, with the ground's local ratio or not."""
    random = torch.Generator().manual_seed(7)

    def drawn(*shape: int) -> torch.Tensor:
        return torch.rand(*shape, generator=random, dtype=torch.float64) - 0.5

    kinds = 4 if ratio else 3
    local = SimpleNamespace(
        amplitude=drawn(ROWS),
        by_point=drawn(ROWS, channels, POINTS, 3),
        by_weight=drawn(ROWS, channels, POINTS, 3),
        by_ratio=drawn(ROWS, channels, POINTS),
    )
    acts = torch.ones(channels, COEFFICIENTS, dtype=torch.float64)
    if reach == "near":
        acts = torch.eye(COEFFICIENTS, dtype=torch.float64)[torch.arange(channels) * COEFFICIENTS // channels]
    places = drawn(channels, POINTS, COEFFICIENTS) * acts[:, None]
    others = (drawn(channels, kinds * POINTS, COEFFICIENTS, 3) * acts[:, None, :, None]).flatten(2)
    sample = torch.tensor([0, 1, 1, 2, 3])

    by_weight = others[:, : 3 * POINTS].reshape(channels, POINTS, 3, COEFFICIENTS, 3)
    rows = torch.einsum("rcpi,cpk->rcki", local.by_point, places)
    rows += torch.einsum("rcpj,cpjki->rcki", local.by_weight, by_weight)
    if ratio:
        change = others[:, 3 * POINTS :].reshape(channels, POINTS, COEFFICIENTS, 3)
        rows += torch.einsum("rcp,cpki->rcki", local.by_ratio, change)
    rows *= local.amplitude[:, None, None, None]
    plain = torch.zeros(3 * COEFFICIENTS, SAMPLES, channels, dtype=torch.float64)
    plain.index_add_(1, sample, rows.permute(2, 3, 0, 1).flatten(0, 1))

    response = RouteResponse(local, places, others)
    found = torch.cat([response.maps(some, sample, SAMPLES) for some in (slice(0, 3), slice(3, 6))])
    torch.testing.assert_close(found, plain, rtol=1e-12, atol=1e-14)
