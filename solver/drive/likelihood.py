"""How likely each channel lies at each cell of the path: the matched filter as a likelihood that traffic cannot fool.

Within reach of a cell, a channel's samples d are a response h of unit energy times an amplitude, plus noise whose level
is not known (other vehicles): the ratio to noise alone is ((nu + d.d) / (nu + |d - a h|^2))^((nu + n) / 2). The
amplitude is what fits best between a quarter and three times of what neighbors show, and one that is louder than the
car is elsewhere has a price: a truck that follows is no car.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from solver.drive.quiet import Quiet
from solver.drive.response import Responses
from solver.ground.compiled import compiled

Array = NDArray[np.float64]

#: Degrees of freedom that the known noise counts for.
KNOWN = 8.0
#: Share of a sample that counts: neighbors, and errors of the model, are correlated.
COUNTED = 0.5
#: Price of an amplitude and a distance that are free, as log likelihood.
PRICE = 1.5
#: Shares of the neighbors' amplitude that a channel has at least, and at most.
LEAST, MOST = 0.25, 3.0
#: Probability that another vehicle looks like the car to a channel, at a cell where it is not: companions do so for
#: many channels in a row, so that no channel alone may tell much.
TRAFFIC = 0.06


@cache
def machine() -> Any:
    """Fills ratios and amplitudes of `Heard`, in machine code; arguments as of `heard`."""

    def fill(
        values: Any,
        polarity: float,
        floor: Any,
        usual: Any,
        scatter: float,
        low: Any,
        begin: Any,
        row: Any,
        size: Any,
        at: Any,
        leg: Any,
        response: Any,
        strength: Any,
        chosen: int,
        ratio: Any,
        amplitude: Any,
        price: Any,
    ) -> None:
        kinds, width = response.shape[0], ratio.shape[1]
        dots = np.zeros(kinds)
        for channel in range(values.shape[0]):
            for place in range(width):
                cell = low[channel] + place
                total, loudest, paid, usually = 0.0, 0.0, 0.0, 0.0
                if 0 <= cell < len(begin) - 1:
                    first, last = begin[cell], begin[cell + 1]
                    energy, count = 0.0, 0
                    for index in range(first, last):
                        if chosen >= 0 and leg[index] != chosen:
                            continue
                        for sample in range(size[index]):
                            value = values[channel, row[index] + sample]
                            energy += value * value
                            for kind in range(kinds):
                                dots[kind] += value * response[kind, at[index] + sample]
                        count += size[index]
                        if index + 1 == last or leg[index + 1] != leg[index]:
                            noise = KNOWN + COUNTED * energy
                            most, several, best = -1e9, 0.0, 0.0
                            for kind in range(kinds):
                                dot = polarity * dots[kind]
                                least = floor[channel, leg[index]] * strength[index]
                                fit = max(dot, least)
                                if least > 0.0:
                                    fit = min(fit, least * MOST / LEAST)
                                rest = noise + COUNTED * ((dot - fit) ** 2 - dot * dot)
                                value = -0.5 * (KNOWN + COUNTED * count) * np.log(max(rest, 0.02 * noise) / noise)
                                if value > most:
                                    several = several * np.exp(most - value) + 1.0
                                    most, best = value, dot
                                else:
                                    several += np.exp(value - most)
                                loudest = max(loudest, dot / strength[index])
                                dots[kind] = 0.0
                            heard = most + np.log(several / kinds) - PRICE
                            total += heard
                            normal, off = usual[channel, leg[index]] * strength[index], 0.0
                            if 0.0 < normal < best:
                                # The noise of the amplitude is one; what is not heard is not loud.
                                off = 0.5 * np.log(best / normal) ** 2 / (scatter**2 + 1 / best**2)
                                off = min(off, max(heard, 0.0))
                            paid += off
                            usually += max(heard, 0.0) * np.exp(-off)
                            energy, count = 0.0, 0
                ratio[channel, place] = total
                amplitude[channel, place] = loudest
                # Where other legs hear the car as loud as ever, a louder vehicle was beside it on this one.
                price[channel, place] = -paid / (1 + TRAFFIC * np.exp(min(usually, 50.0)))

    return compiled(fill, fastmath=True)


class Usual(NamedTuple):
    """What is usual of the car: its `amplitude` [channel, leg], 0 where that is not known.

    `scatter` is the standard deviation of its log from channel to channel.
    """

    amplitude: Array
    scatter: float


@dataclass(frozen=True)
class Heard:
    """Log likelihood ratio, and loudest amplitude, of each channel at some cells [channel, place].

    `low` [channel] is the cell of place 0. Amplitudes are over the strength that the response has there: a car that
    goes slowly strains the ground as far, but not as fast. `price` is the log of how much less probable what is heard
    is than at the car's loudness, where it is louder; any other vehicle may be.
    """

    low: NDArray[np.int64]
    ratio: NDArray[np.float32]
    amplitude: NDArray[np.float32]
    price: NDArray[np.float32]


def heard(
    quiet: Quiet,
    of: Responses,
    low: NDArray[np.int64],
    width: int,
    polarity: int,
    floor: Array,
    leg: int = -1,
    usual: Usual | None = None,
) -> Heard:
    """Compare all channels with the responses of cells `low` to `low` + `width`.

    Of one `leg`, or of all (-1), with the least amplitude `floor` [channel, leg] of the car, 0 where nothing is known,
    and what is `usual` of it.
    """
    shape = (len(quiet.channel), width)
    ratio, amplitude, price = (np.zeros(shape, np.float32) for _ in range(3))
    loud, scatter = (np.zeros_like(floor), 1.0) if usual is None else usual
    low = np.ascontiguousarray(low, np.int64)
    arrays = (of.begin, of.row, of.size, of.at, of.leg, of.values, of.strength)
    machine()(quiet.values, float(polarity), floor, loud, scatter, low, *arrays, leg, ratio, amplitude, price)
    ratio[quiet.dead], price[quiet.dead] = 0.0, 0.0
    return Heard(low, ratio, amplitude, price)
