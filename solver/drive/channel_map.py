"""Which channel lies where along the path: a hidden Markov model over the channels.

A channel's state is a cell of the path, and whether its cable runs on, lies in a loop, or runs on where another vehicle
is heard in place of the car. From channel to channel the cell moves on by the channel spacing, with some jitter; in a
loop it stays. Where another vehicle is heard, what is heard says nothing of the cell: a companion that goes faster or
slower than the car is one event, however many channels hear it. Forward and backward recursions give the posterior
(Rabiner 1989, Proc. IEEE 77, 257).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solver.drive.likelihood import TRAFFIC, Heard
from solver.drive.path import STEP
from solver.drive.recursions import Model, recursions

Array = NDArray[np.float64]

#: Share of channels that hear nothing of a car beside them.
DEAF = 0.03
#: Loops per m of cable, and m of cable in one, before the data are asked.
LOOPS, LENGTH = 1.5e-3, 120.0
#: Jitter of a step from channel to channel: share of it, and cells at least; and the share of steps that are any.
JITTER, LEAST, ANY = 0.03, 0.45, 1e-5
#: Share of loops' channels that hear the car at the manhole.
LEAKS = 0.3
#: Times per m of cable that another vehicle is heard in place of the car, and m over which it is.
COMPANIONS, COMPANY = 1e-3, 150.0
#: How much faster or slower it seems to go than the car, and the share of channels at which it is not the one before.
OTHER_SPEED, AFRESH = 0.25, 0.05
#: Probability beyond which a channel lies in a loop.
LIKELY = 0.5


@dataclass(frozen=True)
class ChannelMap:
    """The posterior of a channel map.

    Parameters
    ----------
    cell, spread : mean and standard deviation of each channel's cell [channel]
    likeliest : cells of the path whose cells are most probable, each by itself [channel]
    in_loop : probability that a channel lies in a loop [channel]
    loop : whether it rather does than not [channel]
    other : probability that it hears another vehicle in place of the car [channel]
    evidence : log of the probability of all data
    """

    cell: Array
    spread: Array
    likeliest: NDArray[np.int64]
    in_loop: Array
    loop: NDArray[np.bool_]
    other: Array
    evidence: float


def kernels(advance: Array, bend: Array | float = 0.0) -> tuple[Array, Array, Array]:
    """Probability of each advance in cells [channel, step].

    For cable that runs on, at either end of a loop, and of where another vehicle seems to be.

    Parameters
    ----------
    advance : cells that are expected [channel]
    bend : cells, standard deviation from bends of the map, [channel] or one
    """
    size = int(np.ceil(2 * advance.max())) + 3
    step = np.arange(size)
    sigma = np.hypot(np.maximum(JITTER * advance, LEAST), bend)
    on, wide = (
        np.exp(-0.5 * ((step - advance[:, None]) / one[:, None]) ** 2)
        for one in (sigma, np.hypot(sigma, OTHER_SPEED * advance))
    )
    on = (1 - ANY) * on / on.sum(1, keepdims=True) + ANY / size
    edge = np.clip(advance[:, None] + 0.5 - step, 0, 1) * (step <= advance[:, None] + 0.5)
    return on, edge / edge.sum(1, keepdims=True), wide / wide.sum(1, keepdims=True)


def against_traffic(ratio: NDArray[Any]) -> NDArray[Any]:
    """Log likelihood ratios of the car to noise or another vehicle, from those of the car to noise.

    They choose between companions; where exactly the car is they tell less well, as the tops of peaks are cut.

    >>> against_traffic(np.array([-5.0, 0.0, 30.0])).round(2).tolist()
    [-5.0, -0.06, 2.81]
    """
    return np.asarray(ratio - np.logaddexp(0.0, np.log(TRAFFIC) + ratio))


def other_vehicle(there: Array, dead: NDArray[np.bool_], low: NDArray[np.int64], wide: Array) -> Array:
    """Likelihood of each channel [channel] if it hears another vehicle in place of the car.

    Parameters
    ----------
    there : likelihoods of one at each place, of a deaf channel where nothing is heard [channel, place]; overwritten
    dead : channels that measure nothing [channel]
    low : cell of each channel's first place [channel]
    wide : kernel by which it seems to go on [channel, step]
    """
    other = np.zeros(len(there))
    there[dead] = 1.0
    recursions().followed(there, low, wide, AFRESH, other)
    return np.maximum(other, 1e-60)


def likelihoods(heard: Heard, dead: NDArray[np.bool_]) -> tuple[Array, Array, Array, Array]:
    """Likelihoods [channel, place] of what channels hear where the cable runs on, in a loop, and of another vehicle.

    All are over the exponential of the first that is returned, the largest log likelihood ratio [channel, 1].
    """
    ratio = heard.ratio.astype(np.float64)
    top = np.maximum(ratio.max(1, keepdims=True), 0.0)
    deaf = np.exp(-top)
    other = np.where(ratio > 0, DEAF * deaf + (1 - DEAF) * np.exp(ratio - top), DEAF * deaf)
    car = np.exp(ratio + heard.price - top)
    even, odd = DEAF * deaf + (1 - DEAF) * car, (1 - LEAKS) * deaf + LEAKS * car
    even[dead], odd[dead] = 1.0, 1.0
    return top, np.maximum(even, 1e-60), np.maximum(odd, 1e-60), other


def map_channels(
    heard: Heard, dead: NDArray[np.bool_], spacing: float, factor: Array | float, bend: Array | float = 0.0
) -> ChannelMap:
    """The posterior of which channel lies where.

    Parameters
    ----------
    heard : log likelihood ratios in a band of cells
    dead : channels that measure nothing [channel]
    spacing : of the channels, m
    factor : meters of cable per meter of path, [channel] or one
    bend : cells, standard deviation of an advance from bends of the map, [channel] or one
    """
    run = recursions()
    channels, width = heard.ratio.shape
    advance = np.broadcast_to(spacing / np.asarray(factor, float) / STEP, channels).astype(float)
    on, edge, wide = kernels(advance, bend)
    top, even, odd, other = likelihoods(heard, dead)
    other = other_vehicle(other, dead, heard.low, wide)
    begins = np.full(channels, min(0.2, LOOPS * spacing))
    changes = (min(0.5, spacing / LENGTH), min(0.2, COMPANIONS * spacing), min(0.5, spacing / COMPANY))
    model = Model(even, odd, other, heard.low, on, edge, begins, *changes)
    alpha = np.zeros((channels, width, 3))
    evidence = run.forward(model, alpha)
    run.backward(model, alpha)
    both = alpha.sum(2)
    both /= both.sum(1, keepdims=True)
    likeliest = np.zeros(channels, np.int64)
    run.decoded(both, heard.low, on.shape[1], likeliest)
    kind = alpha.sum(1) / alpha.sum((1, 2))[:, None]
    places = np.arange(width)
    mean = both @ places
    spread = np.sqrt(np.maximum(both @ places**2 - mean**2, 0))
    return ChannelMap(
        cell=heard.low + mean,
        spread=spread,
        likeliest=likeliest,
        in_loop=kind[:, 1],
        loop=kind[:, 1] > LIKELY,
        other=kind[:, 2],
        evidence=float(evidence + top.sum()),
    )
