from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from drives import START, fixes

from solver.trajectory.tracks import Track, driven, during, leaps, moves, numbered, to_and_fro, tracks_of, turns


def a_track(time, x, sigma=0.1):
    time = np.asarray(time, float)
    place = np.stack([np.broadcast_to(x, time.shape), np.zeros_like(time)], -1)
    return Track("7", "car", time, place, np.full(place.shape, sigma))


def test_a_table_becomes_tracks():
    one = fixes([1.0, 0.5, 2.0], [10.0, 5.0, 20.0], 0.0, sigma=0.0, track_id="a", length=[4.0, np.nan, 5.0])
    other = fixes([-1.0], [0.0], 3.0, track_id="b", length=np.nan)
    other["class"] = "bus"
    tracks = {track.track_id: track for track in tracks_of(pd.concat([one, other]), START, [])}
    assert tracks["a"].time.round(9).tolist() == [0.5, 1.0, 2.0]
    assert tracks["a"].value.tolist() == [[5.0, 0.0], [10.0, 0.0], [20.0, 0.0]]
    assert (tracks["a"].vehicle_class, tracks["a"].length) == ("car", 4.5)
    assert (tracks["b"].vehicle_class, tracks["b"].length, tracks["b"].time.tolist()) == ("bus", None, [-1.0])


def test_a_long_silence_starts_a_new_drive_of_what_may_be_another_vehicle():
    table = fixes([0, 1, 2, 30, 31, 49, 80], 0.0, 0.0, track_id="7")
    table["class"] = ["car"] * 3 + ["bus"] * 4
    parts = list(tracks_of(table, START, said := []))
    assert [(part.track_id, part.vehicle_class, part.time.round(9).tolist()) for part in parts] == [
        ("7", "car", [0.0, 1.0, 2.0]),
        ("7#2", "bus", [30.0, 31.0, 49.0]),
        ("7#3", "bus", [80.0]),
    ]
    assert said == []
    assert [numbered("7", index) for index in range(2)] == ["7", "7#2"]


@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize("back", [1, -1], ids=["the same way", "back"])
def test_two_vehicles_one_after_the_other_by_one_name_are_two(way, back):
    """Between them a third was made up, which went back unseen; or the bus had the wheels of the car."""
    time = np.concatenate([np.arange(0, 8, 0.1), np.arange(14, 22, 0.1)])
    x = way * 12 * np.concatenate([np.arange(80), np.arange(80)[::back]]) / 10
    table = fixes(time, x, 0.0, track_id="7")
    table["class"] = ["car"] * 80 + ["bus"] * 80
    parts = list(tracks_of(table, START, said := []))
    found = [(part.track_id, part.vehicle_class, len(part.time)) for part in parts]
    assert found == [("7", "car", 80), ("7#2", "bus", 80)]
    assert said[0].startswith("trajectories: 7: several vehicles have the same track_id, one after the other;")


@pytest.mark.parametrize(
    ("x", "sigma"),
    [
        (np.concatenate([np.arange(40), np.arange(40, 0, -1)]) * 10.0, 0.5),
        (np.arange(80) * 10.0 - 15 * (np.arange(80) == 30), 0.5),
        (np.random.default_rng(0).normal(0, 6, 80), 6.0),
    ],
    ids=["turns", "a wrong fix", "parked"],
)
def test_one_vehicle_is_one_track(x, sigma):
    said = list[str]()
    assert len(list(tracks_of(fixes(np.arange(80.0), x, 0.0, sigma=sigma), START, said))) == 1
    assert said == []
    assert not to_and_fro(a_track(np.arange(80.0), x, sigma))


def test_fixes_far_from_the_record_are_dropped():
    part = during(a_track([-100, -61, -59, 50, 159, 161], 0.0), 100.0)
    assert part is not None
    assert part.time.tolist() == [-59.0, 50.0, 159.0]
    assert during(a_track([-100, 300], 0.0), 100.0) is None


@pytest.mark.parametrize(
    ("track", "expected"),
    [
        (a_track([0, 1], [0.0, 50.0]), False),
        (a_track([0, 1, 2], [0.0, 2.0, 4.9]), False),
        (a_track([0, 1, 2], [0.0, 2.0, 5.1]), True),
        (a_track(np.arange(500), 3 * np.random.default_rng(0).normal(size=500), sigma=3.0), False),
    ],
)
def test_what_moves(track, expected):
    assert moves(track) is expected


def test_standing_is_dropped_but_for_a_rest():
    time = np.arange(0.0, 200.0)
    x = np.interp(time, [0, 50, 60, 100, 110, 200], [0, 0, 100, 100, 200, 200])
    kept = driven(a_track(time, x))
    assert kept.time[0] == 46.0
    assert kept.time[-1] == 114.0
    assert len(kept.time) == 69


def test_driving_is_kept_whole():
    track = a_track(np.arange(10), np.arange(10) * 8.0)
    assert np.array_equal(driven(track).time, track.time)
    small = a_track(np.arange(10), np.arange(10) * 0.1)
    assert driven(small) is small


@pytest.mark.parametrize(
    ("x", "expected"),
    [
        ([0, 30, 60], []),
        ([0, -30, -60], []),
        ([0, 30, 60, 30, 0], [2]),
        ([0, 30, 25, 60, 52, 90], []),
        ([0, -30, 20, -30], [1, 2]),
        ([0, 5, -4, 3], []),
        ([], []),
    ],
)
def test_turns(x, expected):
    assert turns(np.array(x, float)) == expected


def test_what_fixes_scatter_is_no_leap_however_often_they_are_taken():
    """Ten a second, each 5 m off: from one to the next it is farther than any vehicle goes in that time."""
    time = np.arange(200) / 10
    value = np.column_stack([10 * time, 0 * time]) + 5.0 * np.random.default_rng(5).normal(size=(200, 2))
    track = Track("1", "car", time, value, np.full((200, 2), 5.0))
    assert not leaps(track).any()
    assert np.flatnonzero(leaps(replace(track, value=value + 200.0 * (time > 9.95)[:, None]))).tolist() == [99]
