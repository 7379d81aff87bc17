"""What tracking costs beyond the model's own inference, on one core, and whether that keeps up with the camera.

    python benchmarks/track.py --model yolox_nano.onnx --video street.mp4

All in one run, on one core. `detector` is what detecting takes beyond inference, as a share of inference: scaling, the
tensor, reading the network's answer, suppression. `everything` adds to that the video, timestamps included, tracking,
filling gaps, ground positions and writing the table. `ground` is the share of the last two. `real time`: times faster
than a camera of 25 frames/s. `second look`: its share of the first, with the detections kept. Ratios are what to quote.

Without `--calibration` the camera is taken to hang 8 m above the road, 20 degrees down: what positions cost does not
depend on whether they are true.
"""

import argparse
import os
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

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


def usual_view(width: int, height: int) -> Any:
    """Calibration of a camera 8 m above the road, 60 degrees wide."""
    from vision.camera import Calibration
    from vision.scene import Camera

    camera = Camera((0.0, 0.0, -8.0), 0.0, 20.0, 0.87 * width, (width, height))
    return Calibration(image_size=camera.size, homography=camera.ground_homography())


def ratios(model: str, video: Path, every: int, calibration: Path | None) -> dict[str, float]:
    """What a first and a second look take."""
    from vision.camera import Calibration
    from vision.contract.table import write_trajectories
    from vision.detectors import load_detector
    from vision.pipeline import box_tracks, on_road
    from vision.video import open_video

    detector = load_detector(model)
    session = Timed(detector.session)
    detector = replace(detector, session=session)
    looks = []
    with tempfile.TemporaryDirectory() as cache:
        for _ in range(2):
            begun = time.process_time()
            clip = open_video(video, Path(cache))
            boxes, speed, far = box_tracks(clip, detector, every=every, cache=Path(cache))
            tracked = time.process_time()
            view = Calibration.read(calibration) if calibration else usual_view(clip.width, clip.height)
            table, _ = on_road(boxes, view, np.datetime64("2025-08-11T06:00:00"), 0.0, video, far)
            write_trajectories(table, Path(cache) / "trajectories.csv")
            looks.append((time.process_time() - begun, time.process_time() - tracked, speed))
    (first, ground, speed), (second, _, _) = looks
    return {
        "detector": speed.detect / session.clock - 1,
        "everything": first / session.processor - 1,
        "ground": ground / session.processor,
        "real time": speed.frames / first / CAMERA,
        "second look": second / first,
        "inference ms": 1e3 * session.processor / speed.frames,
        "all ms": 1e3 * first / speed.frames,
    }


def main() -> None:
    """Run it some times and print the ratios of each and their medians."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", default="nanodet", help=".onnx file, nanodet or street")
    parser.add_argument("--video", type=Path, required=True)
    parser.add_argument("--calibration", type=Path)
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--repeat", type=int, default=3)
    options = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):  # before any library counts the cores
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})

    import cv2
    import pandas as pd

    cv2.setNumThreads(1)
    table = pd.DataFrame(
        [ratios(options.model, options.video, options.every, options.calibration) for _ in range(options.repeat)]
    )
    print(table.round(3).to_string(index=False))
    print("median:", table.median().round(3).to_dict())


if __name__ == "__main__":
    main()
