"""A record that is refused says by which figures, and a picture of what was seen lies beside the message."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from roadfiber.locate_commands import pictured
from solver.start.alignment import NotFollowingError
from solver.start.initialization import initialize
from solver.start.refused_figure import refused_figure
from vision.contract import InputError


def test_the_gate_and_what_was_seen_are_told(survey, tmp_path: Path) -> None:
    """Vehicles that are said to be anywhere but where they are."""
    rng = np.random.default_rng(0)
    wild = [
        replace(one, position=np.column_stack([rng.permutation(one.position[:, 0]), one.position[:, 1]]))
        for one in survey.passes
    ]
    with pytest.raises(NotFollowingError, match=r"\d+ of \d+ detections are within 2.5 m|no vehicle is seen") as caught:
        initialize(survey.record, wild)
    seen = caught.value.seen
    assert seen.inliers.sum() < seen.needed and len(seen.x) == len(seen.channel) == len(seen.inliers)
    assert f"{seen.inliers.sum()} of {seen.beside.sum()} detections" in refused_figure(seen).axes[0].get_title(
        loc="left"
    )
    told = pictured(caught.value, tmp_path / "run")
    assert told == f"; what was seen: {tmp_path / 'run-refused.png'}"
    assert (tmp_path / "run-refused.png").read_bytes().startswith(b"\x89PNG")
    again = InputError("more words")
    again.__cause__ = caught.value
    assert pictured(again, tmp_path / "other").endswith("other-refused.png")


@pytest.mark.parametrize(("first", "count"), [(50, 40), (20, 60)])
def test_fixes_beyond_the_recorded_channels_are_no_contradiction(survey, first: int, count: int) -> None:
    """The same survey, cut to fixes beside recorded channels, was accepted, and no record under 48 m of fiber was."""
    part = slice(first, first + count)
    record = replace(
        survey.record,
        strain_rate=survey.record.strain_rate[:, part],
        channel=survey.record.channel[part],
        distance=survey.record.distance[part],
    )
    x0, slope = initialize(survey.record, survey.passes).x_of_channel
    found = initialize(record, survey.passes).x_of_channel
    middle = first + count / 2
    assert found[0] + found[1] * middle == pytest.approx(x0 + slope * middle, abs=2.0)


def test_other_errors_have_no_picture(tmp_path: Path) -> None:
    assert pictured(InputError("site.toml: no such file"), tmp_path / "run") == ""
    assert list(tmp_path.iterdir()) == []
