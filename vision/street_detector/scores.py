"""How well boxes agree with the truth."""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.street_detector.model import CLASSES, INPUT
from vision.street_detector.scenes import Pictures, Samples

Floats = NDArray[np.float64]
Detect = Callable[[Pictures, Pictures], Floats]

SMALLEST = 8.0  # px; vehicles with a shorter side do not count


@dataclass(frozen=True)
class Scores:
    """Scores over many frames; vehicles more than half hidden or with a side under 8 px are left out.

    Attributes
    ----------
    vehicles : number of vehicles counted
    ap50 : average precision at IoU 0.5, classes ignored
    ap50_class : mean over the classes of the average precision at IoU 0.5, class right
    recall, precision : at the threshold
    class_accuracy : share of the found vehicles with the right class
    edge_median : median absolute error of a box side, px
    edge_mean, edge_sd : signed error of the sides x1, y1, x2, y2, px
    """

    vehicles: int
    ap50: float
    ap50_class: float
    recall: float
    precision: float
    class_accuracy: float
    edge_median: float
    edge_mean: tuple[float, ...]
    edge_sd: tuple[float, ...]

    def lines(self) -> str:
        """Return one line per score."""
        return "\n".join(f"{name}: {np.round(value, 3).tolist()}" for name, value in asdict(self).items())


def shared_area(a: Floats, b: Floats) -> Floats:
    """Area [n, m] that boxes [n, 4] and [m, 4] share."""
    low = np.maximum(a[:, None, :2], b[None, :, :2])
    high = np.minimum(a[:, None, 2:4], b[None, :, 2:4])
    return np.prod(np.clip(high - low, 0, None), axis=2)


def box_area(boxes: Floats) -> Floats:
    """Area [n] of boxes [n, 4]."""
    return np.prod(boxes[:, 2:4] - boxes[:, :2], axis=1)


def iou(a: Floats, b: Floats) -> Floats:
    """Intersection over union [n, m] of boxes [n, 4] and [m, 4].

    >>> iou(np.array([[0, 0, 2, 2.0]]), np.array([[1, 0, 3, 2.0]])).round(3).tolist()
    [[0.333]]
    """
    shared = shared_area(a, b)
    return shared / np.maximum(box_area(a)[:, None] + box_area(b)[None] - shared, 1e-9)


def covered(a: Floats, b: Floats) -> Floats:
    """Share [n, m] of each box [n, 4] that lies on each box [m, 4]."""
    return shared_area(a, b) / np.maximum(box_area(a)[:, None], 1e-9)


@dataclass(frozen=True)
class Match:
    """One detection and the row of the truth that it matched; `ignored` where that one does not count."""

    score: float
    kind: int
    box: Floats
    truth: Floats | None
    ignored: bool


def matched(detections: Floats, truth: Floats) -> list[Match]:
    """Give every detection [n, 6], best first, the free vehicle [m, 6] that it overlaps most (IoU >= 0.5).

    What is left and lies mostly on a vehicle that does not count, or is itself too small to count, is ignored.
    """
    wanted, others = truth[counts(truth)], truth[~counts(truth)]
    overlaps = iou(detections, wanted)
    on_others = covered(detections, others).max(axis=1, initial=0.0) >= 0.5
    small = np.min(detections[:, 2:4] - detections[:, :2], axis=1) < SMALLEST
    found = []
    for k, detection in enumerate(detections):
        best = int(np.argmax(overlaps[k])) if len(wanted) else -1
        hit = best >= 0 and overlaps[k, best] >= 0.5
        if hit:
            overlaps[:, best] = 0
        ignored = not hit and bool(on_others[k] or small[k])
        partner = wanted[best] if hit else None
        found.append(Match(float(detection[4]), int(detection[5]), detection[:4], partner, ignored))
    return found


def counts(truth: Floats) -> NDArray[np.bool_]:
    """Which vehicles [m, 6] count: at least half visible, no side under 8 px."""
    return (truth[:, 5] >= 0.5) & (np.min(truth[:, 2:4] - truth[:, :2], axis=1, initial=np.inf) >= SMALLEST)


