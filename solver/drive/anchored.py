"""Anchors of a drive: likelihoods and picks of channels whose place is known."""

from dataclasses import replace

import numpy as np

from solver.drive.likelihood import Heard
from solver.drive.path import STEP, Path
from solver.drive.picks import Picks
from solver.drive.quiet import Quiet
from solver.survey.anchors import Anchor


def place_of(anchor: Anchor, quiet: Quiet, path: Path) -> tuple[float, int, float]:
    """Index of an anchor's channel, its cell, and its sigma along the path, cells."""
    cell, _ = path.nearest(np.array([[anchor.x, anchor.y]]))
    return anchor.channel - float(quiet.channel[0]), int(cell[0]), anchor.sigma_xy / STEP


def with_anchors(found: Heard, anchors: list[Anchor], quiet: Quiet, path: Path) -> Heard:
    """Likelihoods with those of anchors."""
    ratio = found.ratio.copy()
    for anchor in anchors:
        at, cell, sigma = place_of(anchor, quiet, path)
        index = round(at)
        if 0 <= index < len(ratio):
            cells = found.low[index] + np.arange(ratio.shape[1])
            spread = np.hypot(sigma, quiet.channel_spacing / STEP / 2)
            ratio[index] += np.maximum(30.0 - 0.5 * ((cells - cell) / spread) ** 2, -30.0)
    return replace(found, ratio=ratio)


def anchored(picks: Picks, anchors: list[Anchor], quiet: Quiet, path: Path) -> Picks:
    """Picks with a leg of anchors behind the car's, without clock or error of the car; none where there are none."""
    if not anchors:
        return picks
    shape = (1, picks.cell.shape[1])
    cell, sigma = np.full(shape, np.nan), np.full(shape, np.nan)
    for anchor in anchors:
        at, where, spread = place_of(anchor, quiet, path)
        index = round(at)
        if 0 <= index < shape[1]:
            cell[0, index] = where + (index - at) * quiet.channel_spacing / STEP
            sigma[0, index] = max(spread, 0.3)
    nothing = np.zeros(shape)
    return Picks(
        cell=np.concatenate([picks.cell, cell]),
        sigma=np.concatenate([picks.sigma, sigma]),
        speed=np.concatenate([picks.speed, nothing]),
        row=np.concatenate([picks.row, np.full(shape, -1)]),
        amplitude=np.concatenate([picks.amplitude, nothing]),
        ratio=np.concatenate([picks.ratio, nothing]),
    )
