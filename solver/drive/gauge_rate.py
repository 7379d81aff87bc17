"""Strain rate of gauges that a car goes by, in machine code: ends of gauges and axles in one pass over memory."""

from functools import cache
from typing import Any

import numpy as np

from solver.ground.compiled import compiled


@cache
def gauge_rates() -> Any:
    """Compile `rates`, at the first call."""
    return compiled(rates)


def rates(
    cell: Any,
    sample: Any,
    shift: Any,
    points: Any,
    along: Any,
    across: Any,
    place: Any,
    velocity: Any,
    cells: Any,
    rest: Any,
    axles: Any,
    depth: float,
    softness: float,
    found: Any,
) -> None:
    """Difference of the displacement rates at the ends of gauges, along the path at each, into `found` [value].

    Parameters
    ----------
    cell, sample : of the path, and of the record [value]
    shift : m by which the gauge lies to the right of the path [value]
    points, along, across : of the path, m, and its unit vectors [cell, 2]
    place, velocity : of the car, m and m/s [sample, 2]
    cells, rest : to each end of a gauge from its middle, and m beyond that [end]
    axles : m ahead of the car, and share of its weight [axle, 2]
    depth : of the fiber, m
    softness : 1 - 2 nu

    The displacement rate is that of `solver.ground.boussinesq.displacement_rate`.
    """
    last = len(points) - 1
    for n in range(len(cell)):
        vx, vy = velocity[sample[n], 0], velocity[sample[n], 1]
        speed = max(np.sqrt(vx * vx + vy * vy), 1e-6)
        total = 0.0
        for end in range(2):
            number = min(max(cell[n] + cells[end], 0), last)
            tx, ty = along[number, 0], along[number, 1]
            dx = points[number, 0] + rest[end] * tx + shift[n] * across[number, 0] - place[sample[n], 0]
            dy = points[number, 1] + rest[end] * ty + shift[n] * across[number, 1] - place[sample[n], 1]
            projected = vx * tx + vy * ty
            sign = 1.0 if end == 0 else -1.0
            for axle in range(len(axles)):
                x = dx - axles[axle, 0] * vx / speed
                y = dy - axles[axle, 0] * vy / speed
                square = x * x + y * y + depth * depth
                r = np.sqrt(square)
                inverse2 = 1 / square
                inverse = r * inverse2
                shallow = inverse / (r + depth)
                a = depth * inverse * inverse2 - softness * shallow
                da = softness * (2 * r + depth) * shallow * shallow - 3 * depth * inverse2 * inverse2
                approach = (x * vx + y * vy) * inverse
                total -= sign * axles[axle, 1] * (projected * a + (x * tx + y * ty) * approach * da)
        found[n] = total
