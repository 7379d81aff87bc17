"""Sums over gauges and wheels of what a tabulated law adds to Boussinesq's, in machine code."""

from functools import partial

import numpy as np
from numpy.typing import NDArray

from solver.ground.cell_values import raised, raised_slopes
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
    point, weight, place, share, velocity : as of `solver.ground.ground_law.Placed`
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


@partial(compiled, fastmath=True)
def add_table_derivatives(
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
    spread: float,
    by_point: Array,
    by_wheel: Array,
    by_velocity: Array,
) -> None:
    """Add the derivatives of `add_table`'s sums with respect to all its arguments.

    Parameters
    ----------
    point, weight, place, share, velocity, away, parabolas, edges, step, length : see there
    spread : change of Poisson's ratio by which `away` grows by 1
    by_point, by_wheel, by_velocity : as of `solver.ground.wheel_motion.Derivatives`
    """
    wheels, rows = share.shape
    points, channels = point.shape[2:]
    columns, row = len(parabolas) // (len(edges) - 1), 0
    cells, last, sums = np.empty((columns, 24)), float(columns), np.empty(9)
    scale, inverse = 0.5 / step, 1 / length**2
    for k in range(channels):
        for p in range(points):
            depth = point[2, 0, p, k] / length
            if not edges[row] <= depth < edges[row + 1]:
                row = min(max(int(np.searchsorted(edges, depth, side="right")) - 1, 0), len(edges) - 2)
            size = edges[row + 1] - edges[row]
            x = min(max((depth - edges[row]) / size, 0.0), 1.0)
            deeper = 1 / (size * length) if edges[0] <= depth <= edges[-1] else 0.0
            for column in range(columns):
                raised_slopes(parabolas[row * columns + column], x, away[p, k], cells[column])
            wx, wy, wz = weight[0, 0, p, k], weight[1, 0, p, k], weight[2, 0, p, k] * length
            for r in range(rows):
                vx, vy, w_speed = velocity[0, r], velocity[1, r], wx * velocity[0, r] + wy * velocity[1, r]
                sums[:] = 0
                for wheel in range(wheels):
                    h, g = point[0, 0, p, k] - place[0, wheel, r], point[1, 0, p, k] - place[1, wheel, r]
                    square, size = 1 + (h * h + g * g) * inverse, share[wheel, r] * inverse
                    t = np.log(square) * scale
                    column = min(int(t), columns - 1)
                    y, c = min(t, last) - column, cells[column]
                    far = inverse / square
                    passed, along = -(h * vx + g * vy) * far, wx * h + wy * g
                    a = c[0] + y * (c[1] + y * (c[2] + y * c[3]))
                    a1 = (c[1] + y * (2 * c[2] + y * 3 * c[3])) / step
                    b1 = (c[5] + y * (2 * c[6] + y * 3 * c[7])) / step
                    # The table is constant beyond its last column.
                    a2, b2, a0 = 0.0, 0.0, 0.0
                    if t <= last:
                        a2, b2 = (2 * c[2] + y * 6 * c[3]) / step**2, (2 * c[6] + y * 6 * c[7]) / step**2
                        a0 = a1
                    by_passed = along * a1 + wz * b1
                    by_t = passed * (along * a2 + wz * b2) - w_speed * a0
                    turned = far * (by_t - 2 * passed * by_passed)
                    gx = size * (wx * a1 * passed - vx * far * by_passed + h * turned)
                    gy = size * (wy * a1 * passed - vy * far * by_passed + g * turned)
                    sums[0] += size * (h * a1 * passed - vx * a)
                    sums[1] += size * (g * a1 * passed - vy * a)
                    sums[2] += size * b1 * passed * length
                    sums[3] += gx
                    sums[4] += gy
                    for way in range(2):
                        d = c[8 + 8 * way :]
                        level = d[0] + y * (d[1] + y * (d[2] + y * d[3]))
                        rise = (d[1] + y * (2 * d[2] + y * 3 * d[3])) / step
                        fall = (d[5] + y * (2 * d[6] + y * 3 * d[7])) / step
                        sums[5 + way] += size * (passed * (along * rise + wz * fall) - w_speed * level)
                    sums[7] -= size * (wx * a + h * far * by_passed)
                    sums[8] -= size * (wy * a + g * far * by_passed)
                    by_wheel[0, wheel, r, k] -= gx
                    by_wheel[1, wheel, r, k] -= gy
                    by_wheel[2, wheel, r, k] += (passed * by_passed - w_speed * a) * inverse
                for i in range(5):
                    by_point[i, r, p, k] += sums[i]
                by_point[5, r, p, k] += deeper * sums[5]
                by_point[6, r, p, k] += sums[6] / spread
                by_velocity[0, r, k] += sums[7]
                by_velocity[1, r, k] += sums[8]
