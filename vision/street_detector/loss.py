"""Targets on the grid and the loss."""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from vision.street_detector.model import STRIDE, sides_to_boxes

SEEN = 0.3  # vehicles of which less is visible are neither asked for nor punished
SMALL = 5.0  # px, likewise for boxes with a shorter side
FULL = 24.0  # px; the class and sides of smaller ones are half guesswork and count for less


@dataclass(frozen=True)
class Targets:
    """What the network should say of one batch; grid of `STRIDE` px.

    Attributes
    ----------
    heat : [batch, row, column] 1 at centers, falling off as a Gaussian
    counted : [batch, row, column] 0 where nothing is asked
    weight : [batch, row, column] weight of box and class; sums to 1 per vehicle of at least `FULL` px, less for smaller
    boxes : [batch, 4, row, column] px
    kinds : [batch, row, column] class index
    """

    heat: Tensor
    counted: Tensor
    weight: Tensor
    boxes: Tensor
    kinds: Tensor


def make_targets(truths: list[NDArray[np.float32]], rows: int, columns: int) -> Targets:
    """Spread boxes over the grid.

    Parameters
    ----------
    truths : per picture [k, 6]: x1, y1, x2, y2 (px), class index, visibility
    rows, columns : of the grid
    """
    grids = [picture_targets(truth, rows, columns) for truth in truths]
    heat, counted, weight, boxes, kinds = (torch.from_numpy(np.stack(part)) for part in zip(*grids, strict=True))
    return Targets(heat, counted, weight, boxes, kinds)


def picture_targets(truth: NDArray[np.float32], rows: int, columns: int) -> tuple[NDArray[np.generic], ...]:
    """Spread the boxes [k, 6] of one picture: heat, counted, weight, boxes, kinds."""
    heat = np.zeros((rows, columns), np.float32)
    counted = np.ones((rows, columns), np.float32)
    weight, kinds = np.zeros_like(heat), np.zeros((rows, columns), np.int64)
    boxes = np.zeros((4, rows, columns), np.float32)
    boxes[2:] = 1.0
    x, y = (np.arange(n, dtype=np.float32) + 0.5 for n in (columns, rows))
    wanted = (truth[:, 5] >= SEEN) & (np.minimum(*(truth[:, 2:4] - truth[:, :2]).T) >= SMALL)
    for x1, y1, x2, y2, *_ in truth[~wanted] / STRIDE:
        counted[int(y1) : int(np.ceil(y2)), int(x1) : int(np.ceil(x2))] = 0
    for row in truth[wanted]:
        x1, y1, x2, y2 = row[:4] / STRIDE
        cx, cy = (x1 + x2) / 2, (y1 + y2) / 2
        hill = (
            np.exp(-0.5 * ((x - cx) / max(0.1 * (x2 - x1), 0.6)) ** 2)
            * np.exp(-0.5 * ((y - cy) / max(0.1 * (y2 - y1), 0.6)) ** 2)[:, None]
        )
        hill[min(int(cy), rows - 1), min(int(cx), columns - 1)] = 1
        mine = (hill > heat) & (hill > 0.4)
        heat = np.maximum(heat, hill)
        worth = float(np.clip(min(row[2] - row[0], row[3] - row[1]) / FULL, 0.2, 1.0))
        weight[mine] = worth * (hill / hill[hill > 0.4].sum())[mine]
        kinds[mine] = int(row[4])
        boxes[:, mine] = row[:4, None]
    counted[heat == 1] = 1
    return heat, counted, weight, boxes, kinds


def detection_loss(maps: Tensor, targets: Targets) -> Tensor:
    """Loss of the network's maps [batch, 9, row, column].

    Penalty-reduced focal loss on the centers (Law and Deng 2018, eq. 1), generalized IoU (Rezatofighi et al. 2019) and
    the logarithm of the sides' ratio on the boxes, cross entropy on the classes, each averaged over vehicles.
    """
    center = (targets.heat == 1).to(maps.dtype)
    count, worth = center.sum().clamp(min=1.0), targets.weight.sum().clamp(min=1.0)
    score = torch.sigmoid(maps[:, 0]).clamp(1e-5, 1 - 1e-5)
    found = center * (1 - score) ** 2 * torch.log(score)
    empty = (1 - center) * (1 - targets.heat) ** 4 * score**2 * torch.log(1 - score)
    heat = -(targets.counted * (found + empty)).sum()
    boxes = sides_to_boxes(maps[:, 1:5])
    overlap = targets.weight * (1 - generalized_iou(boxes, targets.boxes))
    sides = targets.weight * (maps[:, 1:5] - log_sides(targets.boxes)).abs().mean(1)
    kinds = targets.weight * nn.functional.cross_entropy(maps[:, 5:], targets.kinds, reduction="none")
    return heat / count + (2 * overlap.sum() + 2 * sides.sum() + kinds.sum()) / worth


def log_sides(boxes: Tensor) -> Tensor:
    """Boxes [batch, 4, row, column], px -> log distances of their sides from the cells, in cells."""
    rows, columns = boxes.shape[-2:]
    y = (torch.arange(rows) + 0.5)[:, None]
    x = torch.arange(columns) + 0.5
    x1, y1, x2, y2 = (boxes / STRIDE).unbind(1)
    return torch.log(torch.stack([x - x1, y - y1, x2 - x, y2 - y], dim=1).clamp(min=0.05))


def generalized_iou(a: Tensor, b: Tensor) -> Tensor:
    """Generalized intersection over union [batch, row, column] of boxes [batch, 4, row, column]."""
    size_a, size_b = a[:, 2:] - a[:, :2], b[:, 2:] - b[:, :2]
    shared = (torch.minimum(a[:, 2:], b[:, 2:]) - torch.maximum(a[:, :2], b[:, :2])).clamp(min=0).prod(1)
    hull = (torch.maximum(a[:, 2:], b[:, 2:]) - torch.minimum(a[:, :2], b[:, :2])).prod(1)
    union = size_a.prod(1) + size_b.prod(1) - shared
    return shared / union - (hull - union) / hull
