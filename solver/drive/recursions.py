"""Recursions of the hidden Markov model of a channel map, in machine code (Rabiner 1989, Proc. IEEE 77, 257).

A channel's cable runs on and hears the car (0), lies in a loop (1), or runs on and hears another vehicle (2). All take
the same: `even` and `odd` [channel, place], likelihoods of the first two; `other` [channel], of the third, which says
nothing of the place; `low` [channel], the cell of each channel's first place; `on` and `edge` [channel, step], the
kernels of an advance; `begins` [channel] and `ends`, probabilities that a loop begins and ends; `joins` and `leaves`,
that another vehicle is heard from here on, and no longer; and what they write into.
"""

from functools import cache
from typing import Any, NamedTuple

import numpy as np

from solver.ground.compiled import compiled


class Model(NamedTuple):
    """The model of a drive's channels: what each hears in a band of places, and how the state goes on to the next.

    Attributes
    ----------
    even, odd : likelihood of each place where the cable runs on, and in a loop [channel, place]
    other : likelihood that another vehicle is heard [channel]
    low : cell of each channel's first place [channel]
    on, edge : probability of an advance, in steps of a cell, where the cable runs on, and into and out of a loop
        [channel, step]
    begins : probability that a loop begins at a channel [channel]
    ends : that a loop ends there
    joins, leaves : that another vehicle begins to be heard in place of the car there, and ends to be
    """

    even: Any
    odd: Any
    other: Any
    low: Any
    on: Any
    edge: Any
    begins: Any
    ends: float
    joins: float
    leaves: float


class Recursions(NamedTuple):
    """The functions of this module, in machine code."""

    forward: Any
    backward: Any
    followed: Any
    decoded: Any


@cache
def recursions() -> Recursions:
    """Compile them, at the first call."""
    return Recursions(compiled(forward), compiled(backward), compiled(followed), compiled(decoded))


def followed(even: Any, low: Any, wide: Any, afresh: float, other: Any) -> None:
    """Likelihood of each channel [channel], into `other`, if what it hears is a vehicle that its neighbors hear too.

    The vehicle is tracked along the channels on its own: from one to the next it seems to move on by the kernel `wide`
    [channel, step], as it is faster or slower than the car, or with probability `afresh` it is any other.
    """
    channels, width = even.shape
    there, ahead = np.full(width, 1.0 / width), np.zeros(width)
    for channel in range(channels):
        total = 0.0
        for place in range(width):
            moved = 0.0
            if channel > 0:
                shift = low[channel] + place - low[channel - 1]
                for step in range(wide.shape[1]):
                    before = shift - step
                    if 0 <= before < width:
                        moved += there[before] * wide[channel, step]
            ahead[place] = ((1 - afresh) * moved + afresh / width) * even[channel, place]
            total += ahead[place]
        other[channel] = total
        for place in range(width):
            there[place] = ahead[place] / max(total, 1e-290)


def forward(model: Model, alpha: Any) -> float:
    """Probability of each state given what was heard so far, into `alpha` [channel, place, state].

    Returns the log of the probability of all that was heard.
    """
    even, odd, other, low, on, edge, begins, ends, joins, leaves = model
    channels, width = even.shape
    evidence = 0.0
    for channel in range(channels):
        total, begin = 0.0, begins[channel]
        for place in range(width):
            runs, follows, out, into, loop = 0.0, 0.0, 0.0, 0.0, 0.0
            if channel == 0:
                runs, loop = 1 / width, begin / width
            else:
                shift = low[channel] + place - low[channel - 1]
                for step in range(on.shape[1]):
                    before = shift - step
                    if 0 <= before < width:
                        was, hidden = alpha[channel - 1, before, 0], alpha[channel - 1, before, 2]
                        runs += was * on[channel, step]
                        follows += hidden * on[channel, step]
                        out += alpha[channel - 1, before, 1] * edge[channel, step]
                        into += (was + hidden) * edge[channel, step]
                if 0 <= shift < width:
                    loop = alpha[channel - 1, shift, 1] * (1 - ends)
            straight = (1 - begin) * ((1 - joins) * runs + leaves * follows) + (1 - joins) * ends * out
            hidden = (1 - begin) * (joins * runs + (1 - leaves) * follows) + joins * ends * out
            alpha[channel, place, 0] = straight * even[channel, place]
            alpha[channel, place, 1] = (loop + begin * into) * odd[channel, place]
            alpha[channel, place, 2] = hidden * other[channel]
            total += alpha[channel, place, 0] + alpha[channel, place, 1] + alpha[channel, place, 2]
        total = max(total, 1e-290)
        evidence += np.log(total)
        for place in range(width):
            for kind in range(3):
                alpha[channel, place, kind] = alpha[channel, place, kind] / total + 1e-60
    return evidence


