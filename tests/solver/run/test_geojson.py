"""Route and corridor as GeoJSON: valid after RFC 7946, and true."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.path import Path as Outline

from solver.run.geojson import Z95, corridor_ring, half_width, normals, outer, route_features, runs
from solver.run.run_corridor import placed


def crossings(ring: np.ndarray) -> int:
    """Number of pairs of edges of a closed ring [vertex, 2] that cross each other properly."""
    a, b = ring[:-1], ring[1:]

    def side(p, q, r):
        return np.sign((q[:, 0] - p[:, 0]) * (r[:, 1] - p[:, 1]) - (q[:, 1] - p[:, 1]) * (r[:, 0] - p[:, 0]))

    i, j = np.triu_indices(len(a), 2)
    return int(
        np.sum(
            (side(a[i], b[i], a[j]) * side(a[i], b[i], b[j]) < 0)
            & (side(a[j], b[j], a[i]) * side(a[j], b[j], b[i]) < 0)
        )
    )


def area(ring: np.ndarray) -> float:
    """Signed area, positive counterclockwise."""
    x, y = (ring - ring[0]).T
    return 0.5 * float(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))


def straight(n=60):
    return np.stack([np.arange(n) * 1.0, np.zeros(n)], 1)


def bend(radius, n=40):
    """Straight, a right angle of that radius, straight."""
    angle = np.linspace(0, np.pi / 2, 12)
    arc = radius * np.stack([np.sin(angle), 1 - np.cos(angle)], 1)
    before = np.stack([np.arange(-n, 0), np.zeros(n)], 1)
    after = arc[-1] + np.stack([np.zeros(n), np.arange(1, n + 1)], 1)
    return np.concatenate([before, arc, after])


def hairpin():
    """There and back, 2 m apart."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, 9)[1:-1]
    there, turn = straight(30), np.stack([29 + np.cos(angle), 1 + np.sin(angle)], 1)
    return np.concatenate([there, turn, np.add(there[::-1], [0, 2])])


ROUTES = {
    "straight": (straight(), np.full(60, 0.3)),
    "against x": (straight()[::-1].copy(), np.full(60, 0.3)),
    "widening": (straight(), np.geomspace(0.05, 8.0, 60)),
    "gentle bend": (bend(20.0), np.full(92, 0.5)),
    "bend tighter than the corridor": (bend(1.0), np.full(92, 3.0)),
    "hairpin inside its own corridor": (hairpin(), np.full(len(hairpin()), 3.0)),
    "zigzag": (straight() + np.stack([np.zeros(60), 0.4 * (-1.0) ** np.arange(60)], 1), np.full(60, 1.0)),
}


@pytest.mark.parametrize(("route", "half"), ROUTES.values(), ids=ROUTES)
def test_corridor_is_a_simple_ring_around_the_route(route, half):
    ring = corridor_ring(route, half)
    np.testing.assert_array_equal(ring[0], ring[-1])
    assert crossings(ring) == 0
    # Of the ends only the middle of the edge is on the outline.
    assert Outline(ring).contains_points(route[1:-1]).all()


def test_crossings_are_found():
    assert crossings(np.array([[0, 0], [1, 1], [1, 0], [0, 1], [0, 0]], float)) == 1


def test_corridor_is_as_wide_as_it_says():
    ring = corridor_ring(straight(), np.full(60, 0.3))
    assert abs(area(ring)) == pytest.approx(59 * 0.6)


def test_a_long_corridor_is_that_of_all_pairs_of_points():
    x = np.arange(700.0)
    route, half = np.stack([x, 30 * np.sin(x / 10)], 1), 4 + np.sin(x / 9)
    side = route + half[:, None] * normals(route)
    far = np.linalg.norm(side[:, None] - route[None], axis=2) >= half * (1 - 1e-6)
    np.testing.assert_array_equal(outer(side, route, half), side[far.all(1)])
    assert 0 < far.all(1).sum() < len(x)


@pytest.mark.parametrize("heading", [0.0, 0.7, 2.5])
def test_half_width_is_across_the_route(heading):
    along, across = np.array([np.cos(heading), np.sin(heading)]), np.array([-np.sin(heading), np.cos(heading)])
    route = np.column_stack([np.arange(5)[:, None] * along, np.ones(5)])
    covariance = np.zeros((5, 3, 3))
    covariance[:, :2, :2] = 4.0 * np.outer(along, along) + 0.01 * np.outer(across, across)
    np.testing.assert_allclose(half_width(route, covariance), Z95 * 0.1)


def made_features(survey, **changes):
    place = placed(replace(survey.result, **changes), None)
    return route_features(place, survey.site.frame, survey.anchors, "Elm")["features"]


def test_collection_has_route_corridor_and_anchors(survey):
    collection = route_features(placed(survey.result, None), survey.site.frame, survey.anchors, "Elm")
    assert collection["type"] == "FeatureCollection"
    kinds = [item["geometry"]["type"] for item in collection["features"]]
    assert kinds == ["LineString", "Polygon", "Polygon", "Polygon", "Point"]
    assert all(item["type"] == "Feature" for item in collection["features"])


def test_positions_are_longitude_latitude_and_minus_the_depth(survey):
    route = made_features(survey)[0]
    longitude, latitude, altitude = np.array(route["geometry"]["coordinates"]).T
    x, y = survey.site.frame.to_local(latitude, longitude)
    np.testing.assert_allclose(np.stack([x, y, -altitude], 1), survey.result.route, atol=1e-3)
    assert "not a height above the ellipsoid" in route["properties"]["altitude"]


def test_rings_are_closed_and_counterclockwise_whichever_way_the_route_runs(survey):
    backward = {name: getattr(survey.result, name)[::-1].copy() for name in ("route", "covariance", "constrained")}
    for features in (made_features(survey), made_features(survey, **backward)):
        for item in features:
            if item["geometry"]["type"] == "Polygon":
                (ring,) = item["geometry"]["coordinates"]
                assert ring[0] == ring[-1]
                assert area(np.array(ring)) > 0


def test_corridor_says_where_data_decide(survey):
    polygons = [item["properties"] for item in made_features(survey) if item["geometry"]["type"] == "Polygon"]
    assert [(p["channels"], p["constrained"]) for p in polygons] == [
        ([50, 51], False),
        ([52, 108], True),
        ([109, 110], False),
    ]
    assert polygons[1]["half_width_max_m"] == pytest.approx(Z95 * 0.05, abs=0.002)


def test_corridor_contains_the_route_without_holes(survey):
    features = made_features(survey)
    line = np.array(features[0]["geometry"]["coordinates"])[1:-1, :2]
    middle = (line[1:] + line[:-1]) / 2
    rings = [np.array(item["geometry"]["coordinates"][0]) for item in features if item["geometry"]["type"] == "Polygon"]
    # In meters, since a contour test in degrees would be at the edge of its precision.
    origin, scale = line[0], np.array([94000.0, 111000.0])
    inside = [Outline((ring - origin) * scale).contains_points((middle - origin) * scale) for ring in rings]
    assert np.any(inside, axis=0).all()


def test_corridor_leaves_out_what_has_no_covariance(survey):
    covariance = survey.result.covariance.copy()
    covariance[:20] = np.nan
    polygons = [p for p in made_features(survey, covariance=covariance) if p["geometry"]["type"] == "Polygon"]
    assert polygons[0]["properties"]["channels"] == [70, 108]


def test_runs_of_one_flag():
    assert runs(np.array([True])) == [(0, 0)]
