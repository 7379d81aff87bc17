"""Appearance of vehicles as vectors of an ONNX embedding, to recognize a vehicle after it was hidden."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.contract.errors import InputError
from vision.detectors.session import open_session, run

Array = NDArray[np.float64]

# Of ImageNet, red, green, blue, with which networks for re-identification are trained.
MEAN, DEVIATION = np.array([0.485, 0.456, 0.406]), np.array([0.229, 0.224, 0.225])
USUAL = (256, 128)  # height and width, px, if the model leaves them free
SMALLEST = 4.0  # px; a box with less inside the image has no appearance vector


@dataclass(frozen=True)
class Appearance:
    """An embedding: image [1, 3, height, width] (red, green, blue; normalized as ImageNet's) -> [1, d].

    Parameters
    ----------
    session : onnxruntime session
    name : of its input
    size : (height, width), px
    whole_batches : whether it takes several images at a time
    """

    session: Any
    name: str
    size: tuple[int, int]
    whole_batches: bool

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Open an embedding.

        Raises
        ------
        InputError
            If the file is missing, cannot be run, or does not turn an image [1, 3, h, w] into one vector [1, d].
        """
        path = Path(path)
        if not path.exists():
            raise InputError(f"{path}: no such file; give an ONNX embedding, image [1, 3, h, w] -> [1, d]")
        session = open_session(path)
        inputs = session.get_inputs()
        shape = inputs[0].shape
        if len(inputs) != 1 or len(shape) != 4 or inputs[0].type != "tensor(float)" or shape[1] not in (3, "c", None):
            raise InputError(f"{path}: takes {shape}, not one image [1, 3, h, w] of floats; give an embedding")
        height, width = (side if isinstance(side, int) else usual for side, usual in zip(shape[2:], USUAL, strict=True))
        found = cls(session, inputs[0].name, (height, width), not isinstance(shape[0], int))
        vectors = found.run(np.zeros((1, 3, height, width), np.float32))
        if vectors.ndim != 2 or len(vectors) != 1:
            raise InputError(f"{path}: answers {list(vectors.shape)}, not one vector [1, d]; give an embedding")
        return found

    def run(self, images: NDArray[np.float32]) -> Array:
        """Images [n, 3, height, width] -> outputs of the graph, one row each."""
        batches = [images] if self.whole_batches else np.split(images, len(images))
        return np.concatenate([run(self.session, {self.name: part})[0] for part in batches]).astype(float)

    def embed(self, image: NDArray[np.uint8], boxes: Array) -> Array:
        """Appearance vectors [n, d], of length 1, of the boxes [n, 4], px, in an image [height, width, 3], BGR.

        A vector is zero (unknown) if less than four pixels of a side of its box are inside the image.
        """
        corners = np.clip(boxes, 0, np.tile(image.shape[1::-1], 2)).round().astype(int)
        seen = (corners[:, 2:] - corners[:, :2]).min(axis=1) >= SMALLEST if len(boxes) else np.zeros(0, bool)
        crops = [self._crop(image, corner) for corner in corners[seen]]
        if not crops:
            return np.zeros((len(boxes), 0))
        vectors = self.run(np.stack(crops))
        result = np.zeros((len(boxes), vectors.shape[1]))
        result[seen] = vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)
        return result

    def _crop(self, image: NDArray[np.uint8], corner: NDArray[np.intp]) -> NDArray[np.float32]:
        left, top, right, bottom = corner
        crop = cv2.resize(image[top:bottom, left:right], self.size[::-1], interpolation=cv2.INTER_LINEAR)
        return np.asarray(((crop[..., ::-1] / 255 - MEAN) / DEVIATION).transpose(2, 0, 1), np.float32)
