"""A drawn street, through a real video file and a real ONNX graph, to trajectories."""

import json
import re
import sys
from dataclasses import replace

import cv2
import numpy as np
import pandas as pd
import pytest

import roadfiber.command
from tests.vision.graphs import write_bright_spot_detector, write_graph
from tests.vision.test_camera import look
from tests.vision.videos import numbered_images, set_creation_time, set_frame_durations, write_video
from vision.body_fit import project_bodies
from vision.camera import Calibration
from vision.contract import COLUMNS, InputError, read_trajectories
from vision.detectors import Detections, load_detector
from vision.dropped import SHAPE, causes, read_dropped
from vision.frames import Frame
from vision.pipeline import box_tracks, start_time, track
from vision.rendered import note_rendered
from vision.vehicles import SHAPES
from vision.video import open_video

SIZE, FRAMES, SPEED, LANE = (640, 360), 70, 9.0, 1.75
TICKS = [256, 768] * (FRAMES // 2)  # of 1/12800 s: a frame rate that alternates between 50 and 16.7 per s
HOMOGRAPHY, _ = look((20, -14, -9), (20, 2, 0), 420, SIZE)
START = "2025-08-11T06:00:00.25Z"


def place(time):
    return np.stack([8 + SPEED * time, np.full_like(time, LANE)], axis=1)


@pytest.fixture(scope="module")
def survey(tmp_path_factory):
    """A car on a dark street: video of variable frame rate, calibration, detector."""
    folder = tmp_path_factory.mktemp("survey")
    calibration = Calibration(image_size=SIZE, homography=HOMOGRAPHY)
    time = np.concatenate([[0], np.cumsum(TICKS)[:-1]]) / 12800
    corners = SHAPES["car"].corners(SHAPES["car"].size)
    images = []
    for body in project_bodies(calibration.pinhole(), corners, place(time), np.zeros(FRAMES)):
        image = np.full((SIZE[1], SIZE[0], 3), 50, np.uint8)
        outline = cv2.convexHull(body.astype(np.float32)) * 16
        images.append(cv2.fillConvexPoly(image, outline.round().astype(np.int32), (220, 220, 220), shift=4))
    images[30] = np.full_like(images[0], 50)  # a miss inside the track
    set_frame_durations(write_video(folder / "street.mp4", images), TICKS)
    calibration.write(folder / "calibration.json")
    write_bright_spot_detector(folder / "spot.onnx", SIZE)
    return folder


@pytest.fixture
def command(monkeypatch, capsys, tmp_path):
    """Run `roadfiber track ...` in an empty folder: exit status, what it printed, what it complained of."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["roadfiber", "-q", "track", *map(str, arguments)])
        with pytest.raises(SystemExit) as end:
            roadfiber.command.main()
        return end.value.code or 0, *capsys.readouterr()

    return run


def test_trajectories_are_where_and_when_the_car_was(survey):
    table = track(
        survey / "street.mp4",
        detector=survey / "spot.onnx",
        calibration=survey / "calibration.json",
        start=START,
        clock_offset=0.4,
    ).table
    seconds = (table["time"] - pd.Timestamp(START)).dt.total_seconds().to_numpy() + 0.4
    assert table["track_id"].nunique() == 1 and set(table["class"]) == {"car"}
    assert table["frame"].tolist() == list(range(FRAMES)), "the missing frame is filled"
    assert table["interpolated"].to_numpy().nonzero()[0].tolist() == [30]
    true = place(seconds)
    assert np.abs(table["x"] - true[:, 0]).max() < 0.12 and np.abs(table["y"] - true[:, 1]).max() < 0.12
    assert table[["sigma_x", "sigma_y"]].to_numpy().max() < 0.5
    assert table["length"].iloc[0] == pytest.approx(4.4, abs=0.2)


def test_every_other_frame(survey):
    table = track(
        survey / "street.mp4",
        detector=survey / "spot.onnx",
        calibration=survey / "calibration.json",
        start=START,
        every=2,
    ).table
    assert table["frame"].tolist() == list(range(0, FRAMES, 2))


def test_command_writes_what_the_solver_reads(survey, command, tmp_path):
    code, out, _ = command(
        survey / "street.mp4", "--calibration", survey / "calibration.json", "--detector", survey / "spot.onnx",
        "--start", START,
    )  # fmt: skip
    assert code == 0 and "1 vehicles: 1 car" in out and "median sigma" in out and "frames per second" in out
    table = read_trajectories([tmp_path / "trajectories.csv"])
    assert list(table)[:7] == list(COLUMNS) and len(table) == FRAMES
    assert (table["time"].iloc[0] - pd.Timestamp(START)).total_seconds() == pytest.approx(0, abs=1e-6)


def test_the_speed_is_that_of_the_car(survey, command, tmp_path):
    command(
        survey / "street.mp4", "--calibration", survey / "calibration.json", "--detector", survey / "spot.onnx",
        "--start", START,
    )  # fmt: skip
    speed = read_trajectories([tmp_path / "trajectories.csv"])["speed"]
    assert np.abs(speed - SPEED).mean() < 0.2 and np.abs(speed - SPEED).max() < 1.0


@pytest.mark.parametrize("metric", [True, False])
def test_the_video_is_drawn_with_its_tracks(survey, command, tmp_path, metric, monkeypatch):
    words, write = [], cv2.putText
    monkeypatch.setattr(cv2, "putText", lambda canvas, text, *rest: words.append(text) or write(canvas, text, *rest))
    calibrated = ("--calibration", survey / "calibration.json", "--start", START) if metric else ()
    code, out, _ = command(
        survey / "street.mp4", "--detector", survey / "spot.onnx", "--draw", "drawn.mp4", *calibrated
    )
    assert code == 0 and "drawn.mp4" in out and len(words) == FRAMES
    assert all(
        re.fullmatch(r"1 car [89]\.\d m/s at \d+\.\d, -?\d\.\d m" if metric else "1 car", text) for text in words
    )
    drawn, true = open_video(tmp_path / "drawn.mp4"), open_video(survey / "street.mp4")
    assert (drawn.width, drawn.height) == SIZE
    assert drawn.time[-1] == pytest.approx(true.time[-1] - true.time[0], abs=0.1)
    assert drawn.sample(3)[1].image.std(axis=2).max() > 60, "colors over a gray street"


@pytest.mark.parametrize(
    ("draw", "message"), [("a.gif", "is written as .mp4"), ("street.mp4", "is the video to track")]
)
def test_a_drawing_that_cannot_be_is_refused_before_the_work(survey, command, draw, message, tmp_path):
    target = survey / draw if draw == "street.mp4" else tmp_path / draw
    before = (survey / "street.mp4").read_bytes()
    code, _, err = command(survey / "street.mp4", "--detector", survey / "spot.onnx", "--draw", target)
    assert code == 2 and message in err and not (tmp_path / "boxes.csv").exists()
    assert (survey / "street.mp4").read_bytes() == before


def test_command_says_what_was_not_placed_and_why(survey, command, tmp_path):
    (tmp_path / "t.csv.dropped").write_text("of an earlier run")
    usual = survey / "street.mp4", "--detector", survey / "spot.onnx", "--start", START, "--out", "t.csv"
    _, out, _ = command(*usual, "--json")
    assert "fixes_placed" not in json.loads(out) and not (tmp_path / "t.csv.dropped").exists()
    # So sheared that cars seem to grow; from 1.2e-3 on by more than edges of 4 % explain, from 2e-3 no camera sees so.
    sheared = HOMOGRAPHY @ np.array([[1, 0, 0], [0, 1, 0], [1.2e-3, 0, 1]])
    Calibration(image_size=SIZE, homography=sheared).write(tmp_path / "c.json")
    code, out, _ = command(*usual, "--calibration", tmp_path / "c.json")
    code, answer, _ = command(*usual, "--calibration", tmp_path / "c.json", "--json")
    facts, dropped = json.loads(answer), read_dropped(tmp_path / "t.csv")
    assert code == 0 and facts["fixes_not_placed"] == causes(dropped) and SHAPE in set(dropped["cause"])
    assert all(line in out for line in facts["taken"]) and "class names COCO's, which is assumed" in facts["taken"][0]
    assert "frames timed by the file" in out and "Z, as given" in out and "those usual of its class" in out
    assert "the calibration states no uncertainty of its own" in out
    assert facts["fixes_placed"] + len(dropped) == FRAMES - 1, "one frame shows nothing"
    assert f"{facts['fixes_placed']} of {FRAMES - 1} detected fixes placed on the road; " in out
    assert all(f"{count} {cause}" in out for cause, count in facts["fixes_not_placed"].items())


def test_command_without_a_calibration(survey, command, tmp_path):
    code, out, _ = command(
        survey / "street.mp4", "--detector", survey / "spot.onnx", "--out", "b.parquet", "--json", "--no-cache"
    )
    summary = json.loads(out)
    assert summary["frames_detected_before"] == 0
    assert code == 0 and summary["tracks"] == 1 and summary["by_class"] == {"car": 1} and not summary["metric"]
    assert set(summary["frames_per_second"]) == {"decode", "detect", "track", "all"}
    table = pd.read_parquet(tmp_path / "b.parquet")
    assert len(table) == FRAMES and {"time", "track_id", "class", "box_left", "confidence", "frame"} <= set(table)
    assert table["time"].iloc[-1] == pytest.approx(sum(TICKS[:-1]) / 12800)


def test_command_keeps_detections(survey, command, tmp_path):
    arguments = survey / "street.mp4", "--detector", survey / "spot.onnx", "--cache", tmp_path / "kept"
    _, out, _ = command(*arguments, "--json")
    summary = json.loads(out)
    assert summary["frames_detected_before"] == 0
    first = (tmp_path / "boxes.csv").read_bytes()
    code, out, _ = command(*arguments)
    assert code == 0 and f"detections of {FRAMES} of {FRAMES} frames were kept from before" in out
    assert (tmp_path / "boxes.csv").read_bytes() == first
    _, out, _ = command(*arguments, "--json", "--min-score", "0.3")
    again = json.loads(out)["frames_per_second"]
    assert again["detect"] == summary["frames_per_second"]["detect"], "what it took when it was done"
    _, out, _ = command(*arguments, "--json", "--no-cache")
    assert json.loads(out)["frames_detected_before"] == 0


def test_cut_short_video(survey, command, tmp_path_factory):
    """What a recorder that died leaves: the index is there, the pictures are not."""
    data = bytearray((survey / "street.mp4").read_bytes())
    start, end = data.find(b"mdat") + 4, data.find(b"moov") - 4
    middle = start + (end - start) // 50
    data[middle:end] = bytes(end - middle)
    cut = tmp_path_factory.mktemp("cut") / "cut.mp4"
    cut.write_bytes(data)
    code, out, err = command(cut, "--detector", survey / "spot.onnx")
    assert code == 2 and out == "" and err.count("\n") == 1
    assert "cut short or damaged" in err or "no frame decodes" in err


def test_start_comes_from_the_header(survey, tmp_path, caplog):
    path = write_video(tmp_path / "v.mp4", numbered_images(3))
    set_creation_time(path, np.datetime64("2026-03-04T05:06:07"))
    assert start_time(None, open_video(path)) == np.datetime64("2026-03-04T05:06:07")
    assert start_time("2025-08-11T08:00:00+02:00", open_video(path)) == np.datetime64("2025-08-11T06:00:00")
    assert "its header says 2026-03-04T05:06:07Z, +17708767 s from the start" in caplog.text
    video = replace(open_video(path), time=np.arange(20.0))
    assert video.header_line(video.created) == ""
    assert "when it ends by the start that is taken" in video.header_line(video.created - np.timedelta64(19, "s"))


BAD = {
    "no start": ([], "does not say when it was recorded; give --start"),
    "no zone": (["--start", "2025-08-11T06:00:00"], "has no time zone"),
    "no time": (["--start", "yesterday"], "is not a time"),
    "no video": (["--start", START, "VIDEO:none.mp4"], "no such file"),
    "no detector": (["--start", START, "--detector", "none.onnx"], "no such file"),
    "layout": (["--start", START, "--layout", "yolo99"], "layout 'yolo99' is unknown"),
    "class": (["--start", START, "--classes", "tram"], "knows no class tram"),
    "calibration": (["--start", START, "--calibration", "none.json"], "No such file"),
    "size": (
        ["--start", START, "--calibration", "SIZE"],
        "is 640 x 360 px but the calibration was made for 1280 x 720",
    ),
    "nothing": (["--start", START, "--classes", "bus"], "no vehicle was followed"),
    "not on the road": (["--start", START, "--calibration", "ELSEWHERE"], "lies on the calibrated road"),
    "suffix": (["--start", START, "--out", "t.xlsx"], r"\.csv.*\.parquet"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_one_line_and_nothing_is_written(case, survey, command, tmp_path_factory, tmp_path):
    extra, complaint = BAD[case]
    video = next((item[6:] for item in extra if item.startswith("VIDEO:")), survey / "street.mp4")
    folder = tmp_path_factory.mktemp("other")
    Calibration(image_size=(1280, 720), homography=look((20, -14, -9), (20, 2, 0), 840, (1280, 720))[0]).write(
        folder / "SIZE"
    )
    upward = look((20, -14, -9), (20, 86, -37.6), 420, SIZE)[0]  # the horizon is below the car
    Calibration(image_size=SIZE, homography=upward).write(folder / "ELSEWHERE")
    extra = [
        folder / item if item in ("SIZE", "ELSEWHERE") else item for item in extra if not item.startswith("VIDEO:")
    ]
    usual = ["--calibration", survey / "calibration.json", "--detector", survey / "spot.onnx"]
    code, out, err = command(video, *usual, *extra)
    assert code == 2 and out == ""
    assert err.count("\n") == 1 and err.startswith("roadfiber: ")
    assert pd.Series([err]).str.contains(complaint, regex=case == "suffix").item(), err
    assert not list(tmp_path.iterdir())


def test_no_vehicle_names_the_score(survey, tmp_path):
    class Blind:
        threshold = 0.5

        def prepare(self, video):
            return self

        def detect(self, image):
            return Detections(np.zeros((0, 4)), np.zeros(0), np.zeros(0, str))

    with pytest.raises(InputError, match=r"lower --min-score than 0\.5"):
        box_tracks(open_video(survey / "street.mp4"), Blind())


@pytest.mark.parametrize("rendered", [False, True])
def test_the_demos_detector_warns_of_itself_except_on_renderings(rendered, tmp_path, caplog):
    clip = write_video(tmp_path / "street.mp4", numbered_images(6))
    if rendered:
        note_rendered(clip)
    with pytest.raises(InputError, match="no vehicle was followed"):
        box_tracks(open_video(clip), load_detector("street"))
    told = [record.getMessage() for record in caplog.records if record.levelname == "WARNING"]
    assert bool(told) != rendered
    assert all("MOTA" in line and "--detector" in line for line in told)


def test_a_graph_that_is_not_a_detector(survey, command, tmp_path_factory):
    classifier = tmp_path_factory.mktemp("m") / "classifier.onnx"
    write_graph(classifier, {"logits": np.zeros((1, 1000), np.float32)})
    code, _, err = command(survey / "street.mp4", "--detector", classifier)
    assert code == 2 and "gives logits [1, 1000]; give a detector" in err and len(err) < 250


@pytest.mark.parametrize("model", ["yolox_nano", "nanodet_m_416", "deimv2_hgnetv2_atto_coco"])
def test_real_video_with_real_models(model, shared_data):
    video = open_video(shared_data / "video" / "abhishek-verma-github_highway.mp4")
    table, speed, _ = box_tracks(video, load_detector(shared_data / "models" / f"{model}.onnx"), every=8)
    longest = table.groupby("track_id").size().sort_values().tail(4)
    assert table["track_id"].nunique() >= 6 and longest.min() >= 8 and speed.frames == 43
    for track_id in longest.index:  # on a motorway, boxes go one way
        middle = table.loc[table["track_id"] == track_id, ["box_left", "box_bottom"]].to_numpy()
        travel = np.linalg.norm(middle[-1] - middle[0])
        assert np.linalg.norm(np.diff(middle, axis=0), axis=1).sum() < 1.3 * travel + 30


def test_a_car_that_leaves_is_not_the_one_that_comes_from_the_vanishing_point():
    """Boxes of one that drives off, a flicker of far pixels, then one that comes: two tracks, not one."""
    homography, matrix = look((-10, 6, -9), (25, 0, 0), 420, SIZE)
    view = Calibration(image_size=SIZE, homography=homography)
    away = np.column_stack([np.linspace(10, 400, 60), np.full(60, 1.75)])
    back = np.column_stack([np.linspace(400, 10, 60), np.full(60, -1.75)])

    class Clip:
        path, index, time, frame_interval = "clip", np.arange(120), np.arange(120) * 0.4, 0.4

        def __len__(self):
            return 120

        def decoded(self, wanted):
            return (Frame(k, float(self.time[k]), np.full((1, 1), k)) for k in wanted)

    class Known:
        threshold = 0.4

        def prepare(self, video):
            return self

        def detect(self, image):
            x, y = np.concatenate([away, back])[int(image[0, 0])]
            corners = np.array([[x + a, y + b, c, 1] for a in (-2.2, 2.2) for b in (-0.9, 0.9) for c in (-1.5, 0)])
            pixels = corners @ matrix.T
            pixels = pixels[:, :2] / pixels[:, 2:]
            box = np.concatenate([pixels.min(0), pixels.max(0)])[None]
            return Detections(box, np.array([0.9]), np.array(["car"]))

    chained, _, _ = box_tracks(Clip(), Known())
    assert chained["track_id"].nunique() == 1, "without a calibration nothing tells them apart"
    table, _, _ = box_tracks(Clip(), Known(), calibration=view)
    assert table["track_id"].nunique() == 2
    halves = [set(track["frame"] >= 60) for _, track in table.groupby("track_id")]
    assert halves == [{False}, {True}]


class Drawn:
    """A clip without pictures: frames know their number only."""

    path, index, time, frame_interval = "clip", np.arange(60), np.arange(60) * 0.04, 0.04

    def __len__(self):
        return 60

    def decoded(self, wanted):
        return (Frame(k, float(self.time[k]), np.full((1, 1), k)) for k in wanted)


def test_what_never_moves_is_left_out_and_what_comes_nearer_is_not(caplog):
    class Known:
        threshold = 0.4

        def prepare(self, video):
            return self

        def detect(self, image):
            k = int(image[0, 0])
            parked = [20 + k % 2, 20, 80, 60]
            coming = [300 - k, 100 - k, 320 + k, 115 + k]  # its middle stays
            waiting = [200 + 6 * max(k - 50, 0), 200, 240 + 6 * max(k - 50, 0), 230]  # and then drives off
            return Detections(np.array([parked, coming, waiting], float), np.full(3, 0.9), np.full(3, "car"))

    with caplog.at_level("INFO", logger="roadfiber"):
        table, *_ = box_tracks(Drawn(), Known())
    assert table["track_id"].nunique() == 2 and (table.groupby("track_id").size() == 60).all()
    assert table["box_left"].min() > 100, "the parked one is gone"
    assert [record.getMessage() for record in caplog.records if "left out" in record.getMessage()] == [
        "1 tracks that end where they began are left out: parked vehicles or false alarms"
    ]
