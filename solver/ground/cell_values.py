"""Values of a table of bicubic cells at many points, and their derivatives, in machine code."""

import numpy as np
from numpy.typing import NDArray

from solver.ground.compiled import compiled

Array = NDArray[np.float64]


@compiled
def placed(
    square: float, depth: float, edges: Array, columns: int, step: float, near: int
) -> tuple[int, int, float, float, float]:
    """Row of cells, cell, position in it (0 to 1) in depth and in t, and the derivative of t, in steps, by `square`.

    `near` is a row in which it may be: points one after the other are mostly about as deep.
    """
    row = near
    if not edges[row] <= depth < edges[row + 1]:
        row = min(max(int(np.searchsorted(edges, depth, side="right")) - 1, 0), len(edges) - 2)
    x = min(max((depth - edges[row]) / (edges[row + 1] - edges[row]), 0.0), 1.0)
    t = np.log1p(square) * (0.5 / step)
    column = min(int(t), columns - 1)
    passed = 0.5 / (step * (1 + square)) if t <= columns else 0.0
    return row, row * columns + column, x, min(t, float(columns)) - column, passed


@compiled
def values_at(square: Array, depth: Array, away: Array, parabolas: Array, edges: Array, step: float) -> Array:
    """Values [4, point], see `response_table.looked_up`: half the work of `interpolated`."""
    columns, value, by_t, row = len(parabolas) // (len(edges) - 1), np.empty((4, len(square))), np.empty(8), 0
    for point in range(len(square)):
        row, number, x, y, _ = placed(square[point], depth[point], edges, columns, step, row)
        raised(parabolas[number], x, away[point], by_t)
        for which in range(2):
            c0, c1, c2, c3 = by_t[4 * which], by_t[4 * which + 1], by_t[4 * which + 2], by_t[4 * which + 3]
            value[2 * which, point] = c0 + y * (c1 + y * (c2 + y * c3))
            value[2 * which + 1, point] = (c1 + y * (2 * c2 + y * 3 * c3)) / step
    return value


@compiled
def raised(cell: Array, x: float, away: float, by_t: Array) -> None:
    """Set the coefficients `by_t` [8] of powers of t: of u_r / r, then of u_z.

    Parameters
    ----------
    cell : [power of `away`, 32]
    x : depth in the cell, 0 to 1
    away : Poisson's ratio, from the middle one
    """
    base = cell[0]
    for k in range(8):
        # Neighbors in memory, so that the processor works on all eight at once.
        if len(cell) == 1:
            h0, h1, h2, h3 = base[k], base[8 + k], base[16 + k], base[24 + k]
        else:
            line, bow = cell[1], cell[2]
            h0 = base[k] + away * (line[k] + away * bow[k])
            h1 = base[8 + k] + away * (line[8 + k] + away * bow[8 + k])
            h2 = base[16 + k] + away * (line[16 + k] + away * bow[16 + k])
            h3 = base[24 + k] + away * (line[24 + k] + away * bow[24 + k])
        by_t[k] = h0 + x * (h1 + x * (h2 + x * h3))


@compiled
def raised_slopes(cell: Array, x: float, away: float, by_t: Array) -> None:
    """The same in the first eight of `by_t` [24], then derivatives by `x` and by `away`."""
    base = cell[0]
    if len(cell) == 1:
        for k in range(8):
            h1, h2, h3 = base[8 + k], base[16 + k], base[24 + k]
            by_t[k] = base[k] + x * (h1 + x * (h2 + x * h3))
            by_t[8 + k], by_t[16 + k] = h1 + x * (2 * h2 + x * 3 * h3), 0.0
        return
    line, bow = cell[1], cell[2]
    for k in range(8):
        h1 = base[8 + k] + away * (line[8 + k] + away * bow[8 + k])
        h2 = base[16 + k] + away * (line[16 + k] + away * bow[16 + k])
        h3 = base[24 + k] + away * (line[24 + k] + away * bow[24 + k])
        by_t[k] = base[k] + away * (line[k] + away * bow[k]) + x * (h1 + x * (h2 + x * h3))
        by_t[8 + k] = h1 + x * (2 * h2 + x * 3 * h3)
        t0, t1 = line[k] + 2 * away * bow[k], line[8 + k] + 2 * away * bow[8 + k]
        t2, t3 = line[16 + k] + 2 * away * bow[16 + k], line[24 + k] + 2 * away * bow[24 + k]
        by_t[16 + k] = t0 + x * (t1 + x * (t2 + x * t3))


@compiled
def interpolated(
    square: Array, depth: Array, away: Array, parabolas: Array, edges: Array, step: float
) -> tuple[Array, Array]:
    """Values [4, point], see `looked_up`, and their derivatives [4, 3, point] by the first three arguments."""
    columns, by_t, row = len(parabolas) // (len(edges) - 1), np.empty(24), 0
    value, slope = np.empty((4, len(square))), np.empty((4, 3, len(square)))
    for point in range(len(square)):
        row, number, x, y, passed = placed(square[point], depth[point], edges, columns, step, row)
        within = 1 / (edges[row + 1] - edges[row]) if edges[0] <= depth[point] <= edges[-1] else 0.0
        raised_slopes(parabolas[number], x, away[point], by_t)
        for which in range(2):
            for way in range(3):
                at = 8 * way + 4 * which
                c0, c1, c2, c3 = by_t[at], by_t[at + 1], by_t[at + 2], by_t[at + 3]
                height, rise = c0 + y * (c1 + y * (c2 + y * c3)), (c1 + y * (2 * c2 + y * 3 * c3)) / step
                if way == 0:
                    value[2 * which, point], value[2 * which + 1, point] = height, rise
                    slope[2 * which, 0, point] = rise * step * passed
                    slope[2 * which + 1, 0, point] = (2 * c2 + y * 6 * c3) / step * passed
                else:
                    size = within if way == 1 else 1.0
                    slope[2 * which, way, point], slope[2 * which + 1, way, point] = size * height, size * rise
    return value, slope


@compiled
def interpolated_back(
    square: Array, depth: Array, away: Array, parabolas: Array, edges: Array, by_value: Array, step: float
) -> Array:
    """Gradient [cell, power, 32] by `parabolas`, from the gradient by the values, `by_value` [4, point]."""
    columns, out, row = len(parabolas) // (len(edges) - 1), np.zeros_like(parabolas), 0
    for point in range(len(square)):
        row, number, x, y, _ = placed(square[point], depth[point], edges, columns, step, row)
        for a_power in range(parabolas.shape[1]):
            for x_power in range(4):
                share = away[point] ** a_power * x**x_power
                for which in range(2):
                    value, rise = by_value[2 * which, point], by_value[2 * which + 1, point] / step
                    at = 8 * x_power + 4 * which
                    out[number, a_power, at] += share * value
                    out[number, a_power, at + 1] += share * (y * value + rise)
                    out[number, a_power, at + 2] += share * (y * y * value + 2 * y * rise)
                    out[number, a_power, at + 3] += share * (y**3 * value + 3 * y * y * rise)
    return out
