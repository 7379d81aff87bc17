"""Where a fit begins."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from solver.start.first_routes import anchors_ahead
from solver.start.rough_route import beyond_words, felt_beyond, straight_part
from solver.survey.anchors import Anchor


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


@pytest.mark.parametrize(
    ("recorded", "active", "kept"),
    [
        ((0, 240), (65, 162), (0, 98)),
        ((0, 240), (65, 130), (0, 56)),
        ((80, 130), (80, 129), (0, 50)),
        ((80, 130), (86, 124), (0, 39)),
        ((80, 200), (100, 162), (10, 63)),
    ],
    ids=["whole view", "leaves at 130", "crop", "crop, ends heard less", "crop and leaves at 100"],
)
def test_where_the_record_ends_the_fiber_does_not_leave_the_road(
    recorded: tuple[int, int], active: tuple[int, int], kept: tuple[int, int]
) -> None:
    """Told of each user's own crop, whose last ten channels at either end were thrown away besides."""
    channel = np.arange(active[0], active[1] + 1)
    rough: Any = SimpleNamespace(active=active, channel=channel, x_of_channel=(-65.0, 1.0))
    one: Any = SimpleNamespace(position=np.array([[0.0, 0.0], [97.0, 0.0]]), in_view=np.ones(2, bool))
    assert straight_part(rough, [one], 10, recorded).indices(len(channel))[:2] == kept


def test_channels_that_record_vehicles_are_not_said_to_record_nothing(survey) -> None:
    """The loudest channels of a street, where no line expects its vehicles, "record nothing"."""
    loud, hardly, quiet = (
        beyond_words(end, felt_beyond(survey.record, survey.passes, end, to), gauge=10)
        for end, to in ((75, 40), (75, 65), (110, 140))
    )
    assert loud.startswith("vehicles are recorded beyond channel 75, too (channels 53-69, 71-74)")
    assert hardly.startswith(
        "vehicles are hardly recorded beyond channel 75 (on channels 65-69, 71-74), though the view"
    )
    assert quiet.startswith("vehicles are not recorded beyond channel 110, though the view and the record go on")
