"""A picture of the street itself, without its traffic, and where the road lies in it."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.camera import Calibration
from vision.contract.errors import InputError
from vision.timestamps import open_capture

#: Frames that the picture is the median of, and s from one to the next: most vehicles have gone by then.
FRAMES, STEP = 9, 2.0
#: px, of the picture at most; and its quality as JPEG.
WIDEST, QUALITY = 1280, 85
#: Bytes of a picture that is read back, and how a JPEG begins.
LARGEST, JPEG = 2**22, b"\xff\xd8\xff"


@dataclass(frozen=True)
class StreetPicture:
    """A picture of a street with its calibration.

    Parameters
    ----------
    jpeg : the picture, which may be smaller than the camera's
    calibration : of the camera
    """

    jpeg: bytes
    calibration: Calibration

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the camera's picture, px, in which pixels are given."""
        return self.calibration.image_size

    @property
    def text(self) -> str:
        """The calibration as JSON."""
        return self.calibration.model_dump_json(exclude_none=True)

    def to_image(self, ground: ArrayLike) -> NDArray[np.float64]:
        """Points of the road [n, 2], m -> places in the picture [n, 2], px; NaN where it does not show them."""
        there = self.calibration.to_image(ground)
        back = self.calibration.to_ground(np.nan_to_num(there))
        # Outside the calibrated view a lens model returns arbitrary pixels.
        seen = np.isfinite(there).all(1) & (np.linalg.norm(back - np.asarray(ground, float), axis=1) < 1.0)
        return np.where(seen[:, None], there, np.nan)

    @classmethod
    def of_video(cls, video: Path | str, calibration: Path | str) -> "StreetPicture":
        """Take the picture out of the beginning of a video: the median of some frames, in which traffic vanishes.

        Raises
        ------
        InputError
            If the video does not decode, or is not of the calibration's size.
        """
        import cv2

        view, path = Calibration.read(calibration), Path(video)
        if path.is_dir():
            raise InputError(f"{path}: a folder of pictures; give a video")
        capture = open_capture(path)
        skip = max(round((capture.get(cv2.CAP_PROP_FPS) or 25.0) * STEP), 1)
        frames = list[NDArray[np.uint8]]()
        while len(frames) < FRAMES and (read := capture.read())[0]:
            frames.append(read[1])
            for _ in range(skip - 1):
                capture.grab()
        if not frames:
            raise InputError(f"{path}: no frame decodes")
        height, width = frames[0].shape[:2]
        view.require_size(width, height, path)
        picture = np.median(np.stack(frames), axis=0).astype(np.uint8)
        if width > WIDEST:
            picture = cv2.resize(picture, (WIDEST, round(height * WIDEST / width)), interpolation=cv2.INTER_AREA)
        return cls(cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes(), view)

    @classmethod
    def read(cls, jpeg: Path, calibration: Path) -> "StreetPicture | None":
        """Read the picture and calibration that a run folder holds; None where it holds none, or they are damaged."""
        if not (jpeg.is_file() and calibration.is_file()) or jpeg.stat().st_size > LARGEST:
            return None
        content = jpeg.read_bytes()
        try:
            return cls(content, Calibration.read(calibration)) if content.startswith(JPEG) else None
        except InputError:
            return None
