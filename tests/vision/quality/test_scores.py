import numpy as np
import pandas as pd
import pytest

from vision.contract import InputError
from vision.interpolate import BOX
from vision.quality.scores import score_tracks


def track(name, frames, left=0.0, speed=3.0):
    frames = np.asarray(frames)
    edges = np.array([left, 0.0, left + 40.0, 30.0]) + speed * frames[:, None] * np.array([1, 0, 1, 0])
    return pd.DataFrame(edges, columns=BOX).assign(track_id=name, frame=frames)


def both(*tracks):
    return pd.concat(tracks, ignore_index=True)


TRUTH = both(track("a", range(10)), track("b", range(10), 200.0))


def test_the_truth_is_perfect():
    scores = score_tracks(TRUTH, TRUTH.assign(track_id=TRUTH["track_id"] + "'"))
    assert (scores.mota, scores.idf1, scores.hota, scores.switches) == (1, 1, pytest.approx(1), 0)


def test_misses_and_false_alarms_by_hand():
    found = both(track(1, range(10)), track(2, range(5), 200.0), track(3, range(2), 500.0))
    scores = score_tracks(TRUTH, found)
    assert (scores.misses, scores.false_alarms, scores.switches, scores.boxes) == (5, 2, 0, 20)
    assert scores.mota == pytest.approx(1 - 7 / 20)
    assert scores.idf1 == pytest.approx(2 * 15 / (20 + 17))
    assert scores.deta == pytest.approx(15 / 22)
    assert scores.assa == pytest.approx((10 * 1.0 + 5 * 0.5) / 15)
    assert scores.hota == pytest.approx(np.sqrt(scores.deta * scores.assa))


def test_an_exchange_of_numbers_is_two_switches():
    found = both(track(1, range(5)), track(2, range(5, 10)), track(2, range(5), 200.0), track(1, range(5, 10), 200.0))
    scores = score_tracks(TRUTH, found)
    assert scores.switches == 2 and scores.mota == pytest.approx(1 - 2 / 20) and scores.idf1 == pytest.approx(0.5)
    assert scores.assa == pytest.approx(1 / 3, abs=1e-3), "each pair holds 5 of 15"


def test_similarity_decides_what_counts():
    found = both(track(1, range(10), 10.0), track(2, range(10), 200.0))  # overlap of the first: 30/50
    scores = score_tracks(TRUTH, found)
    assert scores.mota == 1 and scores.deta == pytest.approx((12 + 7 * 1 / 3) / 19, abs=1e-6)
    assert score_tracks(TRUTH, both(track(1, range(10), 20.0), track(2, range(10), 200.0))).mota == 0.0


def test_a_pair_that_held_is_kept():
    """A nearer newcomer does not take a vehicle from the track that has it (CLEAR)."""
    found = both(track(1, range(10), 8.0), track(2, range(5, 10), 1.0))
    scores = score_tracks(track("a", range(10)), found)
    assert scores.switches == 0 and scores.false_alarms == 5


def test_every_other_frame():
    found = TRUTH[TRUTH["frame"] % 2 == 0]
    assert score_tracks(TRUTH, found).mota == 1.0


def test_positions_where_there_are_no_boxes():
    frame = np.arange(8)
    truth = pd.DataFrame({"track_id": 1, "frame": frame, "x": 0.5 * frame, "y": 1.0})
    assert score_tracks(truth, truth.assign(y=1.5)).mota == 1.0
    assert score_tracks(truth, truth.assign(y=2.5)).mota == -1.0, "1.5 m off: a miss and a false alarm each"


def test_what_cannot_be_compared():
    with pytest.raises(InputError, match="shares no frame"):
        score_tracks(TRUTH, TRUTH.assign(frame=TRUTH["frame"] + 100))
    with pytest.raises(InputError, match="neither boxes"):
        score_tracks(TRUTH[["track_id", "frame"]], TRUTH)


def test_a_person_of_the_truth_is_neither_missed_nor_found():
    person = track("p", range(10), 400.0)
    found = both(track(1, range(10)), track(2, range(10), 200.0), track(3, range(10), 402.0), track(4, [0], 800.0))
    scores = score_tracks(TRUTH, found, others=person)
    assert (scores.misses, scores.false_alarms, scores.not_asked, scores.boxes) == (0, 1, 10, 20)
    beside = score_tracks(TRUTH, found, others=track("p", range(10), 1.0))
    assert (beside.misses, beside.false_alarms, beside.not_asked) == (0, 11, 0), "a person before a car hides nothing"


def test_a_vehicle_that_was_found_and_not_placed_is_not_missed():
    found, far = track(1, range(10)), track("", range(6), 203.0)
    scores = score_tracks(TRUTH, found, unplaced=far)
    assert (scores.misses, scores.unplaced, scores.boxes) == (4, 6, 14) and scores.mota == pytest.approx(10 / 14)
    assert score_tracks(TRUTH, TRUTH, unplaced=far).unplaced == 0, "what was placed counts"
