"""Detections cached between runs: a second run costs nothing, and an interrupted run continues."""

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from vision.cache import keep_arrays, kept_arrays
from vision.detectors.detections import Detections
from vision.detectors.onnx_detector import OnnxDetector
from vision.frames import Video


class Kept:
    """Detections of one video by one model with its options, by the place of the frame in the file.

    They lie in `detections/KEY` of the cache: files of some hundred frames each, every one written whole or not at all
    and never changed. KEY is a checksum of the video's and the model's content and of the options that decide what is
    found. The frame step, the score that starts tracks, and the processor or accelerator are not among these options.

    >>> import tempfile
    >>> kept, found = Kept(Path(tempfile.mkdtemp())), Detections(np.ones((1, 4)), np.array([0.5]), np.array(["car"]))
    >>> kept.add([(7, found)], [(0.001, 0.02)])
    >>> again = Kept(kept.folder)
    >>> again.found[7].label.tolist(), again.spent[7]
    (['car'], (0.001, 0.02))
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.found: dict[int, Detections] = {}
        self.spent: dict[int, tuple[float, float]] = {}
        self.writable = True
        for path in sorted(folder.glob("*.npz")):
            found, spent = _read(path)
            self.found.update(found)
            self.spent.update(spent)

    @classmethod
    def of(cls, cache: Path, video: Video, detector: OnnxDetector) -> "Kept":
        """Open what the cache holds of a video and a detector."""
        identity = {"video": video.checksum, **detector.identity}
        key = hashlib.sha256(json.dumps(identity, sort_keys=True).encode()).hexdigest()[:32]
        return cls(cache / "detections" / key)

    def add(self, chunk: Sequence[tuple[int, Detections]], spent: Sequence[tuple[float, float]]) -> None:
        """Keep detections of frames, given by their place, and the s that decoding and detecting each took.

        After a first failure to write, nothing more is cached.
        """
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
            "spent": np.array(spent, float).reshape(-1, 2),
        }
        name = f"{chunk[0][0]:08d}-{chunk[-1][0]:08d}-{len(chunk)}.npz"
        self.writable = keep_arrays(self.folder / name, arrays)


def _read(path: Path) -> tuple[dict[int, Detections], dict[int, tuple[float, float]]]:
    arrays = kept_arrays(path)
    if arrays is None:
        return {}, {}
    ends, frames = np.cumsum(arrays["count"])[:-1], arrays["frame"].tolist()
    parts = (np.split(arrays[name], ends) for name in ("box", "score", "label"))
    found = {frame: Detections(*part) for frame, *part in zip(frames, *parts, strict=True)}
    return found, {
        frame: (decode, detect) for frame, (decode, detect) in zip(frames, arrays["spent"].tolist(), strict=True)
    }
