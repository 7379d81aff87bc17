"""A gain that remembers how loud a channel was."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import torch

from solver.catalogue.catalogue import built_in
from solver.interrogator.interrogator import Interrogator

RATE = 10.0


def remembered(rate: torch.Tensor, **shares: float) -> torch.Tensor:
    """A map [sample, channel] as a channel with such a memory gives it; its loudest is 2."""
    numbers = {name: torch.tensor(shares.get(name, 0.0)).double() for name in ("after_0.5", "after_2")}
    survey: Any = SimpleNamespace(sampling_rate=RATE, largest=2.0)
    return built_in()["generic_memory"].change(Interrogator(10.0), numbers, survey).pointwise[0](rate)


def test_what_was_loud_changes_the_gain_after_it_and_fades() -> None:
    rate = torch.zeros(40, 2, dtype=torch.float64)
    rate[0, 0], rate[1:, :] = -2.0, 1e-6
    out = remembered(rate, **{"after_0.5": -0.5})
    torch.testing.assert_close(out[0], rate[0], msg="nothing was heard before")
    lost = 1 - out[1:, 0] / rate[1:, 0]
    share = 1 - np.exp(-1 / (0.5 * RATE))
    np.testing.assert_allclose(lost[0], 0.5 * share, rtol=1e-9)
    np.testing.assert_allclose(lost[10] / lost[5], np.exp(-1.0), rtol=1e-4)
    assert float((out[:, 1] / rate[:, 1] - 1)[1:].abs().max()) < 0.01, "the quiet channel heard nothing"


def test_a_longer_memory_hears_less_of_one_sample_and_keeps_it_longer() -> None:
    rate = torch.full((60, 1), 1e-6, dtype=torch.float64)
    rate[0] = 2.0
    short, long = (1 - remembered(rate, **{name: -1.0})[:, 0] / rate[:, 0] for name in ("after_0.5", "after_2"))
    assert float(short[1]) > 3 * float(long[1]) > 0
    assert float(long[20]) > 3 * float(short[20])


def test_it_does_nothing_at_its_null_and_a_map_of_many_is_one_by_one() -> None:
    rate = torch.from_numpy(np.random.default_rng(0).normal(size=(3, 30, 4)))
    torch.testing.assert_close(remembered(rate), rate)
    each = torch.stack([remembered(one, after_2=0.7) for one in rate])
    torch.testing.assert_close(remembered(rate, after_2=0.7), each)
