"""Detections and timestamps that are kept: what a second look costs, what a changed input or a damaged file does."""

import os
import sys
from contextlib import closing
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest

import vision.video
from tests.vision.graphs import write_bright_spot_detector
from tests.vision.videos import write_video
from vision.cache import cache_folder, checksum, keep_arrays, kept_arrays, prune
from vision.contract.errors import InputError
from vision.detectors import OnnxDetector, load_detector
from vision.detectors import look as looking
from vision.detectors.kept import Kept
from vision.detectors.look import look
from vision.pipeline import box_tracks
from vision.video import VideoFile, open_video

FRAMES, SIZE = 40, (160, 120)


def street(path, shade=220):
    """A bright car that drives to the right."""
    images = []
    for frame in range(FRAMES):
        image = np.full((SIZE[1], SIZE[0], 3), 40, np.uint8)
        images.append(cv2.rectangle(image, (10 + 2 * frame, 50), (50 + 2 * frame, 80), (shade, shade, shade), -1))
    return write_video(path, images)


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    return write_bright_spot_detector(tmp_path_factory.mktemp("model") / "spot.onnx", SIZE)


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    return street(tmp_path_factory.mktemp("clip") / "street.mp4")


@pytest.fixture
def work(monkeypatch):
    """Places of the frames that were detected, and of those that were decoded, in turn."""
    done = {"detected": 0, "decoded": [], "prepared": 0, "scanned": 0}
    detect_all, decoded, prepare, scan = (
        OnnxDetector.detect_all,
        VideoFile.decoded,
        OnnxDetector.prepare,
        vision.video.frame_times,
    )

    def count_detect(self, images):
        found = detect_all(self, images)
        done["detected"] += len(found)
        return found

    def count_frames(self, wanted):
        for frame in decoded(self, wanted):
            done["decoded"].append(frame.index)
            yield frame

    def count_prepare(self, video):
        done["prepared"] += 1
        return prepare(self, video)

    def count_scan(*arguments):
        done["scanned"] += 1
        return scan(*arguments)

    monkeypatch.setattr(OnnxDetector, "detect_all", count_detect)
    monkeypatch.setattr(OnnxDetector, "prepare", count_prepare)
    monkeypatch.setattr(VideoFile, "decoded", count_frames)
    monkeypatch.setattr(vision.video, "frame_times", count_scan)
    return done


def see(clip, model, cache, every=1, **options):
    return list(look(open_video(clip, cache), load_detector(model, **options), every, cache=cache))


def same(a, b):
    return all(
        x.index == y.index
        and x.time == y.time
        and np.array_equal(x.found.box, y.found.box)
        and np.array_equal(x.found.score, y.found.score)
        and np.array_equal(x.found.label, y.found.label)
        for x, y in zip(a, b, strict=True)
    )


def test_a_second_look_costs_nothing_and_sees_the_same(clip, model, tmp_path, work):
    first = see(clip, model, tmp_path)
    assert work["detected"] == FRAMES and work["scanned"] == 1 and sum(len(now.found) for now in first) == FRAMES
    work.update(detected=0, decoded=[], prepared=0, scanned=0)
    again = see(clip, model, tmp_path)
    assert same(first, again), "to the last bit"
    assert work == {"detected": 0, "decoded": [], "prepared": 0, "scanned": 0}
    assert all(now.image is None for now in again)


def test_what_a_frame_took_is_known_later(clip, model, tmp_path):
    first, again = see(clip, model, tmp_path), see(clip, model, tmp_path)
    assert [(now.decode, now.detect) for now in again] == [(now.decode, now.detect) for now in first]
    assert min(now.detect for now in again) > 0


def test_without_a_cache_nothing_is_kept(clip, model, tmp_path, work, monkeypatch):
    monkeypatch.setenv("ROADFIBER_CACHE", str(tmp_path))
    assert same(see(clip, model, None), see(clip, model, None))
    assert work["detected"] == 2 * FRAMES and not list(tmp_path.iterdir())


def test_tracks_of_a_second_look_are_the_same(clip, model, tmp_path, work):
    video, detector = open_video(clip), load_detector(model)
    first, _, _ = box_tracks(video, detector, cache=tmp_path)
    again, speed, _ = box_tracks(video, detector, cache=tmp_path)
    pd.testing.assert_frame_equal(first, again)
    assert work["detected"] == FRAMES and first["track_id"].nunique() == 1 and speed.frames == FRAMES


def test_a_denser_look_detects_only_what_is_missing(clip, model, tmp_path, work):
    see(clip, model, tmp_path, every=4)
    assert work["detected"] == 10
    dense = see(clip, model, tmp_path)
    assert work["detected"] == FRAMES
    assert same(dense, see(clip, model, None))


