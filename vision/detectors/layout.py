"""Layouts: how to recognize a detector's graph, feed it and read its output."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vision.detectors.images import RGB_UNIT, Fitting, Normalization
from vision.detectors.names import COCO

Outputs = Sequence[NDArray[np.floating]]
Shapes = Sequence[tuple[int, ...]]
Size = tuple[int, int]

# Strides of the dense heads in use: three scales, a fourth for larger or for smaller objects.
PYRAMIDS = ((8, 16, 32), (8, 16, 32, 64), (4, 8, 16, 32))


class Candidates(NamedTuple):
    """Boxes [n, 4], px of the input; scores [n]; class places [n]."""

    box: NDArray[np.floating]
    score: NDArray[np.floating]
    label: NDArray[np.intp]


@dataclass(frozen=True)
class Graph:
    """What can be seen of a graph.

    Parameters
    ----------
    inputs, outputs : names
    values : the outputs of a dry run
    size : (width, height) of the input, px
    metadata : what the exporter wrote into the file
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    values: tuple[NDArray[np.floating], ...]
    size: Size
    metadata: Mapping[str, str] = field(default_factory=dict)

    @property
    def shapes(self) -> tuple[tuple[int, ...], ...]:
        """Shapes of the outputs."""
        return tuple(np.shape(value) for value in self.values)

    def table(self) -> NDArray[np.floating]:
        """The one output without its batch axis, [rows, columns]; empty where there are several, or it is not a table.

        Maps of five axes beside it (the undecoded heads that old YOLOv5 exports add) do not count.
        """
        tables = [value for value in self.values if value.ndim < 5]
        if len(tables) != 1 or tables[0].ndim != 3 or len(tables[0]) != 1:
            return np.zeros((0, 0))
        return tables[0][0]


@dataclass(frozen=True)
class Layout:
    """One way detectors are exported.

    Parameters
    ----------
    name : as `--layout` takes it
    graph : what the graph looks like, for people
    matches : whether a graph is of this layout
    decode : outputs, input size, classes to look for, score floor -> Candidates at or above the floor
    classes : number of classes, from the output shapes; None where they do not show it
    reads : names of the outputs to read, in the order `decode` takes them; all of them by default
    names : class names of models that carry none
    dense : the graph gives a score for every place of the image, so that scores of exactly zero everywhere mean a
        broken graph
    fitting, fill, normalization : what the input is made of
    threshold : score above which a single detection is credible
    """

    name: str
    graph: str
    matches: Callable[[Graph], bool]
    decode: Callable[[Outputs, Size, NDArray[np.intp], float], Candidates]
    classes: Callable[[Shapes], int | None] = lambda shapes: None
    reads: tuple[str, ...] = ()
    names: tuple[str, ...] = COCO
    dense: bool = False
    fitting: Fitting = "center"
    fill: int = 114
    normalization: Normalization = RGB_UNIT
    threshold: float = 0.4


def in_bgr(layout: Layout) -> Layout:
    """Return the layout for weights trained on blue, green, red; a graph does not show this, so it must be named.

    PaddleDetection trains PicoDet on red, green, blue, but its demos (deploy/third_engine/demo_onnxruntime) and what
    was trained after them feed OpenCV's order, with mean and deviation in that order.
    """
    return replace(
        layout,
        name=f"{layout.name}-bgr",
        graph=f"as {layout.name}, for weights trained on blue, green, red; by --layout only",
        matches=lambda graph: False,
        normalization=layout.normalization.reversed,
    )


@cache
def cells(size: Size, strides: tuple[int, ...] = (8, 16, 32)) -> list[NDArray[np.float64]]:
    """Top left corner (x, y) of the grid cells of each stride, row by row, in cells: one [n, 2] for each stride."""
    grids = []
    for stride in strides:
        columns, rows = -(-size[0] // stride), -(-size[1] // stride)
        grids.append(np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), -1).reshape(-1, 2).astype(float))
    return grids


@cache
def cell_table(size: Size, strides: tuple[int, ...] = (8, 16, 32)) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Corner [n, 2], in cells, and stride [n, 1] of the grid cells of all strides, one stride after another."""
    grids = cells(size, strides)
    each = [np.full((len(grid), 1), float(stride)) for grid, stride in zip(grids, strides, strict=True)]
    return np.concatenate(grids), np.concatenate(each)


def cell_count(size: Size, strides: tuple[int, ...] = (8, 16, 32)) -> int:
    """Number of grid cells of all strides together.

    >>> cell_count((416, 416)), cell_count((640, 640))
    (3549, 8400)
    """
    return sum(len(grid) for grid in cells(size, strides))


def pyramid_of(rows: int, size: Size) -> tuple[int, ...]:
    """Return the strides whose cells are this many; ValueError where there are none.

    >>> pyramid_of(8400, (640, 640))
    (8, 16, 32)
    """
    for strides in PYRAMIDS:
        if cell_count(size, strides) == rows:
            return strides
    raise ValueError(f"{rows} rows are the cells of no pyramid at {size[0]} x {size[1]} px")


def is_dense(rows: int, size: Size) -> bool:
    """Whether this is the number of cells of a pyramid in use, or of three anchors in each."""
    return any(rows in (count, 3 * count) for count in (cell_count(size, strides) for strides in PYRAMIDS))


def are_shares(values: NDArray[np.floating]) -> bool:
    """Whether all values are between 0 and 1, as scores are and logits or lengths are not."""
    return bool(values.size == 0 or (np.min(values) > -1e-3 and np.max(values) < 1 + 1e-3))


def best_of(
    scores: NDArray[np.floating], wanted: NDArray[np.intp], floor: float
) -> tuple[NDArray[np.intp], NDArray[np.floating], NDArray[np.intp]]:
    """Rows of scores [n, classes] whose best wanted class reaches the floor, that score, and that class.

    Even if another class wins, the best of the wanted classes is evidence for a vehicle.
    """
    scores = scores[:, wanted]
    rows = np.flatnonzero(scores.max(axis=1, initial=-np.inf) >= floor)
    scores = scores[rows]
    best = scores.argmax(axis=1)
    return rows, scores[np.arange(len(rows)), best], wanted[best]


def around(center: NDArray[np.floating], size: NDArray[np.floating]) -> NDArray[np.floating]:
    """Centers and sizes [n, 2] -> boxes [n, 4]."""
    return np.concatenate([center - size / 2, center + size / 2], axis=1)


def listed(
    box: NDArray[np.floating],
    score: NDArray[np.floating],
    label: NDArray[np.floating],
    wanted: NDArray[np.intp],
    floor: float,
) -> Candidates:
    """Candidates of graphs that list detections: boxes [n, 4], scores [n], class numbers [n]."""
    places = np.rint(label).astype(np.intp)
    rows = np.flatnonzero((score >= floor) & np.isin(places, wanted))
    return Candidates(box[rows], score[rows], places[rows])


def classes_along(axis: int, others: int, output: int = 0) -> Callable[[Shapes], int]:
    """Count classes by one axis of an output [1, rows, columns] that holds `others` beside them.

    The function returned raises ValueError where the output has no room for classes.

    >>> classes_along(2, 5)([(1, 3549, 85)])
    80
    """

    def count(shapes: Shapes) -> int:
        if len(shapes[output]) != 3 or shapes[output][axis] <= others:
            raise ValueError(f"no classes along axis {axis} of {shapes[output]}")
        return shapes[output][axis] - others

    return count
