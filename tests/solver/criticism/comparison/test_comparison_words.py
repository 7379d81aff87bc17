"""What a comparison says: of which channels, passes, times and changes."""

from types import SimpleNamespace

import numpy as np
import pytest

from solver.criticism.comparison.comparison_words import (
    ahead_words,
    change_words,
    channel_words,
    clock,
    pass_words,
    region_words,
    time_words,
)
from solver.criticism.comparison.regions import Region

PASSES = [
    SimpleNamespace(track_id="1", vehicle_class="car", speed=10.0),
    SimpleNamespace(track_id="2", vehicle_class="car", speed=-10.0),
    SimpleNamespace(track_id="3", vehicle_class="bus", speed=8.0),
    SimpleNamespace(track_id="4", vehicle_class="car", speed=-9.0),
]
RUN = SimpleNamespace(passes=PASSES, start=np.datetime64("2025-08-11T23:59:30", "ns"))


def region(kind: str = "gain", **changes) -> Region:
    values = {
        "kind": kind, "passes": ("1",), "every_pass": False, "channels": (60, 70), "x": (0.0, 10.0), "time": None,
        "ahead": None, "amount": 0.2, "sigma": 0.01, "meters": None, "speed": None, "chi2": 900.0, "z": 20.0,
    }  # fmt: skip
    return Region(**values | changes)


@pytest.mark.parametrize(
    ("passes", "every", "words"),
    [
        (("1", "2", "3", "4"), True, "all passes"),
        (("3",), False, "pass 3"),
        (("1", "3"), False, "all passes toward +x"),
        (("2", "4"), False, "all passes toward -x"),
        (("1", "2", "4"), False, "all passes of class car"),
        (("1", "2"), False, "passes 1 and 2"),
        (("1", "2", "3"), False, "passes 1, 2 and 3"),
    ],
)
def test_passes_are_named_by_what_they_have_in_common(passes, every, words):
    assert pass_words(region(passes=passes, every_pass=every), RUN) == words


def test_of_a_single_pass_nobody_says_all():
    alone = SimpleNamespace(passes=PASSES[:1], start=RUN.start)
    assert pass_words(region(every_pass=True), alone) == "the pass"


@pytest.mark.parametrize(("channels", "words"), [((60, 70), "channels 60-70"), ((60, 60), "channel 60")])
def test_channels(channels, words):
    assert channel_words(region(channels=channels)) == words


@pytest.mark.parametrize(
    ("time", "words"),
    [(None, ""), ((0.2, 0.4), "23:59:30"), ((0.0, 31.0), "23:59:30-00:00:01")],
)
def test_times_are_utc_past_midnight_too(time, words):
    assert time_words(region(time=time), RUN) == words
    assert clock(RUN, 86400.0) == "23:59:30"


@pytest.mark.parametrize(
    ("first", "last", "words"),
    [
        (-10.0, -5.0, "5 to 10 m behind the vehicle"),
        (0.0, 2.5, "0 to 2.5 m ahead of the vehicle"),
        (-1.0, 1.0, "from 1 m behind to 1 m ahead of the vehicle"),
    ],
)
def test_distances_from_the_vehicle(first, last, words):
    assert ahead_words(first, last) == words


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"kind": "gain", "amount": -0.25}, "gain 25 % low"),
        ({"kind": "gain", "amount": 0.052}, "gain 5.2 % high"),
        ({"kind": "late", "amount": 0.3}, "response 0.300 s late"),
        ({"kind": "late", "amount": -0.3, "meters": -4.2}, "response 4.20 m early"),
        ({"kind": "place", "amount": -1.5}, "response 1.50 m toward lower channels"),
        ({"kind": "offset", "amount": 2.0}, "constant offset of +2.00 noise sigmas"),
    ],
)
def test_changes_have_their_sign_and_unit(changes, words):
    assert change_words(region(**changes)) == words


def test_something_unseen_has_a_speed_where_it_moves():
    still, moving = region("unseen"), region("unseen", speed=-10.0)
    assert change_words(still) == "something that the trajectories lack"
    assert change_words(moving).endswith("at 36 km/h") and change_words(moving).startswith(change_words(still))


def test_a_region_s_sentence_has_all_of_it():
    said = region_words(region(time=(0.0, 5.0)), RUN)
    assert all(part in said for part in ("channels 60-70", "pass 1", "23:59:30-23:59:35", "gain 20 % high"))
