from pathlib import Path

import numpy as np
import pytest

from tests.vision.videos import numbered_images, set_creation_time, set_frame_durations, write_video
from vision import timestamps
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


@pytest.fixture
def decodings(monkeypatch):
    """Files that were decoded from end to end for their timestamps."""
    done, decode = [], timestamps.decoded_times
    monkeypatch.setattr(timestamps, "decoded_times", lambda path, claimed: done.append(path) or decode(path, claimed))
    return done


def test_packets_tell_the_times_without_decoding(clip, decodings):
    set_frame_durations(clip, [256, 768] * 15)
    time, shape = timestamps.frame_times(clip)
    assert not decodings and shape == (48, 64)
    np.testing.assert_array_equal(time, timestamps.decoded_times(clip, 30))


@pytest.mark.parametrize(
    ("time", "claimed", "credible"),
    [
        ([0.0, 0.16, 0.08, 0.04, 0.12], 5, True),  # as frames predicted both ways are stored
        ([0.0, 0.04, 0.08], 4, False),
        ([0.0, 0.04, 0.04], 3, False),
        ([1.0, *np.arange(0, 1, 0.04)], 26, False),
    ],
)
def test_which_packets_are_believed(time, claimed, credible):
    assert timestamps.plausible(np.array(time), claimed) == credible


def test_packets_that_the_frames_contradict_are_not_believed(clip, decodings, monkeypatch):
    late = timestamps.packet_times(clip) + np.where(np.arange(30) < 25, 0, 0.01)
    monkeypatch.setattr(timestamps, "packet_times", lambda path: late)
    assert timestamps.frame_times(clip)[0][-1] == pytest.approx(29 / 25)
    assert decodings == [clip]


def test_damaged_frames_are_left_out(tmp_path, caplog):
    path = write_video(tmp_path / "damaged.mp4", numbered_images(60))
    data = bytearray(path.read_bytes())
    start, end = data.find(b"mdat") + 4, data.find(b"moov") - 4
    hole = slice(start + 3 * (end - start) // 10, start + 5 * (end - start) // 10)
    data[hole] = bytes(hole.stop - hole.start)
    path.write_bytes(data)
    video = open_video(path)
    frames = list(video.frames())
    assert len(video) == 60 and 45 <= len(frames) < 60 and f"{60 - len(frames)} frames are damaged" in caplog.text
    late = [frame for frame in frames if frame.index >= 40]
    assert len(late) == 20
    for frame in late:
        assert frame.time == video.time[frame.index] == pytest.approx(frame.index / 25)
        assert frame.image.mean() / 4 == pytest.approx(frame.index, abs=1.5)


def test_a_file_that_shrinks_while_it_is_read(clip):
    video = open_video(clip)
    write_video(clip, numbered_images(10))
    with pytest.raises(InputError, match=r"decodes to 0\.4 s of 1\.2 s; it changed while it was read"):
        list(video.frames())


def test_creation_time(clip):
    assert open_video(clip).created is None
    set_creation_time(clip, np.datetime64("2026-03-04T05:06:07"))
    assert open_video(clip).created == np.datetime64("2026-03-04T05:06:07")


def test_missing(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        open_video(tmp_path / "none.mp4")


@pytest.mark.parametrize("stream", ["rtsp://admin:secret@10.0.0.5/live", "https://host/street.m3u8"])
def test_a_stream_is_to_be_recorded_first(stream):
    """`Path` leaves one of the two slashes."""
    for given in (stream, Path(stream)):
        with pytest.raises(InputError, match=r"is a stream, not a file; record it first.*ffmpeg .*-i URL ") as caught:
            open_video(given)
        assert "secret" not in str(caught.value)


def test_a_codec_without_decoder_is_named(clip):
    """AV1 is what the file says; OpenCV's FFmpeg finds no decoder for it."""
    clip.write_bytes(clip.read_bytes().replace(b"mp4v", b"av01").replace(b"esds", b"av1C"))
    with pytest.raises(InputError, match=r"AV1.*no decoder.*ffmpeg -i clip\.mp4 -c:v libx264"):
        open_video(clip)


@pytest.mark.parametrize("content", [b"", b"not a video at all" * 50])
def test_not_a_video(content, tmp_path, capfd):
    (tmp_path / "junk.mp4").write_bytes(content)
    with pytest.raises(InputError, match="not a video"):
        open_video(tmp_path / "junk.mp4")
    assert capfd.readouterr().err == "", "our line is the only one"


def test_a_playlist_is_not_followed(clip):
    playlist = clip.with_name("playlist.mp4")
    playlist.write_text(f"ffconcat version 1.0\nfile {clip.name}\n")
    with pytest.raises(InputError, match="not a video but text"):
        open_video(playlist)


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
