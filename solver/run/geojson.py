"""The route and its 95 % corridor as GeoJSON (RFC 7946), for a geographic information system."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solver.fit.result import Corner, Placed
from solver.survey.anchors import Anchor
from vision.contract import LocalFrame

Z95 = 1.959964  # standard deviations that hold 95 % of a normal distribution
ALTITUDE = "minus the depth below the road surface, m; not a height above the ellipsoid"
CHUNK = 128


def normals(route: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit vectors [point, 2] across a route [point, 2 or more], in the horizontal plane, toward +y for one along +x.

    >>> normals(np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 1.0]])).tolist()
    [[-0.0, 1.0], [-0.0, 1.0]]
    """
    tangent = np.gradient(route[:, :2], axis=0)
    length = np.linalg.norm(tangent, axis=1, keepdims=True)
    return np.stack([-tangent[:, 1], tangent[:, 0]], 1) / np.maximum(length, 1e-12)


def half_width(route: NDArray[np.float64], covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Half-width [point], m, of the 95 % corridor: 1.96 standard deviations across the route, horizontally.

    Parameters
    ----------
    route : [point, 3], m
    covariance : [point, 3, 3], m^2
    """
    across = normals(route)
    return Z95 * np.sqrt(np.einsum("pa,pab,pb->p", across, covariance[:, :2, :2], across))


def outer(side: NDArray[np.float64], route: NDArray[np.float64], half: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points of an offset curve `side` [point, 2] that lie in no other point's disk, so that the curve has no loops."""
    keep, reach = np.empty(len(side), bool), half.max()
    for first in range(0, len(side), CHUNK):
        part = slice(first, first + CHUNK)
        # On a long fiber most disks are too far away to hold any of these points.
        low, high = side[part].min(axis=0) - reach, side[part].max(axis=0) + reach
        near = ((route >= low) & (route <= high)).all(axis=1)
        distance = np.linalg.norm(side[part, None] - route[None, near], axis=2)
        keep[part] = (distance >= half[near] * (1 - 1e-6)).all(axis=1)
    return side[keep]


def corridor_ring(route: NDArray[np.float64], half: NDArray[np.float64]) -> NDArray[np.float64]:
    """Outline of the corridor, closed [vertex, 2], m.

    Parameters
    ----------
    route : [point, 2], m
    half : [point], half-width, m

    >>> corridor_ring(np.array([[0.0, 0.0], [9.0, 0.0]]), np.array([1.0, 2.0])).tolist()
    [[0.0, 1.0], [9.0, 2.0], [9.0, -2.0], [0.0, -1.0], [0.0, 1.0]]
    """
    offset = half[:, None] * normals(route)
    ahead, back = outer(route + offset, route, half), outer(route - offset, route, half)[::-1]
    ring = np.concatenate([ahead, back])
    return np.concatenate([ring, ring[:1]])


def runs(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last index of each stretch of equal flags.

    >>> runs(np.array([True, True, False, True]))
    [(0, 1), (2, 2), (3, 3)]
    """
    cuts = np.flatnonzero(np.diff(flags)) + 1
    return [(int(a), int(b) - 1) for a, b in pairwise([0, *cuts, len(flags)])]


def positions(frame: LocalFrame, points: NDArray[np.float64]) -> list[list[float]]:
    """GeoJSON positions of points [point, 2 or 3], m: longitude, latitude, and minus the depth where it is there."""
    latitude, longitude = frame.to_geographic(points[:, 0], points[:, 1])
    columns = [np.round(longitude, 9), np.round(latitude, 9), *np.round(-points[:, 2:].T, 3)]
    return np.stack(columns, 1).tolist()


def counterclockwise(ring: list[list[float]]) -> list[list[float]]:
    """Turn a closed ring of longitude and latitude the way that RFC 7946 (section 3.1.6) wants an outer one."""
    x, y = (np.array(ring) - ring[0]).T
    return ring if np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]) > 0 else ring[::-1]


def feature(kind: str, coordinates: Any, **properties: Any) -> dict[str, Any]:
    """One GeoJSON feature."""
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def corridor_features(result: Placed, frame: LocalFrame) -> list[dict[str, Any]]:
    """One polygon per stretch that data and anchors decide, or do not; none where the method gives no covariance."""
    half = half_width(result.route, result.covariance)
    features = []
    # State: 0 no corridor, 1 the prior alone decides, 2 data and anchors do.
    state = np.where(np.isfinite(half), 1 + result.constrained, 0)
    for first, last in runs(state):
        # Neighboring stretches share a point, so that the corridor has no holes.
        stop = last + 2 if last + 1 < len(half) and state[last + 1] > 0 else last + 1
        part = slice(first, stop)
        if state[first] == 0 or stop - first < 2:
            continue
        ring = positions(frame, corridor_ring(result.route[part, :2], half[part]))
        features.append(
            feature(
                "Polygon",
                [counterclockwise(ring)],
                what="95 % corridor",
                channels=[int(result.channel[first]), int(result.channel[last])],
                constrained=bool(state[first] == 2),
                half_width_max_m=round(float(half[part].max()), 3),
                trust=result.grade,
                reason=result.told,
            )
        )
    return features


def line_style(reliable: bool) -> dict[str, Any]:
    """How a viewer is asked to draw a line of the route (simplestyle 1.1, and dashes that some viewers know)."""
    return {"stroke": "#0072b2", "stroke-width": 3} if reliable else {"stroke": "#808080", "stroke-dasharray": "4 4"}


def corner_numbers(one: Corner) -> dict[str, float | int]:
    """A corner's numbers, rounded to what its sigmas bear, by names with their units."""
    unit = "degrees_right" if one.kind == "corner" else "m_deeper"
    return {
        "channel": one.channel,
        unit: round(one.amount, 2),
        f"sigma_{unit}": round(one.sigma, 2),
        "sigma_place_m": round(one.sigma_place, 3),
        "length_m": round(one.length, 1),
    }


def route_features(result: Placed, frame: LocalFrame, anchors: Sequence[Anchor], name: str) -> dict[str, Any]:
    """The route (LineString Z), its 95 % corridor and the anchors as a FeatureCollection, WGS 84.

    Parameters
    ----------
    result : the route with its covariance and what its checks say
    frame : local frame of its x, y
    anchors : known points
    name : of the survey
    """
    loose = [(a, b) for a, b in runs(result.constrained) if not result.constrained[a]]
    route = feature(
        "LineString",
        positions(frame, result.route),
        what="fiber route",
        name=name,
        channels=[int(result.channel[0]), int(result.channel[-1])],
        unconstrained_channels=[[int(result.channel[a]), int(result.channel[b])] for a, b in loose],
        altitude=ALTITUDE,
        trust=result.grade,
        reason=result.told,
        **line_style(bool(result.reliable.any())),
    )
    points = [
        feature("Point", positions(frame, np.array([[a.x, a.y, a.z]]))[0], what="anchor", **vars(a)) for a in anchors
    ]
    points += [
        feature(
            "Point",
            positions(frame, np.array([[c.x, c.y, c.z]]))[0],
            what=c.kind,
            words=c.words,
            **corner_numbers(c),
            trust=result.grade,
            reason=result.told,
        )
        for c in result.corners
    ]
    return {"type": "FeatureCollection", "features": [route, *corridor_features(result, frame), *points]}
