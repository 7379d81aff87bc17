"""Whether anchors, tracks, record and clocks can be of one place and one time."""

from dataclasses import replace

import numpy as np
import pytest

from solver.survey.anchors import Anchor
from solver.trajectory.agreement import (
    check_apart,
    check_clocks,
    check_gauge,
    check_reach,
    check_together,
    in_record,
    misplaced,
    misplaced_line,
    near,
    slow_line,
    suspicions,
    unseen_crossings,
)
from solver.trajectory.tracks import Track
from vision.contract import InputError

CHANNEL = np.arange(50, 111)
X = CHANNEL - 50.0


def anchor(name: str, channel: float, x: float, y: float = 4.0) -> Anchor:
    return Anchor(name, channel, x, y, 0.9, 0.05, 0.05)


def test_an_anchor_on_a_channel_that_is_not_in_the_record_is_said_to_be(survey) -> None:
    """It was called "too far from the located channels to matter"."""
    said: list[str] = []
    anchors = [anchor("a", 900, 40.0), anchor("b", 80, 30.0), anchor("c", 160, 110.0), anchor("d", -60, 0.0)]
    assert [one.name for one in in_record(anchors, survey.record, said)] == ["b", "c"]
    assert [line.partition(",")[0] for line in said] == ["anchor a is on channel 900", "anchor d is on channel -60"]
    assert "which is not in the record (0 to 149)" in said[0]


def test_a_crossing_beyond_what_is_located_is_told(survey) -> None:
    """Of an anchor on the other side it was said that it is far, and that it is not used."""
    route = np.column_stack([X, np.full(len(X), 5.0), np.ones(len(X))])
    beyond = [anchor("a", 20, -30.0), anchor("b", 150, 100.0, -5.0), anchor("c", 80, 30.0, -5.0)]
    (said,) = unseen_crossings(beyond, survey.passes, CHANNEL, route)
    assert said.startswith("anchor b lies on the other side of the road than the fiber at channel 110: the fiber ")
    assert "crosses the road between channels 110 and 150, beyond what was tracked" in said


def test_anchors_far_along_the_fiber_are_named_with_their_channels() -> None:
    said: list[str] = []
    assert near([anchor("a", 10, 0.0)], (100, 200), 1.0, said) == []
    assert (
        "more than 50 m of fiber from the channels that record vehicles (100 to 200), so not used: anchors a (ch"
        in said[0]
    )


@pytest.mark.parametrize(
    ("one", "says"),
    [
        (
            anchor("a", 80, 12600.0),
            r"anchor a is 12\d{3}\.\d m from every track, but vehicles are recorded on its channel 80;",
        ),
        (anchor("a", 80, 30.0, 40.0), r"anchor a is 40\.0 m from every track, but"),
        (anchor("a", 130, 160.0, 0.0), r"but vehicles are recorded 20 m of fiber from its channel 130;"),
    ],
    ids=["12.6 km along", "across", "beyond the view"],
)
def test_an_anchor_that_no_fiber_reaches_is_refused(survey, one: Anchor, says: str) -> None:
    with pytest.raises(InputError, match=says):
        check_reach([one], survey.passes, (50, 110), 1.0)


def test_anchors_within_reach_of_the_tracks_are_used(survey) -> None:
    check_reach([anchor("a", 80, 30.0, 24.0), anchor("b", 140, 105.0)], survey.passes, (50, 110), 1.0)


@pytest.mark.parametrize(
    ("anchors", "rivals"),
    [
        (
            [anchor("a", 60, 50.0), anchor("b", 100, 11.0)],
            ["the channels of a and b were exchanged", "the tracks ran the other way along x"],
        ),
        ([anchor("a", 60, -10.0), anchor("b", 100, -50.0)], ["they, or the tracks, were turned about the origin by h"]),
        ([anchor("a", 89, 10.0), anchor("b", 49, 50.0)], ["channels were counted from the record's other end"]),
        (
            [anchor("a", 85, 10.0), anchor("b", 125, 50.0)],
            ["-25 were added to their channel numbers, or +25.0 m to th"],
        ),
        ([anchor("a", 460, 10.0), anchor("b", 500, 50.0)], ["-400 were added to their channel numbers, or +400.0 m"]),
    ],
    ids=["exchanged", "turned", "other end", "numbered", "not in the record"],
)
def test_one_mistake_that_explains_all_anchors_is_named_with_its_rivals(survey, anchors, rivals) -> None:
    """Each anchor was called wrong by itself, after the fit, or the tracks' frame was taken to be right."""
    with pytest.raises(InputError, match="are not where vehicles are recorded on their channels") as caught:
        check_together(anchors, survey.passes, CHANNEL, X, survey.record)
    said = str(caught.value).partition("all would be if ")[2].split("; or if ")
    assert [one.startswith(start) for one, start in zip(said, rivals, strict=False)] == [True] * len(rivals)


