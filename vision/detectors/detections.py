"""Detectors and their detections."""

from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from vision.frames import Video


@dataclass(frozen=True)
class Detections:
    """Vehicles in one image.

    Parameters
    ----------
    box : [n, 4] left, top, right, bottom, px of the image; may reach past its border
    score : [n], 0 to 1
    label : [n], class names such as "car"
    """

    box: NDArray[np.float64]
    score: NDArray[np.float64]
    label: NDArray[np.str_]

    def __len__(self) -> int:
        return len(self.score)

    def select(self, keep: NDArray[np.bool_]) -> "Detections":
        """Return those where `keep` [n] is true."""
        return Detections(self.box[keep], self.score[keep], self.label[keep])


class Detector(Protocol):
    """Finds vehicles in images."""

    @property
    def threshold(self) -> float:
        """Score above which a single detection is credible."""

    def prepare(self, video: Video) -> Self:
        """Return a detector prepared for the video (with a background, say)."""

    def detect(self, image: NDArray[np.uint8]) -> Detections:
        """Find the vehicles in an image [height, width, 3], BGR."""