def backward(model: Model, alpha: Any) -> None:
    """Probability of each state given all that was heard, into `alpha`, which holds what `forward` left there."""
    even, odd, other, low, on, edge, begins, ends, joins, leaves = model
    channels, width = even.shape
    beta, next_beta = np.ones((width, 3)), np.ones((width, 3))
    for channel in range(channels - 2, -1, -1):
        total, begin = 0.0, begins[channel + 1]
        for place in range(width):
            runs, follows, out, hidden, into, loop = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            shift = low[channel] + place - low[channel + 1]
            for step in range(on.shape[1]):
                after = shift + step
                if 0 <= after < width:
                    straight = beta[after, 0] * even[channel + 1, after]
                    another = beta[after, 2] * other[channel + 1]
                    runs += on[channel + 1, step] * straight
                    follows += on[channel + 1, step] * another
                    out += edge[channel + 1, step] * straight
                    hidden += edge[channel + 1, step] * another
                    into += edge[channel + 1, step] * beta[after, 1] * odd[channel + 1, after]
            if 0 <= shift < width:
                loop = (1 - ends) * beta[shift, 1] * odd[channel + 1, shift]
            next_beta[place, 0] = (1 - begin) * ((1 - joins) * runs + joins * follows) + begin * into
            next_beta[place, 1] = ends * ((1 - joins) * out + joins * hidden) + loop
            next_beta[place, 2] = (1 - begin) * (leaves * runs + (1 - leaves) * follows) + begin * into
            total = max(total, next_beta[place, 0], next_beta[place, 1], next_beta[place, 2])
        total = max(total, 1e-290)
        whole = 0.0
        for place in range(width):
            for kind in range(3):
                beta[place, kind] = next_beta[place, kind] / total + 1e-60
                alpha[channel, place, kind] *= beta[place, kind]
                whole += alpha[channel, place, kind]
        for place in range(width):
            for kind in range(3):
                alpha[channel, place, kind] /= max(whole, 1e-290)


def decoded(there: Any, low: Any, steps: int, path: Any) -> None:
    """The path [channel] whose cells are most probable, each by itself, into `path`.

    Of `there` [channel, place], the probability of each place whatever the other channels do, the product is largest
    along it; from channel to channel it goes on by less than `steps` (Fariselli, Martelli and Casadio 2005, BMC
    Bioinformatics 6, S12). Viterbi's path holds one cell of the car against all cells of another vehicle at once, and
    goes on by the one most probable step, in whole cells, where nothing tells of them.
    """
    channels, width = there.shape
    trace = np.zeros((channels, width), np.int16)
    score, ahead = np.zeros(width), np.zeros(width)
    for channel in range(channels):
        shift = low[channel] - low[max(channel - 1, 0)]
        for place in range(width):
            best, how = -1e18, 0
            for step in range(steps if channel else 0):
                before = place + shift - step
                if 0 <= before < width and score[before] > best:
                    best, how = score[before], step
            ahead[place] = (best if channel else 0.0) + np.log(max(there[channel, place], 1e-300))
            trace[channel, place] = how
        score, ahead = ahead, score
    place = int(score.argmax())
    for channel in range(channels - 1, -1, -1):
        path[channel] = low[channel] + place
        if channel:
            place = min(max(path[channel] - low[channel - 1] - trace[channel, place], 0), width - 1)
