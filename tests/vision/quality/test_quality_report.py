import json
import re
import sys
from html.parser import HTMLParser

import matplotlib.image
import numpy as np
import pandas as pd
import pytest
from made_tables import stamped, tracks, write

import roadfiber.command
from tests.offline_pages import EVIL, is_whole, tells
from tests.vision.videos import write_video
from vision.exchange import write_mot
from vision.interpolate import BOX
from vision.quality import read_settings
from vision.quality.figures import route_figure
from vision.quality.measures import measure, shared_edges


class Page(HTMLParser):
    """What a page loads, and its text."""

    def __init__(self, html):
        super().__init__()
        self.loads, self.text = [], ""
        self.feed(html)

    def handle_starttag(self, tag, attributes):
        self.loads += [value for name, value in attributes if name in ("src", "href", "xlink:href") and value]

    def handle_data(self, data):
        self.text += data


@pytest.fixture
def command(monkeypatch, capsys, tmp_path):
    """Run `roadfiber quality ...` in a folder of its own: exit status, what it printed, what it complained of."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["roadfiber", "-q", "quality", *map(str, arguments)])
        with pytest.raises(SystemExit) as end:
            roadfiber.command.main()
        return end.value.code or 0, *capsys.readouterr()

    return run


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Two settings in meters and in pixels, the truth, and a video of their size."""
    folder = tmp_path_factory.mktemp("tracks")
    for name, options in {"fine": {"noise": 0.05, "flicker": 0.05}, "rough": {"noise": 0.5, "missed": 0.05}}.items():
        write(stamped(tracks(**options)), folder / f"{name}.csv")
        write(tracks(**options, metric=False), folder / f"{name}_px.csv")
    write_mot(tracks(noise=0.0), folder / "truth.txt")
    (folder / "fine.json").write_text(json.dumps({"frames_per_second": {"all": 61.0}}))
    image = np.full((160, 640, 3), 90, np.uint8)
    write_video(folder / "street.mp4", [image] * 400)
    return folder


def test_the_report_is_whole_and_offline(files, command, tmp_path):
    code, out, _ = command(
        files / "fine.csv", files / "rough.csv", "--truth", files / "truth.txt", "--video", files / "street.mp4"
    )
    assert code == 0 and "use fine: it agrees best with the truth (HOTA)" in out
    assert "fine: 7 vehicles, 229 frames each" in out and "(good), MOTA 1, IDF1 1, HOTA 0.9" in out
    folder = tmp_path / "quality"
    assert {path.name for path in folder.iterdir()} == {
        "report.html", "quality.json", "jitter.png", "classes.png", "route.png", "heat-fine.png", "heat-rough.png",
    }  # fmt: skip
    html = (folder / "report.html").read_text()
    page = Page(html)
    assert len(page.loads) >= 2 and all(load.startswith(("data:image/png;base64,", "#")) for load in page.loads)
    assert not re.search(r"url\((?!#)|@import", html), "nothing comes from elsewhere"
    for words in ("Use fine: good enough for the fiber", "35 cm", "What it does to the route", "HOTA", "61"):
        assert words in page.text, words
    facts = json.loads((folder / "quality.json").read_text())
    fine, rough = facts["settings"]
    assert facts["use"] == "fine" and facts["good_enough"] == "good" and rough["good_enough"] == "poor"
    assert fine["scores"]["mota"] == 1.0 and fine["frames_per_second"] == {"all": 61.0}
    assert len(fine["jitter"]["after"]) == len(fine["route"]) == 10 and fine["jitter"]["parked_vehicles"] == 1
    assert [entry["role"] for entry in facts["inputs"]] == ["tracks", "tracks", "truth", "video"]


def test_motchallenge_files_have_a_report(files, command, tmp_path):
    code, out, _ = command(files / "truth.txt", "--frame-rate", 25)
    assert code == 0 and "truth: 7 vehicles, 229 frames each" in out and (tmp_path / "quality" / "report.html").exists()


def test_on_the_report_names_are_text(files, command, tmp_path):
    """Classes and tracks of a table, and its file's name, which has no slash."""
    table = pd.read_csv(files / "fine.csv")
    table["track_id"] = [f"{EVIL}{one}" for one in table["track_id"]]
    write(table.assign(**{"class": EVIL, "detected_class": EVIL}), tmp_path / f"{EVIL}.csv")
    code, _, _ = command(tmp_path / f"{EVIL}.csv", "--video", files / "street.mp4")
    text = (tmp_path / "quality" / "report.html").read_text()
    assert code == 0 and tells(text) and is_whole(text)


