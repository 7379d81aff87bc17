"""Detections that are kept between runs: a second look costs nothing, and a run that was cut short goes on."""

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from vision.cache import keep_arrays, kept_arrays
from vision.detectors.detections import Detections
from vision.detectors.onnx_detector import OnnxDetector
from vision.video import Video


class Kept:
    """Detections of one video by one model with its options, by the place of the frame in the file.

    They lie in `detections/KEY` of the cache: files of some hundred frames each, every one written whole or not at all
    and never changed. KEY is a checksum of the video's and the model's content and of the options that decide what is
    found. How often one looks, which detections start tracks, and which processor or accelerator the model ran on are
    not among them.

    >>> import tempfile
    >>> kept, found = Kept(Path(tempfile.mkdtemp())), Detections(np.ones((1, 4)), np.array([0.5]), np.array(["car"]))
    >>> kept.add([(7, found)])
    >>> Kept(kept.folder).found[7].label.tolist()
    ['car']
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.found: dict[int, Detections] = {}
        self.writable = True
        for path in sorted(folder.glob("*.npz")):
            self.found.update(_read(path))

    @classmethod
    def of(cls, cache: Path, video: Video, detector: OnnxDetector) -> "Kept":
        """Open what the cache holds of a video and a detector."""
        identity = {"video": video.checksum, **detector.identity}
        key = hashlib.sha256(json.dumps(identity, sort_keys=True).encode()).hexdigest()[:32]
        return cls(cache / "detections" / key)

    def add(self, chunk: Sequence[tuple[int, Detections]]) -> None:
        """Keep detections of frames, given by their place; after a first failure to write, no more."""
        self.found.update(chunk)
        if not chunk or not self.writable:
            return
        count = [len(found) for _, found in chunk]
        arrays = {
            "frame": np.array([frame for frame, _ in chunk], np.int64),
            "count": np.array(count, np.int64),
            "box": np.concatenate([found.box for _, found in chunk]).reshape(-1, 4),
            "score": np.concatenate([found.score for _, found in chunk]),
            "label": np.concatenate([found.label for _, found in chunk]).astype(str),
        }
        name = f"{chunk[0][0]:08d}-{chunk[-1][0]:08d}-{len(chunk)}.npz"
        self.writable = keep_arrays(self.folder / name, arrays)


def _read(path: Path) -> dict[int, Detections]:
    arrays = kept_arrays(path)
    if arrays is None:
        return {}
    ends = np.cumsum(arrays["count"])[:-1]
    parts = (np.split(arrays[name], ends) for name in ("box", "score", "label"))
    return {int(frame): Detections(*part) for frame, *part in zip(arrays["frame"], *parts, strict=True)}
