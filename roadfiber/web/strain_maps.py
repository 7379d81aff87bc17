"""What the workbench shows of a pass: measured, model and residual, reduced so that nothing narrow is hidden."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from bokeh.palettes import RdBu
from numpy.typing import NDArray

from solver.criticism.comparison.pass_windows import path_of, shown
from solver.run.report.misfit import rows_of, whole_range
from solver.run.seen import Seen
from vision.contract.palette import LINEAR

Array = NDArray[np.float64]

#: Rows and columns of a picture on the page at most.
CELLS = 320
#: Colors of the scale: as many as keep steps of a tenth of a sigma apart where the record is loud.
COLORS = 1001


def extremes(values: Array, rows: int, columns: int) -> Array:
    """At most so many rows and columns: of each block, the value that is farthest from 0.

    A residual of one channel at one moment stays as large as it is, however many share its place on the screen.

    Parameters
    ----------
    values : [row, column]; NaN where there is none

    >>> quiet = np.zeros((1000, 400))
    >>> quiet[517, 33] = -9.0
    >>> float(extremes(quiet, 20, 20).min())
    -9.0
    >>> extremes(np.array([[1.0, -3.0], [np.nan, 2.0]]), 1, 1).tolist()
    [[-3.0]]
    """
    for axis, most in enumerate((rows, columns)):
        starts = np.arange(0, values.shape[axis], -(-values.shape[axis] // most))
        high, low = (at.reduceat(values, starts, axis) for at in (np.fmax, np.fmin))
        values = np.where(-low > high, low, high)
    return values


@dataclass(frozen=True)
class PassMaps:
    """One pass, with what else was recorded shortly before and after it.

    Parameters
    ----------
    number : of the pass
    channel : [channel], from the first that was fitted to the last
    seconds : [sample], s since the first of them
    start : of them, s since the record's start
    measured, model, residual : [sample, channel], in standard deviations of the noise; NaN where not measured
    path : [row, 2], channel nearest to the vehicle, and when, s; NaN beyond the fitted channels
    """

    number: int
    channel: NDArray[np.int64]
    seconds: Array
    start: float
    measured: Array
    model: Array
    residual: Array
    path: Array

    @property
    def step(self) -> float:
        """Time between samples, s."""
        return float(np.median(np.diff(self.seconds))) if len(self.seconds) > 1 else 1.0

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """First and last channel, first and last second, to the edges of their cells."""
        half = self.step / 2
        return self.channel[0] - 0.5, self.channel[-1] + 0.5, self.seconds[0] - half, self.seconds[-1] + half

    def trace(self, channel: float) -> tuple[int, Array, Array]:
        """The channel nearest to that number, and what it measured and what the model has, [sample] in sigmas."""
        at = int(np.clip(round(channel), self.channel[0], self.channel[-1]) - self.channel[0])
        return int(self.channel[at]), self.measured[:, at], self.model[:, at]


def maps_of(run: Seen, number: int, model: Array | None = None) -> PassMaps:
    """What is shown of a pass.

    Parameters
    ----------
    run : to show
    number : of the pass
    model : [sample, fitted], 1/s, in place of the run's own
    """
    result = run.result
    whole = shown(run, run.passes[number])
    rows = rows_of(result, whole)
    known = result.model if model is None else model
    parts = (result.measured[rows], known[rows], result.measured[rows] - known[rows])
    measured, modeled, residual = (whole_range(result, part / result.noise) for part in parts)
    seconds = run.time[rows]
    at, path = path_of(run, run.passes[number])
    start = float(seconds[0])
    channel = np.arange(result.fitted_channel[0], result.fitted_channel[-1] + 1)
    return PassMaps(
        number, channel, seconds - start, start, measured, modeled, residual, np.column_stack([path, at - start])
    )


def picture(
    maps: PassMaps, values: Array, channels: tuple[float, float], seconds: tuple[float, float]
) -> dict[str, list[object]]:
    """What of a map [sample, channel] lies in a window, as the columns of an image on the page.

    Parameters
    ----------
    values : one of the maps
    channels, seconds : the window

    >>> channel, seconds = np.arange(100), np.arange(50) / 5
    >>> none = np.zeros((50, 100))
    >>> maps = PassMaps(0, channel, seconds, 0.0, none, none, none, np.zeros((0, 2)))
    >>> cut = picture(maps, none, (20, 39), (2.0, 4.0))
    >>> cut["x"], cut["dw"], cut["image"][0].shape
    ([19.5], [20.0], (11, 20))
    """
    columns = np.flatnonzero((maps.channel >= channels[0] - 0.5) & (maps.channel <= channels[1] + 0.5))
    rows = np.flatnonzero((maps.seconds >= seconds[0] - maps.step / 2) & (maps.seconds <= seconds[1] + maps.step / 2))
    if not len(rows) or not len(columns):
        return {"image": [], "x": [], "y": [], "dw": [], "dh": []}
    part = values[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    image = extremes(part, CELLS, CELLS).astype(np.float32)
    # The last block may be cut short: it is as wide on the page as the others.
    high, wide = (-(-size // CELLS) * count for size, count in zip(part.shape, image.shape, strict=True))
    return {
        "image": [image],
        "x": [float(maps.channel[columns[0]]) - 0.5],
        "y": [float(maps.seconds[rows[0]]) - maps.step / 2],
        "dw": [float(wide)],
        "dh": [high * maps.step],
    }


@lru_cache(maxsize=8)
def palette(limit: float) -> tuple[str, ...]:
    """Colors [color] from -limit to limit, evenly in sigmas: the scale of all pages, linear to 3 sigmas.

    Without matplotlib, which takes longer to load than the page to draw.

    >>> len(palette(40.0)), palette(40.0)[500], palette(40.0)[-1]
    (1001, '#f7f7f7', '#67001f')
    """
    stops = np.array([[int(one[at : at + 2], 16) for at in (1, 3, 5)] for one in RdBu[11]])
    share = np.arcsinh(np.linspace(-limit, limit, COLORS) / LINEAR) / np.arcsinh(limit / LINEAR)
    parts = [np.interp(share, np.linspace(-1, 1, len(stops)), part) for part in stops.T]
    return tuple("#{:02x}{:02x}{:02x}".format(*one) for one in np.rint(parts).astype(int).T.tolist())


def steps(values: Array, seconds: Array, most: int = 1500) -> tuple[Array, Array]:
    """A trace [sample] for a line on the page: as it is, or the lowest and the highest of each of some blocks.

    >>> at, line = steps(np.sin(np.arange(10_000)), np.arange(10_000.0))
    >>> len(at) <= 3000, round(float(line.max()), 3)
    (True, 1.0)
    """
    if len(values) <= 2 * most:
        return seconds, values
    starts = np.arange(0, len(values), -(-len(values) // most))
    both = np.column_stack([at.reduceat(values, starts) for at in (np.fmin, np.fmax)])
    return np.repeat(seconds[starts], 2), both.ravel()


def worst_channel(maps: PassMaps) -> int:
    """Number of the channel with the largest residual."""
    return int(maps.channel[int(np.nansum(np.square(maps.residual), axis=0).argmax())])
