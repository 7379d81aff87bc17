"""Sums over gauges and wheels of what inertia of the ground adds under a moving load, in machine code."""

from functools import partial

import numpy as np
from numpy.typing import NDArray

from solver.ground.compiled import compiled
from solver.ground.lanes import LANES, add, put

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


@partial(compiled, fastmath=True)
def add_inertia_derivatives(
    point: Array,
    weight: Array,
    place: Array,
    share: Array,
    velocity: Array,
    kernels: Array,
    by_ratio: Array,
    slowness: float,
    by_point: Array,
    by_wheel: Array,
    by_velocity: Array,
) -> None:
    """Add the derivatives of `add_inertia`'s sums with respect to all but kernels and slowness.

    Parameters
    ----------
    point, weight, place, share, velocity, kernels, slowness : see there
    by_ratio : of the kernels, by Poisson's ratio
    by_point, by_wheel, by_velocity : as of `solver.ground.wheel_motion.Derivatives`
    """
    wheels, rows = share.shape
    points, channels = point.shape[2:]
    powers = kernels.shape[2]
    # Kernels at a velocity, and their derivatives by the square of the speed, by c, and by Poisson's ratio.
    by = np.zeros((4, 9, powers))
    given, found = np.ones(6 * LANES), np.empty(12 * LANES)
    for row in range(rows):
        vx, vy = velocity[0, row], velocity[1, row]
        growth = slowness * (vx * vx + vy * vy)
        for number in range(9):
            for n in range(powers):
                by[0, number, n] = kernels[number, 0, n] + growth * kernels[number, 1, n]
                by[1, number, n] = slowness * kernels[number, 1, n]
                by[3, number, n] = by_ratio[number, 0, n] + growth * by_ratio[number, 1, n]
            for n in range(powers - 1):
                by[2, number, n] = (n + 1) * by[0, number, n + 1]
        for p in range(points):
            for first in range(0, channels, LANES):
                count = min(LANES, channels - first)
                for i in range(3):
                    put(point[i, 0, p, first:], given[i * LANES :], count)
                    put(weight[i, 0, p, first:], given[(3 + i) * LANES :], count)
                found[: 9 * LANES] = 0
                for wheel in range(wheels):
                    x, y, w = place[0, wheel, row], place[1, wheel, row], share[wheel, row]
                    add_wheel_derivatives(given, x, y, w, vx, vy, slowness, by, count, found)
                    for i in range(3):
                        add(found[(9 + i) * LANES :], by_wheel[i, wheel, row, first:], count)
                for i in range(7):
                    add(found[i * LANES :], by_point[i, row, p, first:], count)
                for i in range(2):
                    add(found[(7 + i) * LANES :], by_velocity[i, row, first:], count)


