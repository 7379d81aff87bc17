"""Sums over gauges and wheels of what inertia of the ground adds under a moving load, in machine code."""

from functools import partial

import numpy as np
from numpy.typing import NDArray

from solver.ground.compiled import compiled
from solver.ground.lanes import LANES, put

Array = NDArray[np.float64]


@partial(compiled, fastmath=True)
def add_inertia(
    point: Array,
    weight: Array,
    place: Array,
    share: Array,
    velocity: Array,
    kernels: Array,
    slowness: float,
    out: Array,
) -> None:
    """Add what inertia adds to the response of gauges to `out` [row, channel].

    Parameters
    ----------
    point, weight, place, share, velocity : as of `solver.ground.ground_law.Placed`
    kernels : [9, 2, power], coefficients of powers of c of first and second order in (v / c_s)^2, see `summed_kernels`
    slowness : 1 / c_s^2, s^2/m^2

    Notes
    -----
    As of `solver.ground.moving.moving_displacement_rate`, in real numbers: p = (px, py), q = p turned into the frame of
    the load's travel, times its speed.
    """
    wheels, rows = share.shape
    points, channels = point.shape[2:]
    powers = kernels.shape[2]
    by, given, moved = np.empty((9, powers)), np.ones(6 * LANES), np.empty(LANES)
    for row in range(rows):
        vx, vy = velocity[0, row], velocity[1, row]
        speed2 = vx * vx + vy * vy
        for number in range(9):
            for power in range(powers):
                by[number, power] = kernels[number, 0, power] + slowness * speed2 * kernels[number, 1, power]
        for p in range(points):
            for first in range(0, channels, LANES):
                count = min(LANES, channels - first)
                for i in range(3):
                    put(point[i, 0, p, first:], given[i * LANES :], count)
                    put(weight[i, 0, p, first:], given[(3 + i) * LANES :], count)
                moved[:count] = 0
                for wheel in range(wheels):
                    x, y, w = place[0, wheel, row], place[1, wheel, row], share[wheel, row]
                    add_wheel_inertia(given, x, y, w, vx, vy, slowness, by, count, moved)
                for k in range(count):
                    out[row, first + k] += moved[k]


@partial(compiled, fastmath=True)
def add_wheel_inertia(
    given: Array, at: float, aside: float, w: float, vx: float, vy: float, slow: float, by: Array, last: int, out: Array
) -> None:
    """Add what one wheel adds at channels before the `last` to `out` [channel]; `given` [6 * LANES]: point, weight.

    Parameters
    ----------
    at, aside, w : place and share of the wheel
    vx, vy : velocity
    slow : as of `add_inertia`
    by : [9, power], kernels at this velocity
    """
    speed2 = vx * vx + vy * vy
    for k in range(last):
        x, y, z = given[k] - at, given[LANES + k] - aside, given[2 * LANES + k]
        dx, dy, dz = given[3 * LANES + k], given[4 * LANES + k], given[5 * LANES + k]
        i = 1 / np.sqrt(x * x + y * y + z * z)
        c = z * i
        reach = i / (1 + c)
        px, py = x * reach, y * reach
        qx, qy = (x * vx + y * vy) * reach, (y * vx - x * vy) * reach
        q2x, q2y = qx * qx - qy * qy, 2 * qx * qy
        q3x, q3y = q2x * qx - q2y * qy, q2x * qy + q2y * qx
        q4x, q4y = q2x * q2x - q2y * q2y, 2 * q2x * q2y
        q5x, q5y = q4x * qx - q4y * qy, q4x * qy + q4y * qx
        w1, w3, w5 = by[0, 7], by[1, 7], by[2, 7]
        v0, v2, v4 = by[3, 7], by[4, 7], by[5, 7]
        o2, o4, o6 = by[6, 7], by[7, 7], by[8, 7]
        for power in range(6, -1, -1):
            w1, w3, w5 = w1 * c + by[0, power], w3 * c + by[1, power], w5 * c + by[2, power]
            v0, v2, v4 = v0 * c + by[3, power], v2 * c + by[4, power], v4 * c + by[5, power]
            o2, o4, o6 = o2 * c + by[6, power], o4 * c + by[7, power], o6 * c + by[8, power]
        down = speed2 * qx * w1 - q3x * w3 + q5x * w5
        # Along the load, and outward from it.
        lx = speed2 * v0 - q2x * v2 + q4x * v4
        ly = q2y * v2 - q4y * v4
        ox = -speed2 * qx * o2 + q3x * o4 - q5x * o6
        oy = -speed2 * qy * o2 + q3y * o4 - q5y * o6
        hx = -(vx * lx - vy * ly + px * ox - py * oy)
        hy = -(vx * ly + vy * lx + px * oy + py * ox)
        out[k] += w * slow * i * i * (dx * hx + dy * hy + dz * down)
