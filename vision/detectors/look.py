"""What a detector finds in the frames of a video, one after another."""

from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from vision.detectors.detections import Detections, Detector
from vision.detectors.kept import Kept
from vision.detectors.onnx_detector import OnnxDetector
from vision.video import Video

CHUNK = 250  # frames after which detections are written: some seconds of work


@dataclass(frozen=True)
class Look:
    """One frame.

    Parameters
    ----------
    index : place in the file
    time : s since the file's time zero
    found : what is in it
    image : [height, width, 3] BGR; None where it was not decoded
    decode, detect : s spent on it
    """

    index: int
    time: float
    found: Detections
    image: NDArray[np.uint8] | None
    decode: float
    detect: float


def look(
    video: Video, detector: Detector, every: int = 1, *, cache: Path | None = None, images: bool = False
) -> Generator[Look, None, None]:
    """Go through every `every`-th frame of a video.

    Close the iterator where the loop over it may end early (`contextlib.closing`): what was found until then is kept.

    Parameters
    ----------
    video, detector : what to look at, and with what; it is prepared for the video here
    every : look at every n-th frame
    cache : folder of detections to use and to add to (ONNX detectors only); by default nothing is kept
    images : decode frames whose detections are kept, too

    Raises
    ------
    InputError, where the detector cannot be used on this video, or the video changed meanwhile.
    """
    kept = Kept.of(cache, video, detector) if cache is not None and isinstance(detector, OnnxDetector) else None
    known = kept.found if kept else {}
    places = np.arange(0, len(video), every)
    missing = [place for place in places if int(video.index[place]) not in known]
    ready = detector.prepare(video) if missing else detector
    frames = video.frames_at(places if images else np.array(missing, np.intp))
    fresh: list[tuple[int, Detections]] = []
    try:
        for place in places:
            index, begun = int(video.index[place]), perf_counter()
            image: NDArray[np.uint8] | None
            found = known.get(index)
            if found is None:
                image = next(frames).image
                decoded = perf_counter()
                found = ready.detect(image)
                fresh.append((index, found))
            else:
                image = next(frames).image if images else None
                decoded = perf_counter()
            spent = decoded - begun, perf_counter() - decoded
            yield Look(index, float(video.time[place]), found, image, *spent)
            if kept and len(fresh) >= CHUNK:
                kept.add(fresh)
                fresh = []
    finally:
        if kept:
            kept.add(fresh)
