"""Training batches: random crops under random light."""

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from vision.street_detector.loss import Targets, make_targets
from vision.street_detector.model import STRIDE
from vision.street_detector.scenes import Pictures, Samples

CROP = (256, 384)  # rows, columns
PAD = 114  # gray beside a letterboxed picture

Floats = NDArray[np.floating]


def batch(samples: Samples, size: int, rng: np.random.Generator) -> tuple[Tensor, Tensor, Targets]:
    """Draw a batch: frames and backgrounds [size, 3, row, column] RGB 0-1, and targets."""
    crops = [crop(samples, int(rng.integers(len(samples.frames))), rng) for _ in range(size)]
    frames, backgrounds, truths = zip(*crops, strict=True)
    targets = make_targets(list(truths), CROP[0] // STRIDE, CROP[1] // STRIDE)
    return planes(np.stack(frames)), planes(np.stack(backgrounds)), targets


def planes(pictures: Floats) -> Tensor:
    """Pictures [n, row, column, 3] BGR 0-1 -> [n, 3, row, column] RGB."""
    return torch.from_numpy(np.ascontiguousarray(pictures[..., ::-1].transpose(0, 3, 1, 2)))


def crop(samples: Samples, k: int, rng: np.random.Generator) -> tuple[Pictures, Pictures, Floats]:
    """Frame, background [row, column, 3] and boxes [n, 6] of a random window of sample `k`, zoomed and flipped."""
    frame, background = samples.picture(k)
    move = window(frame, samples.boxes[k], rng)
    frame, background = (
        cv2.warpAffine(p, move, CROP[::-1], flags=cv2.INTER_LINEAR, borderValue=(PAD,) * 3) for p in (frame, background)
    )
    truth = moved(samples.boxes[k], move)
    return *relit(frame, background, rng), truth


def window(frame: Pictures, boxes: Floats, rng: np.random.Generator) -> Floats:
    """Affine map [2, 3] from the frame to a crop, mostly about a vehicle."""
    zoom = float(np.exp(rng.uniform(np.log(0.7), np.log(1.4))))
    height, width = frame.shape[:2]
    middle = np.array([rng.uniform(0, width), rng.uniform(0, height)])
    if len(boxes) and rng.uniform() < 0.75:
        box = boxes[rng.choice(len(boxes), p=interest(boxes))]
        middle = (box[:2] + box[2:4]) / 2 + rng.uniform(-100, 100, 2) / zoom
    half = np.array(CROP[::-1]) / 2
    low, high = half / zoom - 16, (width, height) - half / zoom + 16
    middle = np.clip(middle, np.minimum(low, high), np.maximum(low, high))
    flip = rng.choice([-1.0, 1.0])
    # cv2 counts pixel centers from 0, boxes count edges: shift by half a pixel on both sides
    scale = np.diag([flip * zoom, zoom])
    offset = half - scale @ middle
    return np.column_stack([scale, offset + scale @ [0.5, 0.5] - 0.5]).astype(np.float32)


def interest(boxes: Floats) -> Floats:
    """How often a crop should be about each vehicle [n]: large and visible ones more, summing to 1."""
    side = np.sqrt(np.prod(boxes[:, 2:4] - boxes[:, :2], axis=1)).astype(float)
    weight = np.sqrt(side) * (boxes[:, 5] > 0.3) + 0.01
    return weight / weight.sum()


def moved(boxes: Floats, move: Floats) -> Floats:
    """Boxes [n, 6] through the affine map of the pictures, cut at the crop; what is cut off counts as not visible."""
    scale = move[:, :2]
    offset = move[:, 2] - scale @ np.full(2, 0.5) + 0.5
    corners = boxes[:, :4].reshape(-1, 2, 2) * np.diag(scale) + offset
    low, high = corners.min(1), corners.max(1)
    limit = np.array(CROP[::-1], float)
    inside_low, inside_high = np.clip(low, 0, limit), np.clip(high, 0, limit)
    share = np.prod(inside_high - inside_low, axis=1) / np.maximum(np.prod(high - low, axis=1), 1e-6)
    kept = share > 0
    whole = np.column_stack([inside_low, inside_high, boxes[:, 4], boxes[:, 5] * share])
    return whole[kept].astype(np.float32)


def relit(frame: Pictures, background: Pictures, rng: np.random.Generator) -> tuple[Pictures, Pictures]:
    """Change exposure and tint of both, and those of the background (and a wide soft shadow) beside the frame's."""
    common = np.exp(rng.normal(0, 0.15) + rng.normal(0, 0.04, 3))
    other = common * np.exp(rng.normal(0, 0.10) + rng.normal(0, 0.02, 3)) if rng.uniform() < 0.8 else common
    gamma = np.exp(rng.normal(0, 0.15))
    a, b = toned(frame, common, gamma), toned(background, other, gamma)
    if rng.uniform() < 0.3:
        shadow = np.exp(rng.normal(0, 0.12, (4, 5))).astype(np.float32)
        b = b * cv2.resize(shadow, CROP[::-1], interpolation=cv2.INTER_CUBIC)[..., None]
    if rng.uniform() < 0.4:
        a = a + np.float32(rng.uniform(0, 0.03)) * rng.standard_normal(a.shape, np.float32)
    return np.clip(a, 0, 1), np.clip(b, 0, 1)


def toned(picture: Pictures, gain: Floats, gamma: float) -> Pictures:
    """Picture [row, column, 3], 0-255 -> float32 0-1 with a gain per channel and a gamma."""
    levels = np.clip(np.arange(256)[:, None] / 255 * gain, 0, 1) ** gamma
    return cv2.LUT(picture, levels[None].astype(np.float32))
