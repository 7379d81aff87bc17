"""What tracking costs beyond the model's own inference, on one core, and whether that keeps up with the camera.

    python benchmarks/track.py --model yolox_nano.onnx --video street.mp4

Processor time, all in one run: `overhead` is (everything - inference) / inference, where everything is reading the
timestamps, decoding, scaling, the network, its answer's decoding, suppression and tracking; `real time` is how many
times faster than a camera of 25 frames/s; `second look` is its share of the first, with the detections kept.
Ratios are what to quote.
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
    """A session that adds up the processor time of its runs."""

    def __init__(self, session: Any) -> None:
        self.session = session
        self.seconds = 0.0
        self.get_inputs = session.get_inputs

    def run(self, *arguments: Any) -> Any:
        begun = time.process_time()
        answer = self.session.run(*arguments)
        self.seconds += time.process_time() - begun
        return answer


def first_and_second_look(model: str, video: Path, every: int) -> dict[str, float]:
    """Processor seconds of a first and a second look, of inference in the first, and frames."""
    from vision.detectors import load_detector
    from vision.pipeline import box_tracks
    from vision.video import open_video

    detector = load_detector(model)
    session = Timed(detector.session)
    detector = replace(detector, session=session)
    seconds = []
    with tempfile.TemporaryDirectory() as cache:
        for _ in range(2):
            begun = time.process_time()
            _, speed = box_tracks(open_video(video, Path(cache)), detector, every=every, cache=Path(cache))
            seconds.append(time.process_time() - begun)
    return {"frames": speed.frames, "first": seconds[0], "second": seconds[1], "inference": session.seconds}


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
    rows = []
    for _ in range(options.repeat):
        look = first_and_second_look(options.model, options.video, options.every)
        rows.append(
            {
                "overhead": look["first"] / look["inference"] - 1,
                "real time": look["frames"] / look["first"] / CAMERA,
                "second look": look["second"] / look["first"],
                "ms/frame": 1e3 * look["first"] / look["frames"],
                "inference ms": 1e3 * look["inference"] / look["frames"],
            }
        )
    table = pd.DataFrame(rows)
    print(table.round(3).to_string(index=False))
    print("median:", table.median().round(3).to_dict())


if __name__ == "__main__":
    main()