def test_clocks_are_a_rival_only_where_all_vehicles_go_one_way(survey) -> None:
    off = [anchor("a", 85, 10.0), anchor("b", 125, 50.0)]
    for passes, told in ((survey.passes, False), (survey.passes[:1], True)):
        with pytest.raises(InputError) as caught:
            check_together(off, passes, CHANNEL, X, survey.record)
        assert ("the clocks were 4.2 s apart" in str(caught.value)) == told


@pytest.mark.parametrize(
    "anchors",
    [
        [anchor("a", 60, 10.0), anchor("b", 100, 50.0)],
        [anchor("a", 60, 10.0), anchor("b", 100, 80.0)],
        [anchor("a", 20, 110.0), anchor("b", 190, 112.0)],
        [anchor("a", 60, 40.0)],
    ],
    ids=["in place", "one is wrong", "both around a corner", "one only"],
)
def test_anchors_that_no_one_mistake_explains_are_not_said_to_be(survey, anchors) -> None:
    assert check_together(anchors, survey.passes, CHANNEL, X, survey.record) is None


def test_anchors_that_are_off_alike_by_less_than_a_wave_are_a_caution(survey) -> None:
    said = check_together([anchor("a", 60, 22.0), anchor("b", 100, 63.0)], survey.passes, CHANNEL, X, survey.record)
    assert "all would be if +12 were added to their channel numbers" in str(said)


def test_an_anchor_elsewhere_along_the_road_is_left_out() -> None:
    """20 m off, it turned a fiber off the road and left 8 of 97 channels."""
    right, wrong = anchor("a", 60, 12.0), anchor("b", 100, 70.0)
    assert misplaced([right, wrong], CHANNEL, X) == [wrong]
    assert misplaced_line(wrong, CHANNEL, X).startswith(
        "anchor b is 20 m along the road from where vehicles are recorded on"
    )
    # Beyond the channels that record vehicles, nothing tells.
    assert misplaced([right, anchor("c", 140, 60.0)], CHANNEL, X) == []


def test_anchors_that_agree_are_not_wrong() -> None:
    assert misplaced([anchor("a", 60, 22.0), anchor("b", 100, 63.0)], CHANNEL, X) == []


def test_a_gauge_longer_than_the_fiber_is_refused(survey) -> None:
    check_gauge(survey.record)
    with pytest.raises(InputError, match="gauge length 300 m, but 150 channels at 1 m are only 150 m"):
        check_gauge(replace(survey.record, gauge_length=300.0))


def test_a_record_too_slow_for_its_vehicles_is_reported(survey) -> None:
    """Median speed of 7.5 m/s; a gauge of 10 m senses a vehicle over 20 m."""
    assert slow_line(replace(survey.record, sampling_rate=0.5), survey.passes) is None
    said = str(slow_line(replace(survey.record, sampling_rate=0.25), survey.passes))
    assert said.startswith(
        "0.25 samples/s are too few: vehicles go 30 m from one to the next, and a channel senses them"
    )
    assert said.endswith("over 20 m; record at least 0.4 samples/s")


def test_what_may_be_wrong_where_no_vehicle_is_seen(survey) -> None:
    assert suspicions(survey.record, survey.passes) == ""
    swift = [replace(one, velocity=8 * one.velocity) for one in survey.passes]
    assert suspicions(survey.record, swift) == "; vehicles at 60 m/s are fast: are x and y in m?"
    array = replace(survey.record, strain_rate=np.zeros((100, 400)), provenance={"format": "numpy"})
    cut = [replace(one, rows=np.arange(100 - len(one.rows), 100), in_view=one.rows > 0) for one in survey.passes]
    assert suspicions(array, cut) == "; the array has 100 samples of 400 channels: are its axes exchanged?"


@pytest.mark.parametrize(
    ("late", "says"),
    [
        (
            7200.0,
            "they are 2 h apart: a clock in local time, a zone that a file does not state, or files of another hour",
        ),
        (-3600.0, "they are 1 h apart"),
        (1800.0, "check both clocks"),
        (86400.0, "check both clocks"),
    ],
)
def test_clocks_a_time_zone_apart(survey, late: float, says: str) -> None:
    time = late + np.arange(10.0, 70.0)
    track = Track("1", "car", time, np.zeros((60, 2)), np.ones((60, 2)))
    with pytest.raises(InputError, match=f"do not overlap in time; {says}"):
        check_clocks([track], survey.record)


@pytest.mark.parametrize("sigmas", [(2.0, 0.1), (0.1, 2.0)])
def test_anchors_are_too_far_apart_only_beyond_what_both_sigmas_allow(sigmas) -> None:
    """From channel 60 to 100 it is 40 m; spacings may be off by 5 %, a channel is anywhere within its meter."""
    most = 1.05 * 41 + 5 * float(np.hypot(*sigmas))
    one, other = (replace(anchor("a", 60, 0.0), sigma_xy=sigmas[0]), replace(anchor("b", 100, 0.0), sigma_xy=sigmas[1]))
    check_apart([one, replace(other, x=most - 0.1)], 1.0)
    with pytest.raises(InputError, match=r"are 53\.2 m apart"):
        check_apart([one, replace(other, x=most + 0.1)], 1.0)
