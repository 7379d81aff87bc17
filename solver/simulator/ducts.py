"""A fiber as a utility lays it: straight ducts from chamber to chamber, and what turns them aside.

Sources of the ranges below:

- MIL-HDBK-1012/3, Telecommunications Premises Distribution Planning, Design, and Estimating, outside plant: conduits 24
  to 48 inches deep, chambers at most 450 feet apart and at most 2 m by 1.3 m wide, at most two right angles between
  them, 25 to 50 feet of cable coiled in every other one.
- TIA-569, Telecommunications Pathways and Spaces: ducts up to 50 mm wide bend by a radius of six inner diameters (0.3
  m) or more, wider ones by ten (1 m of 100 mm). UFGS-16713N: 36 inches or more in trenches.
- AASHTO, A Guide for Accommodating Utilities within Highway Right-of-Way (2005), and the rules of states after it, such
  as Wyoming's (045-7 chapter 8, section 2): along the verge, across the road as nearly at a right angle as can be,
  there 36 inches deep or more.

How far an obstacle, a culvert or a chamber turns a duct aside follows from their sizes.
"""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from solver.simulator.buried_route import STEP, Bend, Route, rounded

Array = NDArray[np.float64]
#: Ways in which a fiber lies in view, and how often "as-built" draws each.
SHAPES = {
    "straight": 0.1,
    "crossing": 0.2,
    "slanting": 0.1,
    "jog": 0.15,
    "culvert": 0.1,
    "step": 0.1,
    "dent": 0.1,
    "side-street": 0.1,
    "riser": 0.05,
    "coil": 0.0,  # an effect, `slack_spool`: drawn where it is asked for
}
APART = (30.0, 120.0)  # m between chambers
SHARP, GENTLE = (0.3, 3.0), (3.0, 10.0)  # m; radii of bends, one of five gentle
COIL = (8.0, 16.0)  # m of fiber
UNDER_ROAD = (0.95, 1.35)  # m; depth below a road that is crossed
DENT = (0.5, 1.0)  # m; half of the length of a chamber
SHALLOWEST = 0.45  # m
OFF_LINE = 0.1  # m by which a chamber is off the line of its run; the duct between two is straight
RISE = 2.5  # m above the ground, where a riser ends


def drawn_shape(rng: np.random.Generator) -> str:
    """One of `SHAPES`, as often as these say."""
    return str(rng.choice(list(SHAPES), p=list(SHAPES.values())))


def duct_route(
    rng: np.random.Generator,
    shape: str,
    lateral: float,
    across: float,
    depth: float,
    *,
    length: float,
    view: tuple[float, float],
    side: float,
) -> Route:
    """Lay ducts beside a road, which in view do what `shape` says.

    Beyond the view the run comes straight along the verge or, as often, out of a side street, and leaves likewise.

    Parameters
    ----------
    rng : decides places, sizes and radii
    shape : one of `SHAPES`
    lateral, across : m; y of the run, and of the verge on the other side of the road
    depth : m; of the run
    length : m of fiber; of a riser less
    view : m; stretch of x
    side : +1 if the run lies to the right of the road, -1 to the left

    >>> route = duct_route(
    ...     np.random.default_rng(1), "crossing", 4.0, -7.5, 0.8, length=240.0, view=(0.0, 100.0), side=1.0
    ... )
    >>> [round(bend.turn) for bend in route.bends if abs(bend.turn) > 30 and not bend.upright]
    [-90, 90]
    """
    first, last = view
    # What ends the run leaves enough of it in view.
    shares = (0.6, 0.8) if shape in ("side-street", "riser") else (0.35, 0.65)
    place = first + rng.uniform(*shares) * (last - first)
    corners, profile = _shape(rng, shape, place, lateral, across, depth, side)
    end = corners[-1][1] if corners else lateral
    plan = [*_approach(rng, first, lateral, side), *corners]
    if shape == "side-street":
        plan.append((place, lateral + side * 2 * length))
    elif shape != "riser":
        away = side if end == lateral else -side
        plan += [(x, y) for x, y in _leaving(rng, last, end, away, length)]
    plan, chambers = _with_chambers(rng, plan, corners)
    curve, bends = rounded(np.array(plan), [_radius(rng) for _ in plan[2:]])
    levels, dips = _levels(rng, profile, curve, depth)
    points = np.column_stack([curve, levels])
    if shape == "riser":
        points, dips = _risen(rng, points, dips)
    inside = [int(np.argmin(np.linalg.norm(curve - chamber, axis=1))) for chamber in chambers]
    return Route.through(points, sorted([*bends, *dips], key=lambda bend: bend.at), sorted(inside)).until(length)


