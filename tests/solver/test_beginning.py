"""Where a fit begins."""

from types import SimpleNamespace
from typing import Any

import pytest

from solver.anchors import Anchor
from solver.beginning import anchors_ahead


def at(channel: float, x: float) -> Anchor:
    return Anchor(f"manhole {channel}", channel, x, 4.0, 0.8, 0.05, 0.05)


@pytest.mark.parametrize(
    ("misses", "ahead"), [((5.4, 5.6), 5.5), ((-7.0, -7.2, -6.8), -7.0), ((5.5,), 0.0), ((0.3, 9.0), 0.0), ((), 0.0)]
)
def test_anchors_that_agree_tell_how_far_along_the_road_the_fiber_lies(misses: tuple[float, ...], ahead: float) -> None:
    """One alone may be wrong, or around a bend, and so may those that do not agree."""
    line: Any = SimpleNamespace(x_of_channel=(-60.0, 1.02))
    anchors = [at(40 + 30 * k, -60 + 1.02 * (40 + 30 * k) + miss) for k, miss in enumerate(misses)]
    assert anchors_ahead(line, anchors) == pytest.approx(ahead)
