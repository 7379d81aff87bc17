"""The common interface of videos and picture folders: frames, each with the time it was taken."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Frame:
    """A decoded frame: its place in the file, s since the file's time zero, image [height, width, 3] BGR."""

    index: int
    time: float
    image: NDArray[np.uint8]


@dataclass(frozen=True)
class Video(ABC):
    """Frames whose number and times were measured, not taken from a header.

    Parameters
    ----------
    path : the file, or the folder of pictures
    width, height : of the decoded images (after the rotation the file asks for), px
    index : [frame], place of every usable frame in decoding order
    time : [frame], s since the video's time zero, strictly increasing
    created : UTC of time zero as the file says it, or None
    """

    path: Path
    width: int
    height: int
    index: NDArray[np.int64]
    time: NDArray[np.float64]
    created: np.datetime64 | None = None

    def __len__(self) -> int:
        return len(self.time)

    @property
    def frame_interval(self) -> float:
        """Median time between frames, s."""
        return float(np.median(np.diff(self.time))) if len(self) > 1 else 0.0

    def header_line(self, start: np.datetime64) -> str:
        """How the time in the header differs from the `start` that is taken; empty where it does not.

        Headers keep whole seconds. Cameras differ in whether they write when the recording began or when it ended.
        """
        if self.created is None:
            return ""
        told = np.datetime_as_string(self.created, unit="s")
        late = float((self.created - start) / np.timedelta64(1, "s"))
        if abs(late) <= 1.0:
            return ""
        if abs(late - float(self.time[-1])) <= 1.0:
            return f"its header says {told}Z, when it ends by the start that is taken: some cameras write that"
        return f"its header says {told}Z, {late:+.0f} s from the start that is taken"

    @property
    @abstractmethod
    def checksum(self) -> str:
        """SHA-256 of the source."""

    @abstractmethod
    def decoded(self, wanted: NDArray[np.intp]) -> Iterator[Frame | None]:
        """Decode the frame at each of these places of `index` and `time`, which increase; None for a damaged one.

        Raises InputError, where the video changed since it was opened.
        """

    def frames(self, every: int = 1) -> Iterator[Frame]:
        """Decode every `every`-th frame."""
        yield from self.frames_at(np.arange(0, len(self), every))

    def sample(self, count: int) -> list[Frame]:
        """Decode `count` frames, or all there are, spread evenly over the video."""
        return list(self.frames_at(np.unique(np.linspace(0, len(self) - 1, count).round().astype(int))))

    def frames_at(self, wanted: NDArray[np.intp]) -> Iterator[Frame]:
        """Decode the frames at these places of `index` and `time`, which increase; damaged ones are left out."""
        return (frame for frame in self.decoded(wanted) if frame is not None)
