import numpy as np
import pytest

from tests.vision.videos import numbered_images, set_creation_time, set_frame_durations, write_video
from vision.contract.errors import InputError
from vision.video import open_video


@pytest.fixture
def clip(tmp_path):
    return write_video(tmp_path / "clip.mp4", numbered_images(30), rate=25.0)


def test_constant_rate(clip):
    video = open_video(clip)
    assert (len(video), video.width, video.height) == (30, 64, 48)
    np.testing.assert_allclose(video.time, np.arange(30) / 25, atol=1e-9)
    assert video.frame_interval == pytest.approx(0.04)


def test_frames_come_with_their_own_index_and_time(clip):
    video = open_video(clip)
    for frame in video.frames(every=7):
        assert frame.image.mean() / 4 == pytest.approx(frame.index, abs=1)
        assert frame.time == video.time[frame.index]
    assert [frame.index for frame in video.frames(every=7)] == [0, 7, 14, 21, 28]


def test_sample_spreads_over_the_file(clip):
    assert [frame.index for frame in open_video(clip).sample(4)] == [0, 10, 19, 29]
    assert len(open_video(clip).sample(500)) == 30


def test_variable_rate_is_read_from_the_file(clip):
    base = 12800  # OpenCV's time base for 25 frames/s
    durations = [256, 768] * 15
    set_frame_durations(clip, durations)
    expected = np.concatenate([[0], np.cumsum(durations)[:-1]]) / base
    np.testing.assert_allclose(open_video(clip).time, expected, atol=1e-6)


def test_repeated_timestamps_are_left_out(clip, caplog):
    set_frame_durations(clip, [0 if k == 10 else 512 for k in range(30)])
    video = open_video(clip)
    assert (np.diff(video.time) > 0).all()
    frames = list(video.frames())
    assert len(frames) == len(video) and [f.index for f in frames] == video.index.tolist()


def test_creation_time(clip):
    assert open_video(clip).created is None
    set_creation_time(clip, np.datetime64("2026-03-04T05:06:07"))
    assert open_video(clip).created == np.datetime64("2026-03-04T05:06:07")


def test_missing(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        open_video(tmp_path / "none.mp4")


@pytest.mark.parametrize("content", [b"", b"not a video at all" * 50])
def test_not_a_video(content, tmp_path, capfd):
    (tmp_path / "junk.mp4").write_bytes(content)
    with pytest.raises(InputError, match="not a video"):
        open_video(tmp_path / "junk.mp4")
    assert capfd.readouterr().err == "", "our line is the only one"


def test_no_frames(tmp_path):
    images = numbered_images(1)
    path = write_video(tmp_path / "one.mp4", images)
    data = bytearray(path.read_bytes())
    start = data.find(b"mdat") + 4
    data[start : data.find(b"moov") - 4] = bytes(data.find(b"moov") - 4 - start)
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"no frame decodes|not a video"):
        open_video(path)


def test_cut_short(tmp_path):
    path = write_video(tmp_path / "long.mp4", numbered_images(60), rate=5.0)
    data = bytearray(path.read_bytes())
    # What a recorder that died leaves: the index is there, the pictures are not.
    start, end = data.find(b"mdat") + 4, data.find(b"moov") - 4
    middle = (start + end) // 2
    data[middle:end] = bytes(end - middle)
    path.write_bytes(data)
    with pytest.raises(InputError, match="cut short or damaged"):
        open_video(path)


def test_real_variable_rate(shared_data):
    video = open_video(shared_data / "video" / "cKuhn517_traffic.mp4")
    steps = np.diff(video.time)
    assert len(video) == 734, "of the 754 its header claims"
    assert video.time[0] == pytest.approx(1.860, abs=5e-4), "its first 19 frames need a key frame that is not there"
    assert steps.min() > 0.05 and np.sum(steps > 0.7) == 1 and np.median(steps) == pytest.approx(0.092, abs=5e-4)


def test_real_dropped_frame(shared_data):
    video = open_video(shared_data / "video" / "ahmetozlu_input_video.mp4")
    assert np.sum(np.diff(video.time) > 0.06) == 1