@partial(compiled, fastmath=True)
def add_wheel_derivatives(
    given: Array, at: float, aside: float, w: float, vx: float, vy: float, slow: float, by: Array, last: int, out: Array
) -> None:
    """Derivatives of what one wheel adds at channels before the `last`, as of `solver.ground.wheel_motion.add_wheel`.

    Parameters
    ----------
    given, at, aside, w, vx, vy, slow : as of `add_wheel_inertia`
    by : [4, 9, power], kernels and their derivatives by the square of the speed, by c, and by Poisson's ratio
    out : [12 * LANES]

    Notes
    -----
    Backward through `add_wheel_inertia`: `g_...` are derivatives of weight . (hx, hy, down). A gradient by a power of
    q, as a complex number, is one by q times n conj(q^(n-1)).
    """
    speed2 = vx * vx + vy * vy
    k, told = np.empty(9), np.empty(9)
    for lane in range(last):
        x, y, z = given[lane] - at, given[LANES + lane] - aside, given[2 * LANES + lane]
        dx, dy, dz = given[3 * LANES + lane], given[4 * LANES + lane], given[5 * LANES + lane]
        i = 1 / np.sqrt(x * x + y * y + z * z)
        c = z * i
        reach = i / (1 + c)
        px, py = x * reach, y * reach
        qx, qy = (x * vx + y * vy) * reach, (y * vx - x * vy) * reach
        q2x, q2y = qx * qx - qy * qy, 2 * qx * qy
        q3x, q3y = q2x * qx - q2y * qy, q2x * qy + q2y * qx
        q4x, q4y = q2x * q2x - q2y * q2y, 2 * q2x * q2y
        q5x, q5y = q4x * qx - q4y * qy, q4x * qy + q4y * qx
        for number in range(9):
            k[number] = polynomial(by[0, number], c)
        down = speed2 * qx * k[0] - q3x * k[1] + q5x * k[2]
        lx, ly = speed2 * k[3] - q2x * k[4] + q4x * k[5], q2y * k[4] - q4y * k[5]
        ox = -speed2 * qx * k[6] + q3x * k[7] - q5x * k[8]
        oy = -speed2 * qy * k[6] + q3y * k[7] - q5y * k[8]
        hx = -(vx * lx - vy * ly + px * ox - py * oy)
        hy = -(vx * ly + vy * lx + px * oy + py * ox)
        whole = dx * hx + dy * hy + dz * down
        g_lx, g_ly = -(dx * vx + dy * vy), dx * vy - dy * vx
        g_ox, g_oy = -(dx * px + dy * py), dx * py - dy * px
        g_px, g_py = -(dx * ox + dy * oy), dx * oy - dy * ox
        told[0], told[1], told[2] = dz * speed2 * qx, -dz * q3x, dz * q5x
        told[3], told[4], told[5] = g_lx * speed2, g_ly * q2y - g_lx * q2x, g_lx * q4x - g_ly * q4y
        told[6] = -speed2 * (g_ox * qx + g_oy * qy)
        told[7], told[8] = g_ox * q3x + g_oy * q3y, -(g_ox * q5x + g_oy * q5y)
        g_speed2 = dz * qx * k[0] + g_lx * k[3] - (g_ox * qx + g_oy * qy) * k[6]
        g_c, g_ratio = 0.0, 0.0
        for number in range(9):
            g_speed2 += told[number] * polynomial(by[1, number], c)
            g_c += told[number] * polynomial(by[2, number], c)
            g_ratio += told[number] * polynomial(by[3, number], c)
        g_qx, g_qy = (dz * k[0] - g_ox * k[6]) * speed2, -g_oy * k[6] * speed2
        # Of the square, the cube, and so on, by q.
        ax, ay = -2 * g_lx * k[4], 2 * g_ly * k[4]
        g_qx, g_qy = g_qx + qx * ax + qy * ay, g_qy + qx * ay - qy * ax
        ax, ay = 3 * (g_ox * k[7] - dz * k[1]), 3 * g_oy * k[7]
        g_qx, g_qy = g_qx + q2x * ax + q2y * ay, g_qy + q2x * ay - q2y * ax
        ax, ay = 4 * g_lx * k[5], -4 * g_ly * k[5]
        g_qx, g_qy = g_qx + q3x * ax + q3y * ay, g_qy + q3x * ay - q3y * ax
        ax, ay = 5 * (dz * k[2] - g_ox * k[8]), -5 * g_oy * k[8]
        g_qx, g_qy = g_qx + q4x * ax + q4y * ay, g_qy + q4x * ay - q4y * ax
        g_reach = g_qx * (x * vx + y * vy) + g_qy * (y * vx - x * vy) + g_px * x + g_py * y
        g_c -= g_reach * reach / (1 + c)
        # By 1 / r, the square of it before all included.
        g_i = g_reach / (1 + c) + g_c * z + 2 * whole / i
        scale = w * slow * i * i
        fall = g_i * i * i * i
        gx = scale * (reach * (g_qx * vx - g_qy * vy + g_px) - x * fall)
        gy = scale * (reach * (g_qx * vy + g_qy * vx + g_py) - y * fall)
        out[lane] += scale * hx
        out[LANES + lane] += scale * hy
        out[2 * LANES + lane] += scale * down
        out[3 * LANES + lane] += gx
        out[4 * LANES + lane] += gy
        out[5 * LANES + lane] += scale * (g_c * i - z * fall)
        out[6 * LANES + lane] += scale * g_ratio
        out[7 * LANES + lane] += scale * (2 * vx * g_speed2 + reach * (g_qx * x + g_qy * y) - dx * lx - dy * ly)
        out[8 * LANES + lane] += scale * (2 * vy * g_speed2 + reach * (g_qx * y - g_qy * x) + dx * ly - dy * lx)
        out[9 * LANES + lane] = -gx
        out[10 * LANES + lane] = -gy
        out[11 * LANES + lane] = slow * i * i * whole


@partial(compiled, fastmath=True)
def polynomial(coefficients: Array, c: float) -> float:
    """Its value, of coefficients of eight powers from 0 on."""
    total = coefficients[7]
    for power in range(6, -1, -1):
        total = total * c + coefficients[power]
    return total
