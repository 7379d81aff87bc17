"""A route as layers of a map: route, corridor, channels, anchors, as tables with geometries."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from solver.fit.result import Placed
from solver.run.geojson import corner_numbers, corridor_ring, half_width
from solver.run.gis.accuracy import Accuracy, accuracy_of
from solver.run.gis.target import Target
from solver.survey.anchors import Anchor
from vision.contract import LocalFrame

if TYPE_CHECKING:
    import pandas as pd


#: Layer of what may not be relied on.
UNRELIABLE = "route_do_not_rely"


@dataclass(frozen=True)
class Subject:
    """What is written: a route and what it is called.

    Parameters
    ----------
    place : the route with its covariance and what its checks say
    frame : of its x, y
    anchors : known points
    name : of the survey
    recorded : date or dates of the record, UTC
    """

    place: Placed
    frame: LocalFrame
    anchors: Sequence[Anchor]
    name: str
    recorded: str = ""

    @property
    def accuracy(self) -> Accuracy:
        """Its accuracy classes."""
        return accuracy_of(self.place)


def stretches(subject: Subject) -> list[tuple[int, int]]:
    """First and last index of each stretch of one accuracy class, and constrained or not, so that a line has one."""
    found = subject.accuracy
    kind = np.char.add(np.char.add(found.pas128, found.within), subject.place.constrained.astype("U5"))
    edges = [0, *(np.flatnonzero(kind[1:] != kind[:-1]) + 1).tolist(), len(kind)]
    return [(first, end - 1) for first, end in pairwise(edges)]


def described(subject: Subject, first: int, last: int) -> dict[str, Any]:
    """Attributes of a stretch."""
    place, found, part = subject.place, subject.accuracy, slice(first, last + 1)
    return {
        "name": subject.name,
        "first_channel": int(place.channel[first]),
        "last_channel": int(place.channel[last]),
        "constrained": bool(place.constrained[part].all()),
        "pas128": str(found.pas128[first]),
        "pas128_numbers_met": str(found.within[first]),
        "asce38": str(found.asce38[first]),
        "half_width_95_max_m": largest(found.across[part]),
        "depth_95_max_m": largest(found.depth[part]),
        "depth_mean_m": round(float(place.route[part, 2].mean()), 3),
        "reliable": bool(place.reliable[first]),
        "trust": place.grade,
        "reason": place.told if place.reliable[first] else str(place.reason[first]),
    }


def largest(values: Any) -> float | None:
    """Largest finite value, to a millimeter; None where there is none."""
    there = values[np.isfinite(values)]
    return round(float(there.max()), 3) if len(there) else None


def route_layer(subject: Subject, target: Target) -> list[tuple[Any, dict[str, Any]]]:
    """A line with heights for each stretch of one class that may be relied on, neighbors sharing a point."""
    return [one for one in route_lines(subject, target) if one[1]["reliable"]]


def unreliable_layer(subject: Subject, target: Target) -> list[tuple[Any, dict[str, Any]]]:
    """The same of stretches that may not be: a layer of their own is drawn in another color by every viewer."""
    return [one for one in route_lines(subject, target) if not one[1]["reliable"]]


def route_lines(subject: Subject, target: Target) -> list[tuple[Any, dict[str, Any]]]:
    """A line for each stretch of one class."""
    from shapely import LineString

    points = target.points(subject.frame, subject.place.route)
    last_of_all = len(points) - 1
    found = []
    for first, last in stretches(subject):
        end = min(last + 1, last_of_all)
        if end > first:
            found.append((LineString(points[first : end + 1]), described(subject, first, last)))
    return found


def corridor_layer(subject: Subject, target: Target) -> list[tuple[Any, dict[str, Any]]]:
    """A polygon with the 95 % corridor for each stretch of one class; none where the method states no sigma."""
    from shapely import Polygon

    half, found = half_width(subject.place.route, subject.place.covariance), []
    for first, last in stretches(subject):
        part = slice(first, min(last + 2, len(half)))
        if not np.isfinite(half[part]).all() or part.stop - first < 2:
            continue
        ring = corridor_ring(subject.place.route[part, :2], half[part])
        flat = np.column_stack([ring, np.zeros(len(ring))])
        shape = Polygon(target.points(subject.frame, flat)[:, :2])
        if shape.area:  # where channels lie at one place there is no outline
            found.append((shape, described(subject, first, last)))
    return found


def channel_table(subject: Subject, target: Target) -> "pd.DataFrame":
    """A row per channel: coordinates, depth, sigmas, 95 % half-widths, classes."""
    import pandas as pd

    place, found = subject.place, subject.accuracy
    points = target.points(subject.frame, place.route)
    across, down = target.names
    columns: dict[str, Any] = {"channel": place.channel, "distance_m": place.distance.round(3)}
    columns |= {across: points[:, 0], down: points[:, 1]}
    columns |= {"depth_m": place.route[:, 2].round(4)}
    if target.ground_height is not None:
        columns[f"height_{target.third_unit}"] = points[:, 2].round(4)
    sigma = place.sigma.round(4)
    columns |= {f"sigma_{axis}_m": sigma[:, number] for number, axis in enumerate("xyz")}
    columns |= {"half_width_95_m": found.across.round(4), "depth_95_m": found.depth.round(4)}
    columns |= {"constrained": place.constrained, "pas128": found.pas128, "pas128_numbers_met": found.within}
    columns |= {"trust": place.grade, "reason": place.reason}
    return pd.DataFrame(columns | {"asce38": found.asce38})


def channel_layer(subject: Subject, target: Target) -> list[tuple[Any, dict[str, Any]]]:
    """A point per channel."""
    from shapely import points

    places = target.points(subject.frame, subject.place.route)
    table = channel_table(subject, target).drop(columns=list(target.names))
    rows = [{str(name): value for name, value in row.items()} for row in table.to_dict("records")]
    return list(zip(points(places), rows, strict=True))


def anchor_layer(subject: Subject, target: Target) -> list[tuple[Any, dict[str, Any]]]:
    """A point per anchor, with all that an anchors table says: it can be read back as one."""
    from shapely import Point

    found = []
    for one in subject.anchors:
        place = target.points(subject.frame, np.array([[one.x, one.y, one.z]]))[0]
        known = {"name": one.name, "channel": one.channel, "z_m": one.z}
        found.append((Point(place), known | {"sigma_xy_m": one.sigma_xy, "sigma_z_m": one.sigma_z}))
    return found


def corner_layer(subject: Subject, target: Target) -> list[tuple[Any, dict[str, Any]]]:
    """A point per corner and per step in depth."""
    from shapely import Point

    found = []
    for one in subject.place.corners:
        place = target.points(subject.frame, np.array([[one.x, one.y, one.z]]))[0]
        numbers = {"degrees_right": None, "m_deeper": None, "sigma_degrees_right": None, "sigma_m_deeper": None}
        trust = {"trust": subject.place.grade, "reason": subject.place.told}
        found.append((Point(place), {"what": one.kind, "words": one.words} | trust | numbers | corner_numbers(one)))
    return found


LAYERS = {
    "route": route_layer,
    UNRELIABLE: unreliable_layer,
    "corridor": corridor_layer,
    "channels": channel_layer,
    "anchors": anchor_layer,
    "corners": corner_layer,
}
