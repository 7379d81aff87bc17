"""Where the fiber lies: a street run between two perpendicular legs, or a spline through given points."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.contract import InputError

Array = NDArray[np.float64]
STEP = 0.02  # m between the stored points of a curve


@dataclass(frozen=True)
class Bend:
    """A circular bend between two straight parts.

    Attributes
    ----------
    at : number of the point in its middle
    turn : degrees, to the right where it lies flat, down where it is upright
    radius : m
    upright : whether it lies in the upright plane
    """

    at: int
    turn: float
    radius: float
    upright: bool = False


@dataclass(frozen=True)
class Route:
    """A space curve by arc length, continued straight beyond both ends.

    Attributes
    ----------
    arc : [k] m from the first channel
    points : [k, 3] m; x along the road, y to its right, z down
    bends : its corners, where it was laid with any
    chambers : numbers of the points that lie in chambers
    """

    arc: Array
    points: Array
    bends: tuple[Bend, ...] = ()
    chambers: tuple[int, ...] = ()

    @classmethod
    def through(cls, points: Array, bends: Sequence[Bend] = (), chambers: Sequence[int] = ()) -> "Route":
        """Take the arc length from the points themselves, [k, 3]; they must be dense."""
        step = np.linalg.norm(np.diff(points, axis=0), axis=1)
        return cls(np.concatenate([[0.0], np.cumsum(step)]), points, tuple(bends), tuple(chambers))

    def until(self, length: float) -> "Route":
        """The part up to `length`, m."""
        kept = self.points[self.arc <= length]
        bends = [bend for bend in self.bends if bend.at < len(kept)]
        return Route.through(kept, bends, [at for at in self.chambers if at < len(kept)])

    @property
    def length(self) -> float:
        """Meters from the first to the last point."""
        return float(self.arc[-1])

    def position(self, arc: ArrayLike) -> Array:
        """Points [n, 3] at `arc` [n], m.

        >>> import numpy as np
        >>> Route.through(np.array([[0.0, 4, 1], [10, 4, 1]])).position([-1.0, 3.0])
        array([[-1.,  4.,  1.],
               [ 3.,  4.,  1.]])
        """
        arc = np.asarray(arc, float)
        inside = np.clip(arc, 0.0, self.length)
        along = np.stack([np.interp(inside, self.arc, axis) for axis in self.points.T], axis=-1)
        return along + (arc - inside)[..., None] * self.tangent(inside)

    def tangent(self, arc: ArrayLike) -> Array:
        """Return the unit tangents [n, 3] at `arc` [n], m."""
        middle = (self.arc[1:] + self.arc[:-1]) / 2
        chord = np.diff(self.points, axis=0)
        direction = np.stack([np.interp(np.asarray(arc, float), middle, axis) for axis in chord.T], axis=-1)
        return direction / np.linalg.norm(direction, axis=-1, keepdims=True)


def street_route(
    rng: np.random.Generator,
    lateral: float,
    depth: float,
    *,
    length: float,
    view: tuple[float, float],
    side: float,
    undulation: float,
    depth_undulation: float,
) -> Route:
    """Lay a run beside the road with a perpendicular leg at each end, corners rounded, gently undulating.

    Parameters
    ----------
    rng : decides leg lengths, corners and the phases of the undulation
    lateral, depth : m; mean y and z of the run
    length : m of fiber
    view : m; the run covers this stretch of x with 12 to 30 m to spare at both ends
    side : +1 legs go off to the right (+y), -1 to the left
    undulation, depth_undulation : m; largest excursion from the mean, wavelengths of 50 to 150 m
    """
    first, last = view[0] - rng.uniform(14, 30), view[1] + rng.uniform(14, 30)
    radius, leg = rng.uniform(4, 8), rng.uniform(30, 55)
    corners = np.array([[first, side * leg], [first, 0.0], [last, 0.0], [last, side * 2 * length]])
    plan, bends = rounded(corners, [radius, radius])
    x = plan[:, 0]
    # The undulation fades out before the corners, so that these stay round.
    taper = np.clip((x - first - radius) / 12, 0, 1) * np.clip((last - radius - x) / 12, 0, 1)
    taper = taper**2 * (3 - 2 * taper)
    z = depth + depth_undulation * _waves(rng, STEP * np.arange(len(x), dtype=np.float64))
    y = lateral + plan[:, 1] + undulation * taper * _waves(rng, x)
    return Route.through(np.stack([x, y, z], axis=1), bends).until(length)


def spline_route(knots: ArrayLike) -> Route:
    """Draw a centripetal Catmull-Rom spline (Barry & Goldman 1988) through `knots` [k, 3], m.

    Raises
    ------
    InputError
        Fewer than two knots, a knot that is not x, y, z, one twice in a row, or one above the ground.

    >>> curve = spline_route([[0, 4, 1], [20, 4.5, 1], [40, 4, 1.2]])
    >>> curve.position([0.0])
    array([[0., 4., 1.]])
    """
    wrong = "route: give at least two points [x, y, z], meters"
    try:
        table: Array = np.array(knots, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(wrong) from error
    if table.ndim != 2 or table.shape[1] != 3 or len(table) < 2 or not np.isfinite(table).all():
        raise InputError(wrong)
    if (table[:, 2] <= 0).any():
        raise InputError("route: z is depth, down, and must be above 0 m everywhere")
    if (np.diff(table, axis=0) == 0).all(axis=1).any():
        raise InputError("route: the same point twice in a row; remove one")
    ends = 2 * table[[0, -1]] - table[[1, -2]]
    knots4 = np.concatenate([ends[:1], table, ends[1:]])
    pieces = [_catmull_rom(knots4[i : i + 4]) for i in range(len(table) - 1)]
    return Route.through(np.concatenate([*pieces, table[-1:]]))


def _catmull_rom(p: Array) -> Array:
    """Points of the middle segment of four knots, its end left out."""
    t = np.concatenate([[0.0], np.cumsum(np.sqrt(np.linalg.norm(np.diff(p, axis=0), axis=1)))])
    count = max(2, int(np.ceil(np.linalg.norm(p[2] - p[1]) / STEP)))
    u = np.linspace(t[1], t[2], count, endpoint=False)[:, None]
    level = list(p)
    for width in (1, 2):
        level = [_blend(level[i], level[i + 1], t[i], t[i + width], u) for i in range(len(level) - 1)]
    return _blend(level[0], level[1], t[1], t[2], u)


def _blend(a: Array, b: Array, t0: float, t1: float, u: Array) -> Array:
    return ((t1 - u) * a + (u - t0) * b) / (t1 - t0)


def rounded(corners: Array, radii: Sequence[float], *, upright: bool = False) -> tuple[Array, list[Bend]]:
    """Points every `STEP` along a polyline [k, 2], m, whose k - 2 corners are arcs; and these.

    Where a bend would take more than half of a side its radius is smaller.

    >>> curve, (bend,) = rounded(np.array([[0.0, 0], [10, 0], [10, 10]]), [0.8])
    >>> round(bend.turn), round(bend.radius, 3), curve[bend.at].round(1)
    (90, 0.8, array([9.8, 0.2]))
    """
    pieces, bends, here, count = list[Array](), list[Bend](), corners[0], 0
    for before, corner, after, wanted in zip(corners[:-2], corners[1:-1], corners[2:], radii, strict=True):
        incoming, outgoing = _unit(corner - before), _unit(after - corner)
        aside = np.array([-incoming[1], incoming[0]])
        turn = float(np.arctan2(aside @ outgoing, incoming @ outgoing))
        half = np.tan(abs(turn) / 2)
        room = min(np.linalg.norm(corner - before), np.linalg.norm(after - corner)) / 2
        radius = float(min(wanted, room / half)) if half else wanted
        start = corner - radius * half * incoming
        angle = np.arange(0, abs(turn), STEP / radius)[:, None]
        arc = start + radius * (np.sin(angle) * incoming + np.sign(turn) * (1 - np.cos(angle)) * aside)
        pieces += [_straight(here, start), arc]
        bends.append(Bend(count + len(pieces[-2]) + len(arc) // 2, float(np.degrees(turn)), radius, upright))
        count += len(pieces[-2]) + len(arc)
        here = corner + radius * half * outgoing
    return np.concatenate([*pieces, _straight(here, corners[-1])]), bends


def _straight(a: Array, b: Array) -> Array:
    length = float(np.linalg.norm(b - a))
    return a + np.arange(0, length, STEP)[:, None] * (b - a) / (length or 1.0)


def _unit(v: Array) -> Array:
    return v / np.linalg.norm(v)


def _waves(rng: np.random.Generator, x: Array) -> Array:
    """Three sinusoids of 50 to 150 m scaled to reach 1 at most."""
    wavelength, phase, weight = rng.uniform(50, 150, 3), rng.uniform(0, 2 * np.pi, 3), rng.uniform(0.3, 1, 3)
    wave = (weight[:, None] * np.sin(2 * np.pi * x / wavelength[:, None] + phase[:, None])).sum(0)
    return wave / np.abs(wave).max()