def test_a_run_that_is_cut_short_goes_on(clip, model, tmp_path, work, monkeypatch):
    monkeypatch.setattr(looking, "CHUNK", 8)
    looks = look(open_video(clip), load_detector(model), cache=tmp_path)
    with pytest.raises(KeyboardInterrupt), closing(looks):
        for now in looks:
            if now.index == 20:
                raise KeyboardInterrupt
    assert work["detected"] == 32, "frames are detected sixteen at a time"
    work.update(detected=0, decoded=[])
    rest = see(clip, model, tmp_path)
    assert work["decoded"] == list(range(32, FRAMES)) and work["detected"] == FRAMES - 32
    assert same(rest, see(clip, model, None))


def test_a_run_that_is_killed_keeps_whole_chunks(clip, model, tmp_path, work, monkeypatch):
    monkeypatch.setattr(looking, "CHUNK", 8)
    looks = look(open_video(clip), load_detector(model), cache=tmp_path)
    for _ in range(21):
        next(looks)
    monkeypatch.setattr("vision.detectors.kept.keep_arrays", lambda path, arrays: False)  # what a dead process writes
    looks.close()
    monkeypatch.undo()
    names = [path.name for path in sorted(tmp_path.glob("detections/*/*"))]
    assert names == ["00000000-00000015-16.npz"]
    kept = Kept.of(tmp_path, open_video(clip), load_detector(model))
    assert sorted(kept.found) == list(range(16))
    assert same(see(clip, model, tmp_path), see(clip, model, None))


@pytest.mark.parametrize("burst", [1, 3, 64])
def test_bursts_do_not_show(burst, clip, model, tmp_path, monkeypatch):
    usual = see(clip, model, None)
    monkeypatch.setattr(looking, "BURST", burst)
    see(clip, model, tmp_path, every=3)
    assert same(usual, see(clip, model, tmp_path))


def test_images_of_kept_frames_on_request(clip, model, tmp_path, work):
    see(clip, model, tmp_path, every=2)
    video, detector = open_video(clip), load_detector(model)
    shown = list(look(video, detector, cache=tmp_path, images=True))
    assert all(now.image is not None for now in shown) and work["detected"] == FRAMES
    for now, frame in zip(shown, video.frames(), strict=True):
        assert now.index == frame.index and np.array_equal(now.image, frame.image)


def test_other_options_are_another_look(clip, model, tmp_path, work):
    see(clip, model, tmp_path)
    see(clip, model, tmp_path, classes=["bus"])
    see(clip, model, tmp_path, names=["a", "b", "truck"])
    assert work["detected"] == 3 * FRAMES and len(list(tmp_path.glob("detections/*"))) == 3


def test_nothing_is_found_in_damaged_frames(clip, model, monkeypatch):
    usual, decoded = see(clip, model, None), VideoFile.decoded
    torn = {3, 4, 17}

    def tear(self, wanted):
        return (None if frame.index in torn else frame for frame in decoded(self, wanted))

    monkeypatch.setattr(VideoFile, "decoded", tear)
    looks = see(clip, model, None)
    assert [now.index for now in looks] == list(range(FRAMES))
    assert all(len(now.found) == 0 for now in looks if now.index in torn)
    whole = [[now for now in some if now.index not in torn] for some in (usual, looks)]
    assert same(*whole)


def test_content_counts_not_names(clip, model, tmp_path, work):
    see(clip, model, tmp_path)
    (tmp_path / "elsewhere.mp4").write_bytes(clip.read_bytes())
    (tmp_path / "renamed.onnx").write_bytes(Path(model).read_bytes())
    see(tmp_path / "elsewhere.mp4", tmp_path / "renamed.onnx", tmp_path)
    assert work["detected"] == FRAMES
    other = write_bright_spot_detector(tmp_path / "renamed.onnx", SIZE, level=0.6)
    see(tmp_path / "elsewhere.mp4", other, tmp_path)
    assert work["detected"] == 2 * FRAMES
    see(street(tmp_path / "elsewhere.mp4", shade=230), model, tmp_path)
    assert work["detected"] == 3 * FRAMES


def test_weights_beside_the_model_count(model, clip, tmp_path):
    path = tmp_path / "m.onnx"
    path.write_bytes(Path(model).read_bytes())
    bare = load_detector(path).identity
    (tmp_path / "m.onnx.data").write_bytes(b"weights")
    assert load_detector(path).identity["model"] != bare["model"]


@pytest.mark.parametrize("damage", [b"", b"PK\x03\x04 torn"])
def test_a_damaged_file_is_made_anew(damage, clip, model, tmp_path, work, caplog):
    first = see(clip, model, tmp_path)
    for path in [*tmp_path.glob("detections/*/*.npz"), *tmp_path.glob("timestamps/*.npz")]:
        path.write_bytes(damage)
    assert same(first, see(clip, model, tmp_path))
    assert work["detected"] == 2 * FRAMES and caplog.text.count("is damaged and made anew") == 2
    assert same(first, see(clip, model, tmp_path)) and work["detected"] == 2 * FRAMES