def _shape(
    rng: np.random.Generator, shape: str, x: float, lateral: float, across: float, depth: float, side: float
) -> tuple[list[tuple[float, float]], list[tuple[tuple[float, float], float]]]:
    """Corners of the plan about `x`; and depths: from which place of the plan on, which, linear between."""
    if shape in ("crossing", "slanting"):
        half = rng.uniform(7.5, 15.0) if shape == "slanting" else 0.0
        under = max(depth, rng.uniform(*UNDER_ROAD))
        ends = [(x - half, lateral), (x + half, across)]
        inner = [_between(ends[0], ends[1], share) for share in (0.05, 0.2, 0.8, 0.95)]
        return ends, list(zip(inner, (depth, under, under, depth), strict=True))
    if shape in ("jog", "dent"):
        off = side * (rng.uniform(0.8, 2.0) if shape == "jog" else rng.uniform(0.5, 1.0))
        half = rng.uniform(1.0, 4.0) if shape == "jog" else rng.uniform(*DENT)
        ramp = abs(off) / np.tan(np.radians(rng.uniform(35.0, 80.0)))
        aside = lateral + off
        return [
            (x - half - ramp, lateral),
            (x - half, aside),
            (x + half, aside),
            (x + half + ramp, lateral),
        ], []
    if shape == "culvert":
        dip, half = rng.uniform(0.5, 1.2), rng.uniform(0.5, 1.5)
        ramp = dip * rng.uniform(1.0, 3.0)
        places = [(x + d, lateral) for d in (-half - ramp, -half, half, half + ramp)]
        return [], list(zip(places, (depth, depth + dip, depth + dip, depth), strict=True))
    if shape == "step":
        size, half = rng.uniform(0.4, 1.0), rng.uniform(0.75, 2.0)
        deeper = depth - size if depth - size > SHALLOWEST and rng.random() < 0.5 else depth + size
        return [], [((x - half, lateral), depth), ((x + half, lateral), deeper)]
    if shape == "side-street":
        return [(x, lateral)], []
    if shape == "riser":
        return [(x, lateral), (x, lateral + side * rng.uniform(3.0, 6.0))], []
    return [], []


def _between(a: tuple[float, float], b: tuple[float, float], share: float) -> tuple[float, float]:
    return a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])


def _approach(rng: np.random.Generator, first: float, lateral: float, side: float) -> list[tuple[float, float]]:
    """The run before the view, out of a side street or straight."""
    if rng.random() < 0.5:
        return [(first - rng.uniform(50, 80), lateral)]
    x = first - rng.uniform(14, 30)
    return [(x, lateral + side * rng.uniform(30, 55)), (x, lateral)]


def _leaving(
    rng: np.random.Generator, last: float, lateral: float, side: float, length: float
) -> list[tuple[float, float]]:
    """The run beyond the view, into a side street or straight."""
    if rng.random() < 0.5:
        return [(last + 2 * length, lateral)]
    x = last + rng.uniform(14, 30)
    return [(x, lateral), (x, lateral + side * 2 * length)]


def _with_chambers(
    rng: np.random.Generator,
    plan: list[tuple[float, float]],
    corners: list[tuple[float, float]],
) -> tuple[list[tuple[float, float]], list[tuple[float, float]]]:
    """Put chambers on the straight parts along the road, clear of what `corners` do; the plan with them, and they."""
    # A dent is as long as the chamber that stands in it.
    dent = len(corners) == 4 and corners[2][0] - corners[1][0] <= 2 * DENT[1]
    found, out = [_between(corners[1], corners[2], 0.5)] if dent else [], plan[:1]
    left = rng.uniform(0.2, 1.0) * APART[1] / 2
    for a, b in pairwise(plan):
        size = float(np.hypot(b[0] - a[0], b[1] - a[1]))
        at = left
        while at < size - 5.0:
            if at > 5.0 and a[1] == b[1] and a not in corners[:-1]:
                x, y = _between(a, b, at / size)
                found.append((x, y + rng.uniform(-OFF_LINE, OFF_LINE)))
                out.append(found[-1])
                at += rng.uniform(*APART)
            else:
                at += 5.0
        left = max(at - size, 5.0)
        out.append(b)
    return out, found


def _radius(rng: np.random.Generator) -> float:
    """Of a bend, m; sharp ones evenly in the logarithm."""
    if rng.random() < 0.2:
        return float(rng.uniform(*GENTLE))
    return float(np.exp(rng.uniform(*np.log(SHARP))))


def _levels(
    rng: np.random.Generator,
    profile: list[tuple[tuple[float, float], float]],
    curve: Array,
    depth: float,
) -> tuple[Array, list[Bend]]:
    """Depth [k], m, along a plan [k, 2]; and its bends."""
    if not profile:
        return np.full(len(curve), depth), []
    along = Route.through(curve).arc
    place = [float(along[np.argmin(np.linalg.norm(curve - where, axis=1))]) for where, _ in profile]
    level = [z for _, z in profile]
    corners = np.column_stack([[along[0], *place, along[-1]], [level[0], *level, level[-1]]])
    shape, bends = rounded(corners, [_radius(rng) for _ in place], upright=True)
    found = [Bend(int(np.searchsorted(along, shape[one.at, 0])), one.turn, one.radius, True) for one in bends]
    return np.interp(along, shape[:, 0], shape[:, 1]), [one for one in found if abs(one.turn) > 1e-6]


def _risen(rng: np.random.Generator, points: Array, bends: list[Bend]) -> tuple[Array, list[Bend]]:
    """Go up at the end of a fiber [k, 3]: a bend by a right angle, and straight to `RISE` above the ground."""
    ahead = points[-1] - points[-2]
    ahead, up = ahead / np.linalg.norm(ahead), np.array([0.0, 0.0, -1.0])
    radius = min(_radius(rng), 0.9 * points[-1, 2])
    angle = np.arange(0, np.pi / 2, STEP / radius)[:, None]
    arc = points[-1] + radius * (np.sin(angle) * ahead + (1 - np.cos(angle)) * up)
    foot = points[-1] + radius * (ahead + up)
    rise = foot + np.arange(0, foot[2] + RISE, STEP)[:, None] * up
    bend = Bend(len(points) + len(arc) // 2, -90.0, float(radius), True)
    return np.concatenate([points, arc[1:], rise]), [*bends, bend]
