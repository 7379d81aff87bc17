"""What a camera saw of a run's street; who knows cameras makes it."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

#: Files of a run folder that it is kept in.
PICTURE, CALIBRATION = "street.jpg", "calibration.json"


class Scene(Protocol):
    """A picture of the street, and where points of the road lie in it."""

    @property
    def jpeg(self) -> bytes:
        """The picture."""

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, px, that places in it are told in."""

    @property
    def text(self) -> str:
        """Of the calibration, as JSON."""

    def to_image(self, ground: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points of the road [n, 2], m -> places in the picture [n, 2], px; NaN where it does not show them."""