def test_a_folder_that_cannot_be_written_does_not_end_it(clip, model, tmp_path, work, caplog, monkeypatch):
    monkeypatch.setattr(looking, "CHUNK", 8)
    (tmp_path / "file").write_text("in the way")
    assert len(see(clip, model, tmp_path / "file")) == FRAMES
    told = [message for message in caplog.messages if "nothing is kept" in message]
    assert len(told) == 2, "once of the timestamps, once of the detections"


def test_a_detector_of_ones_own_is_not_kept(clip, tmp_path):
    class Blind:
        threshold = 0.5

        def prepare(self, video):
            return self

        def detect(self, image):
            return looking.Detections(np.zeros((0, 4)), np.zeros(0), np.zeros(0, str))

    assert len(list(look(open_video(clip), Blind(), cache=tmp_path))) == FRAMES
    assert not list(tmp_path.iterdir())


def test_frames_without_vehicles_are_known_too(tmp_path, model, work):
    dark = write_video(tmp_path / "dark.mp4", [np.full((SIZE[1], SIZE[0], 3), 40, np.uint8)] * 5)
    for _ in range(2):
        assert [len(now.found) for now in see(dark, model, tmp_path / "cache")] == [0] * 5
    assert work["detected"] == 5


def test_a_video_that_cannot_be_used_leaves_nothing(tmp_path):
    (tmp_path / "junk.mp4").write_bytes(b"not a video at all" * 50)
    with pytest.raises(InputError):
        open_video(tmp_path / "junk.mp4", tmp_path / "cache")
    assert not (tmp_path / "cache").exists()


def test_checksum_follows_the_content(tmp_path):
    path = tmp_path / "a"
    path.write_bytes(b"1")
    first = checksum(path)
    path.write_bytes(b"22")
    assert checksum(path) != first


def test_arrays_are_kept_whole(tmp_path):
    assert keep_arrays(tmp_path / "deep" / "a.npz", {"x": np.arange(3)})
    assert kept_arrays(tmp_path / "deep" / "a.npz")["x"].tolist() == [0, 1, 2]
    assert kept_arrays(tmp_path / "b.npz") is None
    assert [path.name for path in (tmp_path / "deep").iterdir()] == ["a.npz"]


def entry(folder, name, age):
    """A file of a cache that was last used `age` s ago, and its size."""
    path = folder / "detections" / name / "0.npz"
    assert keep_arrays(path, {"x": np.random.default_rng(0).random(500)})
    os.utime(path, (1e9 - age, 1e9 - age))
    return path, path.stat().st_size


def test_what_was_used_longest_ago_goes(tmp_path):
    paths, sizes = zip(*(entry(tmp_path, name, age) for name, age in [("a", 30), ("b", 20), ("c", 10)]), strict=True)
    mine = tmp_path / "notes.npz"
    mine.write_bytes(bytes(10**6))
    assert kept_arrays(paths[0]) is not None, "used again"
    assert prune(tmp_path, sum(sizes)) == 0
    assert prune(tmp_path, sum(sizes) - 1) == sizes[1]
    assert [path.exists() for path in paths] == [True, False, True] and not paths[1].parent.exists()
    assert prune(tmp_path, 0) == sizes[0] + sizes[2] and mine.exists(), "what is not roadfiber's stays"


def test_a_look_keeps_within_the_limit(clip, model, tmp_path, work, monkeypatch):
    see(clip, model, tmp_path)
    (old,) = tmp_path.glob("detections/*/*.npz")
    monkeypatch.setenv("ROADFIBER_CACHE_MB", str(1.5 * old.stat().st_size / 1e6))
    os.utime(old, (1e9, 1e9))
    (stamps,) = tmp_path.glob("timestamps/*.npz")
    os.utime(stamps, (1e9, 1e9))
    see(clip, model, tmp_path, classes=["bus"])
    assert not old.exists() and len(list(tmp_path.glob("detections/*/*.npz"))) == 1
    work.update(detected=0)
    see(clip, model, tmp_path, classes=["bus"])
    assert work["detected"] == 0, "the newest stays"
    monkeypatch.setenv("ROADFIBER_CACHE_MB", "much")
    with pytest.raises(InputError, match="ROADFIBER_CACHE_MB is 'much'; give a number of megabytes"):
        see(clip, model, tmp_path)


@pytest.mark.parametrize(
    ("platform", "settings", "place"),
    [
        ("linux", {"XDG_CACHE_HOME": "/c"}, "/c/roadfiber"),
        ("linux", {}, "/home/ann/.cache/roadfiber"),
        ("darwin", {}, "/home/ann/Library/Caches/roadfiber"),
        ("win32", {"LOCALAPPDATA": "/l"}, "/l/roadfiber"),
        ("linux", {"ROADFIBER_CACHE": "/own"}, "/own"),
    ],
)
def test_cache_folder(platform, settings, place, monkeypatch):
    for name in ("XDG_CACHE_HOME", "LOCALAPPDATA", "ROADFIBER_CACHE"):
        monkeypatch.delenv(name, raising=False)
    for name, value in settings.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(sys, "platform", platform)
    monkeypatch.setattr(Path, "home", lambda: Path("/home/ann"))
    assert cache_folder() == Path(place)