def average_precision(hits: NDArray[np.bool_], scores: Floats, positives: int) -> float:
    """Area under the precision-recall curve with precision made monotonic (Everingham et al. 2010)."""
    order = np.argsort(-scores, kind="stable")
    right = np.cumsum(hits[order])
    recall = right / max(positives, 1)
    precision = right / np.arange(1, len(right) + 1)
    envelope = np.maximum.accumulate(precision[::-1])[::-1]
    return float(np.sum(np.diff(recall, prepend=0.0) * envelope))


def score(detect: Detect, samples: Samples, threshold: float) -> Scores:
    """Score a detector.

    Parameters
    ----------
    detect : frame and background [height, width, 3] BGR -> [n, 6]: x1, y1, x2, y2 (px), score, class index, best first
    samples : frames with truth
    threshold : score from which a detection is reported
    """
    matches: list[Match] = []
    truths: list[Floats] = []
    for k in range(len(samples.frames)):
        truth = samples.boxes[k].astype(float)
        truths.append(truth[counts(truth)])
        matches += [m for m in matched(detect(*samples.picture(k)), truth) if not m.ignored]
    return summary(matches, np.concatenate(truths), threshold)


def summary(matches: list[Match], truth: Floats, threshold: float) -> Scores:
    """Scores of all matches against all counted vehicles [n, 6]."""
    scores = np.array([m.score for m in matches])
    hits = np.array([m.truth is not None for m in matches])
    kinds = np.array([m.kind for m in matches])
    right = np.array([m.truth is not None and int(m.truth[4]) == m.kind for m in matches])
    by_class = [
        average_precision(right[kinds == k], scores[kinds == k], int((truth[:, 4] == k).sum()))
        for k in range(len(CLASSES))
        if (truth[:, 4] == k).any()
    ]
    reported = scores >= threshold
    pairs = [m.box - m.truth[:4] for m in matches if m.truth is not None and m.score >= threshold]
    errors = np.array(pairs).reshape(-1, 4)
    return Scores(
        vehicles=len(truth),
        ap50=average_precision(hits, scores, len(truth)),
        ap50_class=float(np.mean(by_class)),
        recall=float(hits[reported].sum() / max(len(truth), 1)),
        precision=float(hits[reported].mean()),
        class_accuracy=float(right[reported].sum() / max(hits[reported].sum(), 1)),
        edge_median=float(np.median(np.abs(errors))),
        edge_mean=tuple(errors.mean(0)),
        edge_sd=tuple(errors.std(0)),
    )


def onnx_detector(model: str | Path | bytes, floor: float = 0.02) -> Detect:
    """Detector of an ONNX file of this package; pictures up to 640 x 384 px are padded, not scaled.

    >>> detect = onnx_detector(Path(__file__).with_name("street.onnx"))
    >>> night = np.zeros((360, 640, 3), np.uint8)
    >>> bool((detect(night, night)[:, 4] < 0.4).all())
    True
    """
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    session = onnxruntime.InferenceSession(
        model if isinstance(model, bytes) else str(model), options, providers=["CPUExecutionProvider"]
    )

    def detect(frame: Pictures, background: Pictures) -> Floats:
        inputs = {"frame": padded(frame), "background": padded(background)}
        rows = np.asarray(session.run(None, inputs)[0][0], float)
        return rows[rows[:, 4] >= floor]

    return detect


def padded(picture: Pictures) -> NDArray[np.float32]:
    """Picture [height, width, 3] BGR -> network input [1, 3, row, column] RGB 0-1, gray below and to the right."""
    height, width = picture.shape[:2]
    whole = cv2.copyMakeBorder(
        picture, 0, INPUT[0] - height, 0, INPUT[1] - width, cv2.BORDER_CONSTANT, value=(114, 114, 114)
    )
    return np.ascontiguousarray(whole[None, ..., ::-1].transpose(0, 3, 1, 2), np.float32) / np.float32(255)
