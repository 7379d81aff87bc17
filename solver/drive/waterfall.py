"""The record of a drive as a picture, with the car as located or as expected; and one of a drive that is refused."""

from dataclasses import dataclass
from textwrap import fill

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from solver.drive.quiet import Quiet
from solver.drive.response import Legs
from vision.contract.drawing import canvas, place
from vision.contract.figures import styled
from vision.contract.palette import ROUTE

Array = NDArray[np.float64]

#: Rows and columns of the picture of the record; moments of the car.
ROWS, COLUMNS, MOMENTS = 600, 1000, 4000
#: CSS pixels of the picture of a drive that is refused.
WIDTH, HEIGHT = 900, 420
#: Letters in a line of its title.
LINE = 110


@dataclass(frozen=True)
class SeenDrive:
    """What was seen of a drive that is refused.

    Parameters
    ----------
    words : the gate that failed, with its figures
    picture : the record [row, column], as `picture_of` makes it
    channels : first and last
    seconds : length of the record
    time, channel : where the car should have been heard, s and channel [moment]
    """

    words: str
    picture: NDArray[np.float32]
    channels: tuple[int, int]
    seconds: float
    time: Array
    channel: Array

    @classmethod
    def of(cls, words: str, quiet: Quiet, legs: Legs, cell: Array) -> "SeenDrive":
        """What was seen of a record, with a car that goes by cells [channel] of the path."""
        ends = int(quiet.channel[0]), int(quiet.channel[-1])
        time, channel = track_of(quiet, legs, cell)
        inside = (channel > ends[0]) & (channel < ends[1])
        return cls(words, picture_of(quiet), ends, float(quiet.time[-1]), time[inside], channel[inside])

    @styled
    def figure(self) -> Figure:
        """The record, black where it is loud; the car is one of the dark lines, or it is not in there."""
        figure = canvas(WIDTH, HEIGHT + 130)
        axes = place(figure, "record", 70, 66, WIDTH - 90, HEIGHT)
        draw_record(axes, self.picture, self.channels, self.seconds)
        draw_car(axes, self.time, self.channel)
        axes.set_title(fill(self.words, LINE), loc="left", fontsize=10)
        return figure


def picture_of(quiet: Quiet) -> NDArray[np.float32]:
    """The record [row, column]: the loudness of each few channels and samples, noise sigmas."""
    values = quiet.values
    rows = np.arange(0, values.shape[0], max(1, -(-values.shape[0] // ROWS)))
    columns = np.arange(0, values.shape[1], max(1, -(-values.shape[1] // COLUMNS)))
    found = np.empty((len(rows), len(columns)), np.float32)
    for index, row in enumerate(rows):
        stop = rows[index + 1] if index + 1 < len(rows) else values.shape[0]
        energy = np.add.reduceat((values[row:stop] ** 2).mean(0), columns)
        found[index] = np.sqrt(energy / np.diff(np.append(columns, values.shape[1])))
    return found


def moments_of(legs: Legs) -> NDArray[np.int64]:
    """Samples at which the car drove beside the map, thinned out to some thousands."""
    return np.flatnonzero(legs.near)[:: max(1, int(legs.near.sum()) // MOMENTS)]


def track_of(quiet: Quiet, legs: Legs, cell: Array) -> tuple[Array, Array]:
    """When the car went by which channel, s and channel [moment], with the channels at cells of the path [channel]."""
    near = moments_of(legs)
    return quiet.time[near], np.interp(legs.cell[near], np.maximum.accumulate(cell), quiet.channel)


def draw_record(axes: Axes, picture: NDArray[np.float32], channels: tuple[int, int], seconds: float) -> None:
    """Draw a record over minutes and channels."""
    extent = (0.0, seconds / 60, channels[0] - 0.5, channels[1] + 0.5)
    loud = np.log10(np.maximum(np.asarray(picture, float), 0.3))
    axes.imshow(loud, aspect="auto", origin="lower", extent=extent, cmap="Greys", vmin=-0.1, vmax=1.3)
    axes.set(xlim=extent[:2], xlabel="minutes since the start of the record", ylabel="channel")


def draw_car(axes: Axes, time: Array, channel: Array) -> None:
    """Draw where the car is, s and channel [moment]."""
    minutes, where = time / 60, np.asarray(channel, float)
    gap = np.flatnonzero(np.diff(minutes) > 0.5) + 1
    axes.plot(np.insert(minutes, gap, np.nan), np.insert(where, gap, np.nan), color=ROUTE, lw=1.0, alpha=0.8)
