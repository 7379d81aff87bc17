"""Strain rate of the base model and its derivatives in closed form: several times faster than by autodiff.

Differentiates what `solver.ground.boussinesq.displacement_rate`, `solver.cable.fiber.axial` and
`solver.signal_path.gauge_strain.bend_strain_rates` say; for models with more effects in single rows there is autodiff.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from solver.cable.fiber import STATION_WEIGHTS, turning, unit
from solver.ground.compiled import compiled
from solver.load.load import Load

Array = NDArray[np.float64]

BY_VEHICLE = ("along", "across", "wheelbase", "track", "front_share")
INNER = ("inner", "inner_slope", "inner_bend")


@dataclass(frozen=True)
class Motion:
    """What vehicles of unit amplitude do along given directions at given points, summed over wheels.

    Parameters
    ----------
    motion : [3, row, point], velocity of the ground, 1/(m s)
    by_point : [3, row, point], derivative of its part along the direction by the point's place
    by_poisson : [row, point], the same by Poisson's ratio
    along, across : [row, point], the same by a shift of the vehicle along travel and to its right
    wheelbase, track, front_share : [row, point], the same by the wheel layout; 0 for a vehicle of one wheel
    """

    motion: Tensor
    by_point: Tensor
    by_poisson: Tensor
    along: Tensor
    across: Tensor
    wheelbase: Tensor
    track: Tensor
    front_share: Tensor


def motion_of(point: Tensor, direction: Tensor, load: Load, poisson_ratio: float) -> Motion:
    """Motion under wheels and the derivatives of its part along `direction`.

    Parameters
    ----------
    point, direction : [point, 3], m, and what the motion is multiplied with
    load : of each row, the same for all channels; its wheels as `solver.load.wheel_layout.wheel_loads` orders them
    poisson_ratio : of the ground

    Notes
    -----
    With offset (x, y, z) and load velocity v, h = (x, y), C = h . v, the horizontal response h a, the vertical b:
    motion = -(v a + h C a', C b'), where a' and b' are derivatives by r, over r (Johnson 1985, eq. 3.18).

    >>> from solver.trajectory.trajectory import Trajectory
    >>> v = torch.tensor([[[10.0, 0.0]]], dtype=torch.float64)
    >>> wheel, one = torch.zeros(1, 1, 1, 2, dtype=torch.float64), torch.ones(1, 1, 1, dtype=torch.float64)
    >>> driven = Trajectory(one[0], one[0], wheel[:, :, 0], v, v / 10, torch.zeros(1, dtype=torch.long))
    >>> at = torch.tensor([[3.0, 1.0, 0.9]], dtype=torch.float64)
    >>> from solver.ground.boussinesq import displacement_rate
    >>> load = Load(wheel, one, driven, torch.zeros(1, dtype=torch.long))
    >>> bool(torch.allclose(motion_of(at, at, load, 0.25).motion[:, 0, 0], displacement_rate(at, v[0, 0], 0.25)[0]))
    True
    """

    def columns(values: Tensor) -> Array:
        return np.ascontiguousarray(values.movedim(-1, 0).numpy())

    out = np.zeros((12, len(load.share), len(point)))
    add_wheels(
        columns(point),
        columns(direction),
        columns(load.position[:, 0].transpose(0, 1)),
        columns(load.share[:, 0]),
        columns(load.trajectory.velocity[:, 0]),
        columns(load.trajectory.heading[:, 0]),
        1 - 2 * poisson_ratio,
        out,
    )
    sums = torch.from_numpy(out)
    return Motion(sums[:3], sums[3:6], *sums[6:])


@partial(compiled, fastmath=True)
def add_wheels(
    point: Array,
    direction: Array,
    place: Array,
    share: Array,
    velocity: Array,
    heading: Array,
    softness: float,
    out: Array,
) -> None:
    """Add to the fields of `Motion`, `out` [12, row, point], what each wheel does.

    Parameters
    ----------
    point, direction : [3, point]
    place, share : [2, wheel, row] and [wheel, row]
    velocity, heading : [2, row]
    softness : 1 - 2 nu
    """
    wheels, rows = share.shape
    for row in range(rows):
        vx, vy, hx, hy = velocity[0, row], velocity[1, row], heading[0, row], heading[1, row]
        for wheel in range(wheels):
            w, px, py = share[wheel, row], place[0, wheel, row], place[1, wheel, row]
            # Front wheels first, left before right.
            front = side = 0.0
            if wheels == 4:
                front, side = (0.5 if wheel < 2 else -0.5), (-0.5 if wheel % 2 == 0 else 0.5)
            for k in range(point.shape[1]):
                x, y, z = point[0, k] - px, point[1, k] - py, point[2, k]
                dx, dy, dz = direction[0, k], direction[1, k], direction[2, k]
                i2 = 1 / (x * x + y * y + z * z)
                i = np.sqrt(i2)
                i3 = i2 * i
                s = i / (1 + z * i)
                shallow = i * s
                bulge = i * s * shallow * (2 + z * i)
                soft, lobe = softness * shallow, softness * bulge
                zi3 = z * i3
                z3i5 = 3 * zi3 * i2
                # a, a' = da/dr / r, and a'' = da'/dr / r; b likewise.
                a = zi3 - soft
                a1 = lobe - z3i5
                a2 = 5 * z3i5 * i2 + soft * s * i2 * (2 * i - (2 + z * i) * (3 * i + 2 * s))
                b1 = -(z * z3i5 + (1 + softness) * i3)
                b2 = i2 * (5 * z * z3i5 + 3 * (1 + softness) * i3)
                # Derivatives by depth at constant r.
                a_z = i3 + soft * s
                a1_z = soft * s * i2 - 2 * lobe * s - 3 * i3 * i2
                b1_z = -2 * z3i5
                c = vx * x + vy * y
                reach = c * a1
                along = dx * x + dy * y
                speed = dx * vx + dy * vy
                mx, my, mz = vx * a + x * reach, vy * a + y * reach, c * b1
                inner = along * a1 + dz * b1
                outer = speed * a1 + c * (along * a2 + dz * b2)
                gx = x * outer + vx * inner + dx * reach
                gy = y * outer + vy * inner + dy * reach
                gz = z * outer + speed * a_z + c * (along * a1_z + dz * b1_z)
                ahead, right = w * (gx * hx + gy * hy), w * (gy * hx - gx * hy)
                out[0, row, k] -= w * mx
                out[1, row, k] -= w * my
                out[2, row, k] -= w * mz
                out[3, row, k] -= w * gx
                out[4, row, k] -= w * gy
                out[5, row, k] -= w * gz
                # By `softness`, whose derivative by Poisson's ratio is -2.
                out[6, row, k] += 2 * w * (c * (along * bulge - dz * i3) - speed * shallow)
                out[7, row, k] += ahead
                out[8, row, k] += right
                out[9, row, k] += front * ahead
                out[10, row, k] += side * right
                out[11, row, k] -= front * (mx * dx + my * dy + mz * dz)


@dataclass(frozen=True)
class GaugeDirections:
    """Points of gauges and what the ground's motion there is multiplied with to give strain rate.

    Parameters
    ----------
    ahead, behind : [channel, 3], unit tangents over the gauge length, and minus that
    turning : [channel, station, 3], minus the weighted derivative of the tangent; None without inner stations
    """

    ahead: Tensor
    behind: Tensor
    turning: Tensor | None

    @classmethod
    def of(cls, slopes: tuple[Tensor, Tensor], inner: tuple[Tensor, Tensor] | None, gauge: float) -> "GaugeDirections":
        """From the slopes [channel, 3] at both ends, and slope and bend [channel, station, 3] within."""
        ahead, behind = (unit(slope) / gauge for slope in slopes)
        if inner is None:
            return cls(ahead, -behind, None)
        return cls(ahead, -behind, -torch.from_numpy(STATION_WEIGHTS)[:, None] * turning(*inner))


def dot(one: Tensor, other: Tensor) -> Tensor:
    """Scalar product of vectors [3, ...]: components outermost in memory, so that all work runs along long rows."""
    return one[0] * other[0] + one[1] * other[1] + one[2] * other[2]


def by_slope(motion: Tensor, slope: Tensor) -> Tensor:
    """Derivative [3, row, channel] of the motion along the unit tangent, by the slope [3, channel]."""
    length = slope.norm(dim=0)
    tangent = slope / length
    return (motion - dot(motion, tangent) * tangent[:, None]) / length


def by_bend(motion: Tensor, slope: Tensor, bend: Tensor) -> tuple[Tensor, Tensor]:
    """Derivatives [3, row, station, channel] of minus the weighted motion along the turning, by slope and bend."""
    length = slope.norm(dim=0)
    tangent = slope / length
    bent, moved = dot(bend, tangent), dot(motion, tangent)
    turned = (dot(motion, bend) - bent * moved) / length
    across = motion - moved * tangent[:, None]
    slopes = turned * tangent[:, None] + (moved * (bend - bent * tangent)[:, None] + bent * across) / length
    weights = torch.from_numpy(STATION_WEIGHTS)[:, None]
    return weights / length * slopes, -weights / length * across


def strain_rate_derivatives(
    fiber: Mapping[str, Tensor], load: Load, amplitude: Tensor, poisson_ratio: float, gauge: float, curved: bool
) -> tuple[Tensor, dict[str, Tensor]]:
    """Strain rate [row, channel] of each vehicle alone, 1/s, and its derivatives by every local quantity, by name.

    Parameters
    ----------
    fiber : fields of `solver.cable.fiber.Fiber` that are there, [channel, ...]
    load : of each row, the same for all channels
    amplitude : [row], m^2
    poisson_ratio : of the ground
    gauge : gauge length, m
    curved : whether what the fiber's bends within a gauge add counts
    """
    inner = (fiber["inner_slope"], fiber["inner_bend"]) if curved and "inner" in fiber else None
    way = GaugeDirections.of((fiber["ahead_slope"], fiber["behind_slope"]), inner, gauge)
    places, ways = [fiber["ahead"], fiber["behind"]], [way.ahead, way.behind]
    if way.turning is not None:
        # Station by station, each with all channels.
        places, ways = [*places, *fiber["inner"].unbind(1)], [*ways, *way.turning.unbind(1)]
    here, count = motion_of(torch.cat(places), torch.cat(ways), load, poisson_ratio), len(fiber["ahead"])

    def gauges(values: Tensor) -> Tensor:
        """Sum over all points of each gauge, [row, channel]."""
        return values.unflatten(1, (-1, count)).sum(1)

    alone, strength = gauges(dot(here.motion, torch.cat(ways).T)), amplitude[:, None]
    by = {"amplitude": alone, "poisson_ratio": strength * gauges(here.by_poisson)}
    by |= {name: strength * gauges(getattr(here, name)) for name in BY_VEHICLE}
    motion, by_point = strength * here.motion, strength * here.by_point
    for name, part, sign in (("ahead", slice(count), 1), ("behind", slice(count, 2 * count), -1)):
        by[name] = by_point[..., part].movedim(0, -1)
        along = by_slope(motion[..., part], fiber[f"{name}_slope"].T)
        by[f"{name}_slope"] = (sign / gauge * along).movedim(0, -1)
    if inner:
        within = motion[..., 2 * count :].unflatten(2, (-1, count))
        slope, bend = (part.permute(2, 1, 0) for part in inner)
        parts = (by_point[..., 2 * count :].unflatten(2, (-1, count)), *by_bend(within, slope, bend))
        by |= {name: part.permute(1, 3, 2, 0) for name, part in zip(INNER, parts, strict=True)}
    for name in fiber.keys() - by.keys():
        by[name] = torch.zeros(*alone.shape, *fiber[name].shape[1:], dtype=alone.dtype)
    return strength * alone, by
