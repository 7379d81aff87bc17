"""Times of a video's frames: from its packets if they are reliable, else from decoding all frames."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vision.contract.errors import InputError
from vision.contract.progress import progress

Array = NDArray[np.float64]

HEAD = 8  # frames decoded at the start, and
TAIL = 0.5  # s at the end, that must come when the packets say
MOST_MOVED = 16  # places that a packet may be stored away from where its frame is shown (frames predicted both ways)
SAME = 5e-4  # s


def frame_times(path: Path) -> tuple[Array, tuple[int, int]]:
    """Read the time of every frame that decodes, s since the file's time zero, in decoding order.

    Packets are read without decoding them, which costs a fiftieth. They are used if none is missing, their times are
    all different and about in order, and the first and last frames that decode have these times. Otherwise the whole
    file is decoded. A frame may then still prove to be damaged: `Video.decoded` says so.

    Returns
    -------
    time [frame], s; and (height, width) of the decoded images, px

    Raises
    ------
    InputError, where the file is not a video.
    """
    import cv2

    capture = open_capture(path)
    claimed = int(max(capture.get(cv2.CAP_PROP_FRAME_COUNT), 0))
    if not capture.grab():
        return np.zeros(0), (0, 0)
    first, shape = clock(capture), capture.retrieve()[1].shape[:2]
    head, time = np.append(first, next_times(capture, HEAD - 1)), packet_times(path)
    if plausible(time, claimed) and agree(np.sort(time), head, capture):
        return np.sort(time), shape
    return decoded_times(path, claimed), shape


def open_capture(path: Path, packets: bool = False) -> Any:
    """Open a video for decoding, or for its packets; InputError where FFmpeg cannot read it."""
    import cv2

    with path.open("rb") as stream:
        start = stream.read(64)
    # FFmpeg follows playlists to the files that they name, whatever their own name says.
    if start and b"\0" not in start and start.isascii() and not start.startswith(b"YUV4MPEG2"):
        raise InputError(f"{path}: not a video but text; give the video itself")
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_ERROR)  # roadfiber itself reports a refused file
    capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG, [cv2.CAP_PROP_FORMAT, -1] if packets else [])
    if not capture.isOpened():
        raise InputError(f"{path}: not a video, or damaged; give a file that FFmpeg reads (mp4, mkv, avi, ...)")
    return capture


def codec_of(capture: Any) -> str:
    """Four characters that name the codec, as FFmpeg maps them."""
    import cv2

    return int(capture.get(cv2.CAP_PROP_FOURCC)).to_bytes(4, "little").decode("latin-1")


def clock(capture: Any) -> float:
    """Time of what was grabbed last, s since the file's time zero."""
    import cv2

    return float(capture.get(cv2.CAP_PROP_POS_MSEC)) / 1e3


def packet_times(path: Path) -> Array:
    """Times [packet], s, in the order in which the file stores them."""
    capture, times = open_capture(path, packets=True), list[float]()
    while capture.grab():
        times.append(clock(capture))
    return np.array(times, float)


def plausible(time: Array, claimed: int) -> bool:
    """Whether times of packets can be those of frames: as many as claimed, all different, and about in order.

    >>> plausible(np.array([0.0, 0.12, 0.04, 0.08]), 4), plausible(np.array([0.0, 0.0, 0.0]), 3)
    (True, False)
    """
    shown = np.argsort(np.argsort(time, kind="stable"), kind="stable")
    different = len(time) > 1 and bool((np.diff(np.sort(time)) > SAME).all())
    return different and len(time) == claimed and int(np.abs(shown - np.arange(len(time))).max()) <= MOST_MOVED


def agree(time: Array, head: Array, capture: Any) -> bool:
    """Whether the frames that decode at the start, `head`, and at the end come at these times [frame], s."""
    import cv2

    if not near(head, time[:HEAD]):
        return False
    capture.set(cv2.CAP_PROP_POS_MSEC, 1e3 * max(float(time[-1]) - TAIL, 0.0))
    tail = next_times(capture, len(time))
    return len(tail) > 0 and near(tail, time[-len(tail) :])


def next_times(capture: Any, count: int) -> Array:
    """Times of up to `count` frames that decode next, s."""
    times = list[float]()
    while len(times) < count and capture.grab():
        times.append(clock(capture))
    return np.array(times, float)


def near(a: Array, b: Array) -> bool:
    """Whether two rows of times are the same."""
    return len(a) == len(b) and bool((np.abs(a - b) < SAME).all())


def decoded_times(path: Path, claimed: int) -> Array:
    """Times [frame], s, of all frames, by decoding them."""
    capture, times = open_capture(path), list[float]()
    with progress("reading timestamps", claimed or None) as advance:
        while capture.grab():
            times.append(clock(capture))
            advance(1)
    return np.array(times, float)
