"""How well a detector serves to follow the vehicles of a real clip whose truth was labeled by hand.

    python benchmarks/detector.py --labels benchmarks/labels/intel_car-detection.csv \
        --video car-detection.mp4 --model nanodet --model street

Labels are boxes in key frames, straight lines between them: `track_id, counted, frame` and the box, px. Counted are
vehicles that move. What is not counted (parked vehicles, a side street behind trees) is neither asked for nor punished,
and so are boxes with a side under 20 px. MOTA, IDF1, precision and recall are those of the tracks that `track` gives.

The labels here were drawn by eye on two public clips: `car-detection` of intel-iot-devkit/sample-videos (CC-BY-4.0,
straight from above) and `traffic` of cKuhn517 (MIT, a steep view of a street with parked cars).
"""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import pandas as pd

BOX = ["box_left", "box_top", "box_right", "box_bottom"]
SMALL = 20.0  # px, shortest side that counts
OWN = 0.5  # share of a box that lies on one that does not count, from which it is taken for that one's


def every_frame(labels: "pd.DataFrame") -> "pd.DataFrame":
    """Labels in key frames -> in all frames between."""
    import pandas as pd

    tracks = []
    for name, keys in labels.sort_values("frame").groupby("track_id"):
        frame = np.arange(keys["frame"].iloc[0], keys["frame"].iloc[-1] + 1)
        boxes = {edge: np.interp(frame, keys["frame"], keys[edge]) for edge in BOX}
        tracks.append(pd.DataFrame({"frame": frame, "track_id": name, "counted": keys["counted"].iloc[0], **boxes}))
    return pd.concat(tracks, ignore_index=True)


def short(boxes: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which boxes [n, 4] have a side under `SMALL`."""
    return np.asarray((boxes[:, 2:] - boxes[:, :2]).min(axis=1) < SMALL)


def punished(found: "pd.DataFrame", counted: "pd.DataFrame", others: "pd.DataFrame") -> "pd.DataFrame":
    """Leave out the boxes found that fit nothing counted and are small, or lie on what does not count."""
    from vision.boxes import overlap
    from vision.street_detector.scores import covered

    kept = np.zeros(len(found), bool)
    for frame, rows in found.groupby("frame").indices.items():
        boxes = found[BOX].to_numpy(float)[rows]
        truth, beside = (t.loc[t["frame"] == frame, BOX].to_numpy(float) for t in (counted, others))
        fits = overlap(boxes, truth).max(axis=1, initial=0.0) >= 0.5
        kept[rows] = fits | ~(short(boxes) | (covered(boxes, beside).max(axis=1, initial=0.0) >= OWN))
    return found[kept]


def scored(model: str, video: Path, labels: Path) -> str:
    """Follow the vehicles of the video and say how well, in a line."""
    import pandas as pd

    from vision.contract import InputError
    from vision.detectors import load_detector
    from vision.pipeline import box_tracks
    from vision.quality.scores import score_tracks
    from vision.video import open_video

    truth = every_frame(pd.read_csv(labels, dtype={"track_id": str}))
    wanted = (truth["counted"] == 1) & ~short(truth[BOX].to_numpy(float))
    try:
        found, *_ = box_tracks(open_video(video), load_detector(model))
    except InputError as error:
        return f"{model}: {error}"
    scores = score_tracks(truth[wanted], punished(found, truth[wanted], truth[~wanted]))
    right = scores.boxes - scores.misses
    return (
        f"{model}: MOTA {scores.mota:.2f}, IDF1 {scores.idf1:.2f}, precision "
        f"{right / max(right + scores.false_alarms, 1):.2f}, recall {right / scores.boxes:.2f} ({scores.boxes} boxes)"
    )


def main() -> None:
    """Print a line for each detector."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--labels", type=Path, required=True)
    parser.add_argument("--video", type=Path, required=True)
    parser.add_argument("--model", action="append", help=".onnx file, nanodet or street; may be given more than once")
    chosen = parser.parse_args()
    for model in chosen.model or ["nanodet"]:
        print(scored(model, chosen.video, chosen.labels))


if __name__ == "__main__":
    main()
