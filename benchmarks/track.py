"""What tracking costs beyond the model's own inference, on one core, and whether that keeps up with the camera.

    python benchmarks/track.py --model yolox_nano.onnx --video street.mp4

All in one run, on one core. `detector` is what detecting takes beyond inference, as a share of inference: scaling, the
tensor, reading the network's answer, suppression. `everything` adds to that the video (its timestamps are read first,
which decodes it once more) and tracking. `real time`: times faster than a camera of 25 frames/s. `second look`: its
share of the first, with the detections kept. Ratios are what to quote.
"""

import argparse
import os
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

CAMERA = 25.0  # frames/s


class Timed:
    """A session that adds up the time of its runs, by the clock and by the processor."""

    def __init__(self, session: Any) -> None:
        self.session = session
        self.clock = self.processor = 0.0
        self.get_inputs = session.get_inputs

    def run(self, *arguments: Any) -> Any:
        clock, processor = time.perf_counter(), time.process_time()
        answer = self.session.run(*arguments)
        self.clock += time.perf_counter() - clock
        self.processor += time.process_time() - processor
        return answer


def ratios(model: str, video: Path, every: int) -> dict[str, float]:
    """What a first and a second look take."""
    from vision.detectors import load_detector
    from vision.pipeline import box_tracks
    from vision.video import open_video

    detector = load_detector(model)
    session = Timed(detector.session)
    detector = replace(detector, session=session)
    looks = []
    with tempfile.TemporaryDirectory() as cache:
        for _ in range(2):
            begun = time.process_time()
            _, speed = box_tracks(open_video(video, Path(cache)), detector, every=every, cache=Path(cache))
            looks.append((time.process_time() - begun, speed))
    (first, speed), (second, _) = looks
    return {
        "detector": speed.detect / session.clock - 1,
        "everything": first / session.processor - 1,
        "real time": speed.frames / first / CAMERA,
        "second look": second / first,
        "inference ms": 1e3 * session.processor / speed.frames,
        "all ms": 1e3 * first / speed.frames,
    }


def main() -> None:
    """Run it some times and print the ratios of each and their medians."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", default="street", help=".onnx file, or street")
    parser.add_argument("--video", type=Path, required=True)
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--repeat", type=int, default=3)
    options = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):  # before any library counts the cores
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})

    import cv2
    import pandas as pd

    cv2.setNumThreads(1)
    table = pd.DataFrame([ratios(options.model, options.video, options.every) for _ in range(options.repeat)])
    print(table.round(3).to_string(index=False))
    print("median:", table.median().round(3).to_dict())


if __name__ == "__main__":
    main()
