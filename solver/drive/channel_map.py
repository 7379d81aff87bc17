"""Which channel lies where along the path: a hidden Markov model over the channels.

A channel's state is a cell of the path, and whether its cable runs on or lies in a loop. From channel to channel the
cell moves on by the channel spacing, with some jitter; in a loop it stays. Forward and backward recursions give the
posterior (Rabiner 1989, Proc. IEEE 77, 257), Viterbi's the best path.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solver.drive.likelihood import Heard
from solver.drive.path import STEP
from solver.ground.compiled import compiled

Array = NDArray[np.float64]

#: Share of channels that hear nothing of a car beside them.
DEAF = 0.03
#: Loops per m of cable, and m of cable in one, before the data are asked.
LOOPS, LENGTH = 1.5e-3, 120.0
#: Jitter of a step from channel to channel: share of it, and cells at least; and the share of steps that are any.
JITTER, LEAST, ANY = 0.03, 0.45, 1e-5
#: Share of loops' channels that hear the car at the manhole.
LEAKS = 0.3


@dataclass(frozen=True)
class ChannelMap:
    """The posterior of a channel map.

    Parameters
    ----------
    cell, spread : mean and standard deviation of each channel's cell [channel]
    best : cells of the best path [channel]
    in_loop : probability that a channel lies in a loop [channel]
    best_loop : whether it does on the best path [channel]
    evidence : log of the probability of all data
    """

    cell: Array
    spread: Array
    best: NDArray[np.int64]
    in_loop: Array
    best_loop: NDArray[np.bool_]
    evidence: float


def kernels(advance: Array) -> tuple[Array, Array]:
    """Probability of each advance in cells [channel, step]: for cable that runs on, and at either end of a loop."""
    size = int(np.ceil(2 * advance.max())) + 3
    step = np.arange(size)
    sigma = np.maximum(JITTER * advance, LEAST)[:, None]
    on = np.exp(-0.5 * ((step - advance[:, None]) / sigma) ** 2)
    on = (1 - ANY) * on / on.sum(1, keepdims=True) + ANY / size
    edge = np.clip(advance[:, None] + 0.5 - step, 0, 1) * (step <= advance[:, None] + 0.5)
    return on, edge / edge.sum(1, keepdims=True)


@cache
def recursions() -> tuple[Any, Any, Any]:
    """Forward, backward and Viterbi recursions in machine code."""

    def forward(even: Any, odd: Any, low: Any, on: Any, edge: Any, begins: Any, ends: float, alpha: Any) -> float:
        channels, width = even.shape
        evidence = 0.0
        for channel in range(channels):
            total = 0.0
            for place in range(width):
                straight, loop = 0.0, 0.0
                if channel == 0:
                    straight, loop = (1 - begins[0]) / width, begins[0] / width
                else:
                    shift = low[channel] + place - low[channel - 1]
                    for step in range(on.shape[1]):
                        before = shift - step
                        if 0 <= before < width:
                            was, slack = alpha[channel - 1, before, 0], alpha[channel - 1, before, 1]
                            straight += was * (1 - begins[channel]) * on[channel, step]
                            straight += slack * ends * edge[channel, step]
                            loop += was * begins[channel] * edge[channel, step]
                    if 0 <= shift < width:
                        loop += alpha[channel - 1, shift, 1] * (1 - ends)
                alpha[channel, place, 0] = straight * even[channel, place]
                alpha[channel, place, 1] = loop * odd[channel, place]
                total += alpha[channel, place, 0] + alpha[channel, place, 1]
            total = max(total, 1e-290)
            evidence += np.log(total)
            for place in range(width):
                alpha[channel, place, 0] = alpha[channel, place, 0] / total + 1e-60
                alpha[channel, place, 1] = alpha[channel, place, 1] / total + 1e-60
        return evidence

    def backward(even: Any, odd: Any, low: Any, on: Any, edge: Any, begins: Any, ends: float, alpha: Any) -> None:
        channels, width = even.shape
        beta, next_beta = np.ones((width, 2)), np.ones((width, 2))
        for channel in range(channels - 2, -1, -1):
            total = 0.0
            for place in range(width):
                straight, loop = 0.0, 0.0
                shift = low[channel] + place - low[channel + 1]
                for step in range(on.shape[1]):
                    after = shift + step
                    if 0 <= after < width:
                        runs = beta[after, 0] * even[channel + 1, after]
                        slack = beta[after, 1] * odd[channel + 1, after]
                        straight += (1 - begins[channel + 1]) * on[channel + 1, step] * runs
                        straight += begins[channel + 1] * edge[channel + 1, step] * slack
                        loop += ends * edge[channel + 1, step] * runs
                if 0 <= shift < width:
                    loop += (1 - ends) * beta[shift, 1] * odd[channel + 1, shift]
                next_beta[place, 0], next_beta[place, 1] = straight, loop
                total = max(total, straight, loop)
            total = max(total, 1e-290)
            whole = 0.0
            for place in range(width):
                beta[place, 0] = next_beta[place, 0] / total + 1e-60
                beta[place, 1] = next_beta[place, 1] / total + 1e-60
                alpha[channel, place, 0] *= beta[place, 0]
                alpha[channel, place, 1] *= beta[place, 1]
                whole += alpha[channel, place, 0] + alpha[channel, place, 1]
            for place in range(width):
                alpha[channel, place, 0] /= max(whole, 1e-290)
                alpha[channel, place, 1] /= max(whole, 1e-290)

    def viterbi(even: Any, odd: Any, low: Any, on: Any, edge: Any, begins: Any, ends: float, path: Any) -> None:
        channels, width = even.shape
        trace = np.zeros((channels, width, 2), np.int16)
        score, ahead = np.zeros((width, 2)), np.zeros((width, 2))
        for channel in range(channels):
            for place in range(width):
                straight, loop, way, turn = -1e18, -1e18, 0, 0
                if channel == 0:
                    straight, loop = np.log(1 - begins[0]), np.log(begins[0])
                else:
                    shift = low[channel] + place - low[channel - 1]
                    for step in range(on.shape[1]):
                        before = shift - step
                        if 0 <= before < width:
                            value = score[before, 0] + np.log((1 - begins[channel]) * on[channel, step])
                            if value > straight:
                                straight, way = value, step
                            if edge[channel, step] > 0:
                                value = score[before, 1] + np.log(ends * edge[channel, step])
                                if value > straight:
                                    straight, way = value, -1 - step
                                value = score[before, 0] + np.log(begins[channel] * edge[channel, step])
                                if value > loop:
                                    loop, turn = value, step
                    if 0 <= shift < width:
                        value = score[shift, 1] + np.log(1 - ends)
                        if value > loop:
                            loop, turn = value, -1
                ahead[place, 0] = straight + np.log(even[channel, place])
                ahead[place, 1] = loop + np.log(odd[channel, place])
                trace[channel, place, 0], trace[channel, place, 1] = way, turn
            score, ahead = ahead, score
        mode, place = 0, 0
        for candidate in range(width):
            for kind in range(2):
                if score[candidate, kind] > score[place, mode]:
                    place, mode = candidate, kind
        for channel in range(channels - 1, -1, -1):
            path[channel, 0], path[channel, 1] = low[channel] + place, mode
            if channel == 0:
                break
            how = trace[channel, place, mode]
            shift = low[channel] + place - low[channel - 1]
            if mode == 0:
                mode, step = (0, how) if how >= 0 else (1, -1 - how)
            else:
                mode, step = (0, how) if how >= 0 else (1, 0)
            place = min(max(shift - step, 0), width - 1)

    return compiled(forward), compiled(backward), compiled(viterbi)


def map_channels(heard: Heard, dead: NDArray[np.bool_], spacing: float, factor: Array | float) -> ChannelMap:
    """The posterior of which channel lies where.

    Parameters
    ----------
    heard : log likelihood ratios in a band of cells
    dead : channels that measure nothing [channel]
    spacing : of the channels, m
    factor : meters of cable per meter of path, [channel] or one
    """
    forward, backward, viterbi = recursions()
    channels, width = heard.ratio.shape
    advance = np.broadcast_to(spacing / np.asarray(factor, float) / STEP, channels).astype(float)
    on, edge = kernels(advance)
    begins = np.full(channels, min(0.2, LOOPS * spacing))
    ends = min(0.5, spacing / LENGTH)
    ratio = heard.ratio.astype(np.float64)
    top = np.maximum(ratio.max(1, keepdims=True), 0.0)
    even = DEAF * np.exp(-top) + (1 - DEAF) * np.exp(ratio - top)
    odd = (1 - LEAKS) * np.exp(-top) + LEAKS * np.exp(ratio - top)
    even[dead], odd[dead] = 1.0, 1.0
    even, odd = np.maximum(even, 1e-60), np.maximum(odd, 1e-60)
    alpha = np.zeros((channels, width, 2))
    evidence = forward(even, odd, heard.low, on, edge, begins, ends, alpha)
    path = np.zeros((channels, 2), np.int64)
    backward(even, odd, heard.low, on, edge, begins, ends, alpha)
    viterbi(even, odd, heard.low, on, edge, begins, ends, path)
    both = alpha.sum(2)
    both /= both.sum(1, keepdims=True)
    places = np.arange(width)
    mean = both @ places
    spread = np.sqrt(np.maximum(both @ places**2 - mean**2, 0))
    return ChannelMap(
        cell=heard.low + mean,
        spread=spread,
        best=path[:, 0],
        in_loop=alpha[:, :, 1].sum(1) / alpha.sum((1, 2)),
        best_loop=path[:, 1] == 1,
        evidence=float(evidence + top.sum()),
    )
