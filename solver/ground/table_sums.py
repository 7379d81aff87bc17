"""Sums over gauges and wheels of what a tabulated law adds to Boussinesq's, in machine code."""

from functools import partial

import numpy as np
from numpy.typing import NDArray

from solver.ground.cell_values import raised
from solver.ground.compiled import compiled

Array = NDArray[np.float64]


@partial(compiled, fastmath=True)
def add_table(
    point: Array,
    weight: Array,
    place: Array,
    share: Array,
    velocity: Array,
    away: Array,
    parabolas: Array,
    edges: Array,
    step: float,
    length: float,
    out: Array,
) -> None:
    """Add what a table adds to the response of gauges to `out` [row, channel]; a point is as deep under all wheels.

    Parameters
    ----------
    point, weight, place, share, velocity : as of `solver.ground.law.Placed`
    away : [point, channel], Poisson's ratio, see `looked_up`
    parabolas, edges, step : the table, see `solver.ground.cell_values`
    length : its unit, m

    Notes
    -----
    As of `solver.ground.corrected_motion.extra_rate`: u_h = h a / L^2, u_z = b / L, t = ln(1 + r^2 / L^2) / 2.
    """
    wheels, rows = share.shape
    points, channels = point.shape[2:]
    columns, row, moved = len(parabolas) // (len(edges) - 1), 0, np.empty(rows)
    cells, last = np.empty((columns, 8)), float(columns)
    scale, inverse, slope = 0.5 / step, 1 / length**2, 1 / (step * length**2)
    for k in range(channels):
        moved[:] = 0
        for p in range(points):
            depth = point[2, 0, p, k] / length
            if not edges[row] <= depth < edges[row + 1]:
                row = min(max(int(np.searchsorted(edges, depth, side="right")) - 1, 0), len(edges) - 2)
            x = min(max((depth - edges[row]) / (edges[row + 1] - edges[row]), 0.0), 1.0)
            for column in range(columns):
                raised(parabolas[row * columns + column], x, away[p, k], cells[column])
            wx, wy, wz = weight[0, 0, p, k] / length**2, weight[1, 0, p, k] / length**2, weight[2, 0, p, k] / length
            for wheel in range(wheels):
                for r in range(rows):
                    h, g = point[0, 0, p, k] - place[0, wheel, r], point[1, 0, p, k] - place[1, wheel, r]
                    vx, vy = velocity[0, r], velocity[1, r]
                    square = 1 + (h * h + g * g) * inverse
                    t = np.log(square) * scale
                    column = min(int(t), columns - 1)
                    y, c = min(t, last) - column, cells[column]
                    passed = -(h * vx + g * vy) * slope / square
                    a = c[0] + y * (c[1] + y * (c[2] + y * c[3]))
                    grown = (c[1] + y * (2 * c[2] + y * 3 * c[3])) * passed
                    sunk = (c[5] + y * (2 * c[6] + y * 3 * c[7])) * passed
                    along = (wx * h + wy * g) * grown - (wx * vx + wy * vy) * a + wz * sunk
                    moved[r] += share[wheel, r] * along
        for r in range(rows):
            out[r, k] += moved[r]