def test_the_one_to_use_is_first_and_figures_stay_in_their_panels(files, command, tmp_path):
    """Beside tables of a shorter view, and with names that no title holds."""
    short = tracks(noise=0.6)
    name = "a_detector_with_a_name_that_is_longer_than_any_title_of_a_panel_that_stands_beside_another.csv"
    write(stamped(short[short["x"] < 40]), tmp_path / name)
    code, _, _ = command(files / "rough.csv", tmp_path / name, files / "fine.csv", "--truth", files / "truth.txt")
    html = (tmp_path / "quality" / "report.html").read_text()
    assert code == 0 and re.findall(r"<th[^>]*>(\w+)", html)[0] == "fine"
    settings = read_settings([tmp_path / name, files / "fine.csv"]).settings
    found = [measure(setting, shared_edges(settings), 10.0) for setting in settings]
    figure = route_figure(found)
    figure.draw_without_rendering()
    for ax in figure.axes:
        box = ax.get_window_extent()
        texts = [*ax.texts, ax.title, ax._left_title]
        reach = [text.get_window_extent() for text in texts if text.get_text()]
        assert min(r.x0 for r in reach) >= box.x0 - 3 and max(r.x1 for r in reach) <= box.x1 + 3


def test_the_heat_map_is_where_the_boxes_are(files, command, tmp_path):
    code, _, _ = command(files / "fine.csv", "--video", files / "street.mp4")
    picture = matplotlib.image.imread(tmp_path / "quality" / "heat-fine.png")[..., :3]
    assert code == 0 and picture.shape == (160, 640, 3)
    color = np.ptp(picture, axis=2)
    lane = round(130 + 5 * 1.75)
    assert color[lane, 100:500].min() > 0.15 and color[:80].max() < 0.02 and color[:, 620:].max() < 0.02


def test_pixels_are_not_judged(files, command, tmp_path):
    code, out, _ = command(files / "fine_px.csv", files / "rough_px.csv", "--json", "--out", "q")
    facts = json.loads(out)
    assert code == 0 and facts["good_enough"] == "unknown" and facts["settings"][0]["route"] is None
    text = Page((tmp_path / "q" / "report.html").read_text()).text
    assert "in pixels only" in text and "35 cm" not in text and not (tmp_path / "q" / "route.png").exists()


def test_an_earlier_report_is_replaced_and_nothing_else(files, command, tmp_path):
    assert command(files / "fine.csv")[0] == 0 and command(files / "rough.csv")[0] == 0
    assert not (tmp_path / "quality" / "heat-fine.png").exists()
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("years of work")
    code, _, err = command(files / "fine.csv", "--out", "mine")
    assert code == 2 and "is not an earlier report" in err and (tmp_path / "mine" / "thesis.txt").exists()


def test_classes_that_no_table_has_are_reported_and_do_not_count(files, command, tmp_path):
    everything = tracks(noise=0.0)
    persons = everything[everything["track_id"] == "2"].assign(track_id="p", **{"class": "person"})
    write(pd.concat([everything, persons]), tmp_path / "truth.csv")
    code, out, _ = command(files / "fine.csv", "--truth", tmp_path / "truth.csv")
    assert code == 0 and "Compared with 6 car of the truth; left out of it: 1 person, 1 parked car" in out
    facts = json.loads((tmp_path / "quality" / "quality.json").read_text())
    assert facts["settings"][0]["scores"]["mota"] == 1.0
    assert facts["truth"]["tracks_not_compared"] == {"person": 1, "parked car": 1}
    code, out, _ = command(files / "fine.csv", "--truth", tmp_path / "truth.csv", "--classes", "car,person", "--json")
    assert json.loads(out)["settings"][0]["scores"]["misses"] == 200
    code, _, err = command(files / "fine.csv", "--truth", tmp_path / "truth.csv", "--classes", "tram")
    assert code == 2 and "has no tram, but 7 car" in err and err.count("\n") == 1


def test_tracks_that_meet_nothing_of_the_truth_are_told(command, tmp_path):
    everything = tracks(noise=0.0, vehicles=1)
    write(everything, tmp_path / "truth.csv")
    write(everything.drop(columns=["x", "y"]).assign(**(everything[BOX] + 1000)), tmp_path / "lower.csv")
    code, out, _ = command(tmp_path / "lower.csv", "--truth", tmp_path / "truth.csv")
    assert code == 0 and "No fix of lower meets one of the truth: are frames counted from the same one" in out


