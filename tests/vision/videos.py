"""Small videos the tests make themselves."""

import struct
from pathlib import Path

import cv2
import numpy as np


def write_video(path: Path, images, rate: float = 25.0) -> Path:
    height, width = images[0].shape[:2]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), rate, (width, height))
    assert writer.isOpened()
    for image in images:
        writer.write(image)
    writer.release()
    return path


def numbered_images(count: int, size=(64, 48)):
    """Images whose mean brightness is their number times four."""
    return [np.full((size[1], size[0], 3), 4 * number, np.uint8) for number in range(count)]


def set_frame_durations(path: Path, ticks: list[int]) -> None:
    """Make the frame rate variable: every frame's duration (stts box), in ticks of the track's time base."""
    data = path.read_bytes()
    assert data.find(b"mdat") < data.find(b"moov"), "chunk offsets would move"
    at = data.find(b"stts") - 4
    size = struct.unpack(">I", data[at : at + 4])[0]
    entries = b"".join(struct.pack(">II", 1, tick) for tick in ticks)
    box = struct.pack(">I4sII", 16 + len(entries), b"stts", 0, len(ticks)) + entries
    grown = bytearray(data[:at] + box + data[at + size :])
    for parent in (b"moov", b"trak", b"mdia", b"minf", b"stbl"):
        head = grown.find(parent) - 4
        old = struct.unpack(">I", grown[head : head + 4])[0]
        grown[head : head + 4] = struct.pack(">I", old + len(box) - size)
    path.write_bytes(grown)


def set_creation_time(path: Path, when: np.datetime64) -> None:
    data = bytearray(path.read_bytes())
    at = data.find(b"mvhd") + 8
    seconds = int((when - np.datetime64("1904-01-01")) / np.timedelta64(1, "s"))
    data[at : at + 4] = struct.pack(">I", seconds)
    path.write_bytes(data)
