"""A model is criticized over one stretch of fiber."""

from types import SimpleNamespace

import numpy as np
import pytest

from solver.run.fitted import fitted
from solver.run.seen import Seen
from vision.contract import InputError


def test_a_long_run_is_refused_with_what_to_do():
    channel = np.arange(300)
    result = SimpleNamespace(fitted_channel=channel, channel=channel, distance=channel.astype(float))
    run = SimpleNamespace(too_long=Seen.too_long.fget(SimpleNamespace(result=result)))
    with pytest.raises(
        InputError, match=r"299 m of fiber: .* 200 m at most; `roadfiber diagnose` and `compare` look at stretch"
    ):
        fitted(run)
