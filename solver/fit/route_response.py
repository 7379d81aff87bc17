"""How single gauges answer single vehicles as the route's coefficients move, in machine code."""

from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from solver.fit.acting_rows import acting
from solver.ground.compiled import compiled
from solver.ground.lanes import LANES, put
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
        points = places.shape[1]
        weights, ratios = others[:, : 3 * points].unflatten(1, (points, 3)), others[:, 3 * points :, None]
        by_weight = torch.cat([weights, ratios], 2) if ratios.numel() else weights
        turned = local.by_weight.permute(3, 0, 2, 1)
        if ratios.numel():
            turned = torch.cat([turned, local.by_ratio.permute(0, 2, 1)[None]])
        near = places.any(1) | others.unflatten(2, (-1, 3)).any(3).any(1)
        #: First channel that each coefficient moves, and that after the last, [coefficient, 2].
        self._near = acting(near.T).numpy()
        #: Derivatives by points [3, row, point, channel], by weights and ratio [3 or 4, row, point, channel], and of
        #: these by coefficients: [coefficient, point, channel] and [coefficient, 3, 3 or 4, point, channel].
        self._given = local.by_point.permute(3, 0, 2, 1).contiguous().numpy(), turned.contiguous().numpy()
        factors = by_weight.unflatten(3, (-1, 3)).permute(3, 4, 2, 1, 0)
        self._factors = places.permute(2, 1, 0).contiguous().numpy(), factors.contiguous().numpy()
        self._scale = local.amplitude.contiguous().numpy()

    def maps(self, some: slice, sample: Tensor, samples: int) -> Tensor:
        """Derivatives [3 coefficient, sample, channel] by some coefficients; `sample` is that of each row."""
        (point, turned), (places, factors) = self._given, self._factors
        out = np.zeros((3 * len(places[some]), samples, point.shape[3]))
        at = sample.contiguous().numpy()
        add_maps(point, turned, places[some], factors[some], self._near[some], self._scale, at, out)
        return torch.from_numpy(out)


@partial(compiled, fastmath=True)
def add_maps(
    point: Array,
    turned: Array,
    places: Array,
    factors: Array,
    near: NDArray[np.int64],
    scale: Array,
    at: NDArray[np.int64],
    out: Array,
) -> None:
    """Add how maps change with coefficients.

    Parameters
    ----------
    point, turned, places, factors, near : as in `RouteResponse`
    scale, at : [row], amplitude and sample
    out : [3 coefficient, sample, channel]
    """
    points, channels, kinds = point.shape[2], point.shape[3], 1 + len(turned)
    total, by = np.empty(channels), np.empty(points * kinds * LANES)
    for number in range(len(places)):
        for begin in range(near[number, 0], near[number, 1], LANES):
            count = min(LANES, near[number, 1] - begin)
            # Whole vectors of the processor: what is beyond has factors of zero.
            count = min((count + 7) // 8 * 8, channels)
            first = min(begin, channels - count)
            for i in range(3):
                for p in range(points):
                    put(places[number, p, first:], by[p * kinds * LANES :], count)
                    for j in range(len(turned)):
                        put(factors[number, i, j, p, first:], by[(p * kinds + 1 + j) * LANES :], count)
                for one in range(points * kinds):
                    # Channels that those before began with.
                    by[one * LANES : one * LANES + begin - first] = 0
                by_row(point[i], turned, by, first, count, total, scale, at, out[3 * number + i])


@partial(compiled, fastmath=True)
def by_row(
    point: Array,
    turned: Array,
    by: Array,
    first: int,
    count: int,
    total: Array,
    scale: Array,
    at: NDArray[np.int64],
    out: Array,
) -> None:
    """Add how a map [sample, channel] changes with one number of the route, from some channel on.

    Parameters
    ----------
    point : [row, point, channel]
    by : [point, 1 + len(turned), LANES], flat: derivatives of points and weights by it
    total : [channel], to work in
    """
    rows, points = point.shape[:2]
    kinds = 1 + len(turned)
    for row in range(rows):
        total[:count] = 0
        for p in range(points):
            factors, moved = by[p * kinds * LANES :], point[row, p, first:]
            x, y, z = turned[0, row, p, first:], turned[1, row, p, first:], turned[2, row, p, first:]
            for k in range(count):
                total[k] += (
                    moved[k] * factors[k]
                    + x[k] * factors[LANES + k]
                    + y[k] * factors[2 * LANES + k]
                    + z[k] * factors[3 * LANES + k]
                )
            if kinds == 5:
                ratio = turned[3, row, p, first:]
                for k in range(count):
                    total[k] += ratio[k] * factors[4 * LANES + k]
        to, size = out[at[row], first:], scale[row]
        for k in range(count):
            to[k] += size * total[k]
