import numpy as np
import pandas as pd
import pytest

from vision.contract import InputError
from vision.exchange import read_mot, write_mot
from vision.interpolate import BOX
from vision.tracked import write_table


def tracks(names=("3", "11")):
    frame = np.arange(4)
    parts = [
        pd.DataFrame({"time": frame / 10, "track_id": name, "frame": frame, "confidence": 0.5}).assign(
            **{edge: 10.0 * side + k + frame for side, edge in enumerate(BOX)}
        )
        for k, name in enumerate(names)
    ]
    return pd.concat(parts, ignore_index=True)


def test_what_is_written_is_read_back(tmp_path):
    write_mot(tracks(), tmp_path / "t.txt")
    assert (tmp_path / "t.txt").read_text().splitlines()[:2] == [
        "1,3,0.00,10.00,20.00,20.00,0.5000,-1,-1,-1",
        "1,11,1.00,11.00,20.00,20.00,0.5000,-1,-1,-1",
    ]
    back = read_mot(tmp_path / "t.txt", 10.0).sort_values(["track_id", "frame"])
    expected = tracks().sort_values(["track_id", "frame"])
    assert back["track_id"].tolist() == expected["track_id"].tolist()
    np.testing.assert_allclose(back[[*BOX, "time", "frame"]], expected[[*BOX, "time", "frame"]])
    assert set(back["class"]) == {"vehicle"} and not back["interpolated"].any()


def test_names_that_are_not_numbers_are_numbered(tmp_path):
    write_mot(tracks(("b", "a")).drop(columns="confidence"), tmp_path / "t.txt")
    back = read_mot(tmp_path / "t.txt")
    assert set(back["track_id"]) == {"1", "2"} and (back["confidence"] == 1).all() and back["time"].isna().all()
    assert back.loc[back["track_id"] == "2", "box_left"].min() == 0.0, "b comes second"


def test_truth_has_classes_and_lines_that_do_not_count(tmp_path):
    (tmp_path / "gt.txt").write_text("1,1,0,0,9,9,1,3,1\n1,2,20,0,9,9,0,3,1\n2,1,1,0,9,9,1,5,0.4\n")
    truth = read_mot(tmp_path / "gt.txt", 25)
    assert truth["class"].tolist() == ["car", "motorcycle"] and truth["time"].tolist() == [0.0, 0.04]


def test_persons_of_the_truth_are_persons_unless_all_are(tmp_path):
    (tmp_path / "gt.txt").write_text("1,1,0,0,9,9,1,3,1\n1,2,20,0,9,9,1,1,1\n1,3,40,0,9,9,1,13,1\n")
    assert read_mot(tmp_path / "gt.txt")["class"].tolist() == ["car", "person", "vehicle"]
    (tmp_path / "one.txt").write_text("1,1,0,0,9,9,1,1,1\n1,2,20,0,9,9,1,1,1\n")
    assert set(read_mot(tmp_path / "one.txt")["class"]) == {"vehicle"}, "its only class, numbered 1"


BAD = {
    "empty": ("", "empty file"),
    "words": ("frame,id,left,top,w,h\n1,1,2,3,4,5\n", "not all lines are numbers"),
    "short": ("1,2,3,4\n", "not of the MOTChallenge form"),
    "hole": ("1,1,,3,4,5\n", "not of the MOTChallenge form"),
    "fraction": ("1.5,1,2,3,4,5\n", "not of the MOTChallenge form"),
    "frame 0": ("0,1,2,3,4,5\n", "a frame below 1"),
    "no area": ("1,1,2,3,0,5\n", "without area"),
    "detections": ("1,-1,2,3,4,5\n", "holds detections"),
    "twice": ("1,1,2,3,4,5\n1,1,2,3,4,5\n", "twice in frame 1"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_files(case, tmp_path):
    text, complaint = BAD[case]
    (tmp_path / "t.txt").write_text(text)
    with pytest.raises(InputError, match=complaint) as error:
        read_mot(tmp_path / "t.txt")
    assert "\n" not in str(error.value)


def test_missing_file_and_missing_boxes(tmp_path):
    with pytest.raises(InputError, match="No such file"):
        read_mot(tmp_path / "none.txt")
    with pytest.raises(InputError, match="no column box_left"):
        write_mot(tracks().drop(columns="box_left"), tmp_path / "t.txt")
    assert not list(tmp_path.iterdir())


def test_track_writes_it_by_the_suffix(tmp_path):
    write_table(tracks(), tmp_path / "t.txt")
    assert len(read_mot(tmp_path / "t.txt")) == 8
