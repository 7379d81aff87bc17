"""How single gauges answer single vehicles as the route's coefficients move, in machine code."""

from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from solver.fit.acting_rows import acting
from solver.ground.compiled import compiled
from solver.signal_path.sensitivities import Sensitivities

Array = NDArray[np.float64]


class RouteResponse:
    """Derivatives of a map by the coefficients of a route, each of which moves the channels near its knot alone.

    Parameters
    ----------
    local : derivatives of each gauge by its points and their weights
    places : [channel, point, coefficient], derivatives of the points, the same in each dimension
    others : [channel, 3 point (+ point), 3 coefficient], of the weights and, if there is one, the change of Poisson's
        ratio
    """

    def __init__(self, local: Sensitivities, places: Tensor, others: Tensor):
        channels, points, count = places.shape
        moved = places.ne(0) | others[:, : 3 * points].ne(0).view(channels, points, 3, count, 3).any(-1).any(2)
        if others.shape[1] > 3 * points:
            moved |= others[:, 3 * points :].ne(0).view(channels, points, count, 3).any(-1)
        #: First coefficient that moves each point, and that after the last, [channel, point, 2].
        self._near = acting(moved.flatten(0, 1)).view(channels, points, 2).numpy()
        #: Derivatives by points and by weights, each [3, row, point, channel], and by the ratio [row, point, channel].
        point, weight = (one.permute(3, 0, 2, 1).contiguous().numpy() for one in (local.by_point, local.by_weight))
        self._given: tuple[Array, Array, Array] = point, weight, local.by_ratio.permute(0, 2, 1).contiguous().numpy()
        self._factors: tuple[Array, Array] = places.contiguous().numpy(), others.contiguous().numpy()
        self._scale = local.amplitude.contiguous().numpy()

    def maps(self, some: slice, sample: Tensor, samples: int) -> Tensor:
        """Derivatives [3 coefficient, sample, channel] by some coefficients; `sample` is that of each row."""
        first, last, _ = some.indices(self._factors[0].shape[2])
        out = np.zeros((3 * (last - first), samples, len(self._near)))
        near, at = self._near.clip(first, last), sample.contiguous().numpy()
        add_maps(*self._given, *self._factors, near, first, self._scale, at, out)
        return torch.from_numpy(out)


@partial(compiled, fastmath=True)
def add_maps(
    point: Array,
    weight: Array,
    ratio: Array,
    places: Array,
    others: Array,
    near: NDArray[np.int64],
    base: int,
    scale: Array,
    at: NDArray[np.int64],
    out: Array,
) -> None:
    """Add how maps change with coefficients from number `base` on.

    Parameters
    ----------
    point, weight, ratio, places, others, near : as in `RouteResponse`
    scale, at : [row], amplitude and sample
    out : [3 coefficient, sample, channel]
    """
    _, rows, points, channels = point.shape
    graded, total = others.shape[1] > 3 * points, np.zeros((channels, len(out)))
    reached = np.empty((channels, 2), np.int64)
    for c in range(channels):
        begun, ended = len(out), 0
        for p in range(points):
            if near[c, p, 0] < near[c, p, 1]:
                begun, ended = min(begun, 3 * (near[c, p, 0] - base)), max(ended, 3 * (near[c, p, 1] - base))
        reached[c, 0], reached[c, 1] = begun, ended
    for row in range(rows):
        for p in range(points):
            for c in range(channels):
                begun, ended = near[c, p]
                if begun >= ended:
                    continue
                x, y, z = weight[0, row, p, c], weight[1, row, p, c], weight[2, row, p, c]
                for k in range(3 * begun, 3 * ended):
                    of = x * others[c, 3 * p, k] + y * others[c, 3 * p + 1, k] + z * others[c, 3 * p + 2, k]
                    total[c, k - 3 * base] += of
                if graded:
                    for k in range(3 * begun, 3 * ended):
                        total[c, k - 3 * base] += ratio[row, p, c] * others[c, 3 * points + p, k]
                x, y, z = point[0, row, p, c], point[1, row, p, c], point[2, row, p, c]
                for k in range(begun, ended):
                    to = 3 * (k - base)
                    total[c, to] += x * places[c, p, k]
                    total[c, to + 1] += y * places[c, p, k]
                    total[c, to + 2] += z * places[c, p, k]
        for c in range(channels):
            for k in range(reached[c, 0], reached[c, 1]):
                out[k, at[row], c] += scale[row] * total[c, k]
                total[c, k] = 0
