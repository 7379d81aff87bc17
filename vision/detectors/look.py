"""Run a detector on the frames of a video, one after another."""

from collections.abc import Generator, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from vision.cache import allowed, prune
from vision.detectors.detections import Detections, Detector
from vision.detectors.kept import Kept
from vision.detectors.onnx_detector import OnnxDetector
from vision.frames import Frame, Video

CHUNK = 250  # frames after which detections are written: a few seconds of work
BURST = 16  # frames that are decoded before they are detected, see `OnnxDetector.detect_all`
NOTHING = Detections(np.zeros((0, 4)), np.zeros(0), np.zeros(0, str))


@dataclass(frozen=True)
class Look:
    """One frame.

    Parameters
    ----------
    index : place in the file
    time : s since the file's time zero
    found : the detections in it
    image : [height, width, 3] BGR; None unless images were asked for
    fresh : whether it was detected now, rather than read from the cache
    decode, detect : s spent on it, the mean over its burst; for a cached frame, the times when it was detected
    """

    index: int
    time: float
    found: Detections
    image: NDArray[np.uint8] | None
    fresh: bool
    decode: float
    detect: float


def look(
    video: Video, detector: Detector, every: int = 1, *, cache: Path | None = None, images: bool = False
) -> Generator[Look, None, None]:
    """Go through every `every`-th frame of a video.

    If the loop over the iterator may end early, close it (`contextlib.closing`): detections so far are then cached.

    Parameters
    ----------
    video, detector : what to look at, and with what; it is prepared for the video here
    every : look at every n-th frame
    cache : folder of cached detections to use and extend (ONNX detectors only); by default nothing is cached
    images : also decode frames whose detections are cached

    Raises
    ------
    InputError, if the detector cannot be used on this video, or the video changed meanwhile.
    """
    kept = Kept.of(cache, video, detector) if cache is not None and isinstance(detector, OnnxDetector) else None
    limit = allowed()
    known, before = (kept.found, kept.spent) if kept else ({}, {})
    places = np.arange(0, len(video), every)
    missing = places[[int(index) not in known for index in video.index[places]]]
    ready = detector.prepare(video) if len(missing) else detector
    frames = video.decoded(places if images else missing)
    fresh: list[Look] = []
    try:
        for burst in np.split(places, range(BURST, len(places), BURST)):
            looks = _burst(video, ready, burst, frames, known, images)
            fresh += [replace(now, image=None) for now in looks if now.fresh]
            yield from (now if now.fresh or now.index not in before else _as_before(now, before) for now in looks)
            if kept and len(fresh) >= CHUNK:
                _keep(kept, fresh)
                fresh = []
    finally:
        if kept and cache is not None:
            _keep(kept, fresh)
            prune(cache, limit)


def _keep(kept: Kept, fresh: list[Look]) -> None:
    kept.add([(now.index, now.found) for now in fresh], [(now.decode, now.detect) for now in fresh])


def _as_before(now: Look, before: Mapping[int, tuple[float, float]]) -> Look:
    decode, detect = before[now.index]
    return replace(now, decode=decode, detect=detect)


def _burst(
    video: Video,
    detector: Detector,
    places: NDArray[np.intp],
    frames: Iterator[Frame | None],
    known: Mapping[int, Detections],
    images: bool,
) -> list[Look]:
    """Process some frames, given by their places in the video; those that must be decoded come from `frames`.

    Nothing is found in a damaged frame.
    """
    indices = [int(index) for index in video.index[places]]
    missing = [index for index in indices if index not in known]
    shown: dict[int, NDArray[np.uint8]] = {}
    damaged: list[int] = []
    decoding = 0.0

    def unknown() -> Iterator[NDArray[np.uint8]]:
        nonlocal decoding
        for index in indices if images else missing:
            begun = perf_counter()
            frame = next(frames)
            decoding += perf_counter() - begun
            if frame is None:
                damaged.append(index)
                continue
            if images:
                shown[index] = frame.image
            if index not in known:
                yield frame.image

    begun = perf_counter()
    answers = _detect_all(detector, unknown())
    whole = [index for index in missing if index not in damaged]
    found = dict.fromkeys(missing, NOTHING) | dict(zip(whole, answers, strict=True))
    detecting = perf_counter() - begun - decoding
    return [
        Look(
            index,
            float(video.time[place]),
            found[index] if index in found else known[index],
            shown.get(index),
            index in found,
            decoding / max(len(indices if images else missing), 1),
            detecting / max(len(missing), 1),
        )
        for index, place in zip(indices, places, strict=True)
    ]


def _detect_all(detector: Detector, images: Iterator[NDArray[np.uint8]]) -> list[Detections]:
    if isinstance(detector, OnnxDetector):
        return detector.detect_all(images)
    return [detector.detect(image) for image in images]
