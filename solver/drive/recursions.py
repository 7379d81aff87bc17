"""Recursions of the hidden Markov model of a channel map, in machine code (Rabiner 1989, Proc. IEEE 77, 257).

All take the same: `even` and `odd` [channel, place], likelihoods of cable that runs on and of cable in a loop; `low`
[channel], the cell of each channel's first place; `on` and `edge` [channel, step], the kernels of an advance; `begins`
[channel] and `ends`, probabilities that a loop begins and ends; and what they write into.
"""

from functools import cache
from typing import Any

import numpy as np

from solver.ground.compiled import compiled


@cache
def recursions() -> tuple[Any, Any, Any]:
    """Forward, backward and Viterbi recursions in machine code."""
    return compiled(forward), compiled(backward), compiled(viterbi)


def forward(even: Any, odd: Any, low: Any, on: Any, edge: Any, begins: Any, ends: float, alpha: Any) -> float:
    """Probability of each state given what was heard so far, into `alpha`; the log of that of all that was heard."""
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
    """Probability of each state given all that was heard, into `alpha`, which holds what `forward` left there."""
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
    """The most probable cells and states [channel, 2], into `path`."""
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
