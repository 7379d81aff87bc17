import numpy as np
import pandas as pd

from vision.interpolate import BOX, fill_frames, majority_class


def fixes(track_id, frame, time, label="car", confidence=0.5):
    time = np.asarray(time, float)
    boxes = {name: 100.0 + 10 * side + 30 * time for side, name in enumerate(BOX)}
    return pd.DataFrame(
        {"track_id": track_id, "frame": frame, "time": time, "class": label, "confidence": confidence, **boxes}
    ).assign(detected_class=label)


def test_class_is_weighted_by_score():
    table = fixes(1, range(5), range(5), ["car", "car", "car", "van", "van"], [0.2, 0.2, 0.2, 0.5, 0.4])
    other = fixes(2, range(2), range(2), ["truck", "bus"], [0.5, 0.5])
    named = majority_class(pd.concat([table, other], ignore_index=True))
    assert named["class"].tolist() == ["van"] * 5 + ["bus"] * 2, "a tie goes to the first by name"
    assert named["detected_class"].tolist() == ["car", "car", "car", "van", "van", "truck", "bus"]


def test_gaps_are_filled_in_true_time():
    frame = np.arange(0, 40, 2)  # every other frame was looked at
    time = np.cumsum(np.tile([0.079, 0.119], 10))
    seen = np.array([3, 4, 8, 9])
    filled = fill_frames(fixes(7, frame[seen], time[seen]), frame, time)
    assert filled["frame"].tolist() == frame[3:10].tolist()
    assert filled["interpolated"].tolist() == [False, False, True, True, True, False, False]
    assert filled["detected_class"].tolist() == ["car", "car", "", "", "", "car", "car"]
    np.testing.assert_allclose(filled["time"], time[3:10])
    np.testing.assert_allclose(filled["box_left"], 100 + 30 * time[3:10])
    np.testing.assert_allclose(filled["box_bottom"], 130 + 30 * time[3:10])


def test_tracks_do_not_mix():
    frame, time = np.arange(10), np.arange(10) / 10
    table = pd.concat([fixes(2, frame[[0, 9]], time[[0, 9]], "bus"), fixes(1, frame[[2, 4]], time[[2, 4]])])
    filled = fill_frames(table, frame, time)
    assert filled.groupby("track_id").size().to_dict() == {1: 3, 2: 10}
    assert filled.groupby("track_id")["class"].first().to_dict() == {1: "car", 2: "bus"}


def test_no_tracks():
    empty = fixes(1, [], [])
    assert list(fill_frames(empty, np.arange(3), np.arange(3.0))) == [*empty, "interpolated"]