@pytest.mark.parametrize("columns", [["x", "y"], BOX])
def test_a_parked_vehicle_that_track_leaves_out_is_not_missed(columns, command, tmp_path):
    everything = tracks(noise=0.0, vehicles=2)
    write(everything.drop(columns=[name for name in ["x", "y", *BOX] if name not in columns]), tmp_path / "truth.csv")
    write(everything[everything["track_id"] != "3"], tmp_path / "moving.csv")
    _, out, _ = command(tmp_path / "moving.csv", "--truth", tmp_path / "truth.csv", "--json")
    assert json.loads(out)["settings"][0]["scores"]["mota"] == 1.0


def test_one_table_that_cannot_be_read_is_reported(files, command, tmp_path):
    (tmp_path / "bad.csv").write_text("time,track_id\n1,2\n")
    code, out, _ = command(
        tmp_path / "bad.csv", files / "fine.csv", files / "rough.csv", "--truth", files / "truth.txt"
    )
    assert code == 0 and "bad.csv: no column class, frame" in out and "use fine" in out
    assert "chosen by the highest HOTA against the truth" in out
    facts = json.loads((tmp_path / "quality" / "quality.json").read_text())
    assert len(facts["left_out"]) == 1 and [one["name"] for one in facts["settings"]] == ["fine", "rough"]
    text = Page((tmp_path / "quality" / "report.html").read_text()).text
    assert "bad.csv: no column class, frame" in text and "Chosen by the highest HOTA" in text


def test_a_table_of_frames_that_the_truth_has_not_is_reported_and_the_others_go_on(files, command, tmp_path):
    everything = tracks(noise=0.0)
    write(everything[everything["frame"] < 150], tmp_path / "truth.csv")
    write(stamped(everything[everything["frame"] >= 200]), tmp_path / "late.csv")
    code, out, _ = command(files / "fine.csv", tmp_path / "late.csv", "--truth", tmp_path / "truth.csv", "--json")
    facts = json.loads(out)
    assert code == 0 and [one["name"] for one in facts["settings"]] == ["fine"]
    assert len(facts["left_out"]) == 1 and f"shares no frame with {tmp_path / 'late.csv'}" in facts["left_out"][0]
    assert facts["settings"][0]["scores"]["misses"] == 0


@pytest.mark.parametrize("rows", [slice(1), slice(2), slice(9), slice(-400, None)])
def test_little_is_enough_for_a_report(rows, files, command, tmp_path):
    """One fix, a few, and a parked vehicle alone."""
    table = tracks().iloc[rows].assign(x=3.0)
    assert command(write(stamped(table), files / "little.csv"))[0] == 0
    assert json.loads((tmp_path / "quality" / "quality.json").read_text())["settings"][0]["tracks"] == 1


BAD = {
    "no file": (["none.csv"], "no such file"),
    "other video": (["FILES/fine.csv", "FILES/shifted.csv"], "no frame in common"),
    "names": (["FILES/fine.csv", "--names", "a,b"], "2 different names for 1 tables"),
    "no truth": (["FILES/fine.csv", "--truth", "gt.csv"], "no such file"),
    "other truth": (["FILES/fine.csv", "--truth", "FILES/shifted.csv"], "shares no frame"),
    "no video": (["FILES/fine.csv", "--video", "none.mp4"], "no such file"),
    "small video": (["FILES/fine.csv", "--video", "FILES/small.mp4"], "give the video of these tracks"),
    "gauge": (["FILES/fine.csv", "--gauge-length", "0"], "above 0 m"),
    "rate": (["FILES/truth.txt", "--frame-rate", "-1"], "above 0"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_one_line_and_nothing_is_written(case, files, command, tmp_path):
    arguments, complaint = BAD[case]
    table = tracks()
    write(stamped(table.assign(frame=table["frame"] + 9000)), files / "shifted.csv")
    if not (files / "small.mp4").exists():
        write_video(files / "small.mp4", [np.zeros((64, 96, 3), np.uint8)] * 400)
    code, out, err = command(*(text.replace("FILES", str(files)) for text in arguments))
    assert code == 2 and out == "" and complaint in err and err.count("\n") == 1, err
    assert not list(tmp_path.iterdir())
