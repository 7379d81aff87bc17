"""The route drawn into the camera's picture: the fiber on the street's photograph."""

import base64
from collections.abc import Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

from solver.run.geojson import half_width, normals, runs
from solver.run.run import Run
from solver.run.scene import Scene

#: Shares of the picture's size beyond its border within which places are drawn.
BEYOND = 0.25


def in_picture(scene: Scene, ground: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points of the road [n, 2], m, in the picture [n, 2], px; NaN well outside it."""
    there = scene.to_image(ground)
    size = np.array(scene.size, dtype=float)
    inside = ((there > -BEYOND * size) & (there < (1 + BEYOND) * size)).all(1, keepdims=True)
    return np.where(inside, there, np.nan)


def path_of(places: NDArray[np.float64], only: NDArray[np.bool_] | None = None) -> str:
    """An SVG path through places [n, 2], px, broken where they are not known.

    >>> path_of(np.array([[0, 0], [1, 0], [np.nan, 0], [5, 5], [6, 6.5]]))
    'M0.0 0.0 L1.0 0.0 M5.0 5.0 L6.0 6.5'
    """
    there = np.asarray(np.isfinite(places).all(1), dtype=bool)
    if only is not None:
        there &= only
    words = []
    for first, last in runs(there):
        part = places[first : last + 1]
        if there[first] and len(part) > 1:
            words.append("M" + " L".join(f"{u:.1f} {v:.1f}" for u, v in part))
    return " ".join(words)


def band_of(scene: Scene, route: NDArray[np.float64], half: NDArray[np.float64]) -> str:
    """An SVG path of the corridor: a quadrilateral between each two channels that the picture shows."""
    across = normals(route) * half[:, None]
    left, right = (in_picture(scene, route[:, :2] + side * across) for side in (1, -1))
    quads = np.stack([left[:-1], left[1:], right[1:], right[:-1]], 1)
    quads = quads[np.isfinite(quads).all((1, 2))]
    return " ".join("M" + " L".join(f"{u:.1f} {v:.1f}" for u, v in quad) + " Z" for quad in quads)


def tracks_of(scene: Scene, run: Run) -> Sequence[str]:
    """SVG paths of the vehicles, where they were seen."""
    return [path_of(in_picture(scene, one.position), one.in_view) for one in run.passes]


def street_svg(run: Run, scene: Scene) -> str:
    """The picture with corridor, route, anchors and tracks, all on the surface of the road above the fiber."""
    place, (width, height) = run.place, scene.size
    unit = width / 640
    half = half_width(place.route, place.covariance)
    places = in_picture(scene, place.route[:, :2])
    band = f'<path d="{band_of(scene, place.route, half)}" fill="#d55e00" fill-opacity=".45"/>'
    tracks = "".join(
        f'<path d="{one}" fill="none" stroke="#ffffff" stroke-opacity=".55" stroke-width="{0.8 * unit:.2f}"/>'
        for one in tracks_of(scene, run)
        if one
    )
    line = (
        f'<path d="{path_of(places)}" fill="none" stroke="#ffffff" stroke-width="{3.6 * unit:.2f}"/>'
        f'<path d="{path_of(places)}" fill="none" stroke="#d55e00" stroke-width="{2.2 * unit:.2f}"/>'
    )
    anchors = "".join(
        f'<rect x="{u - 4 * unit:.1f}" y="{v - 4 * unit:.1f}" width="{8 * unit:.1f}" height="{8 * unit:.1f}" '
        f'fill="#ffffff" stroke="#1f2933" stroke-width="{1.4 * unit:.2f}"><title>{escape(a.name)}</title></rect>'
        for a, (u, v) in zip(
            run.anchors, in_picture(scene, np.array([(a.x, a.y) for a in run.anchors]).reshape(-1, 2)), strict=True
        )
        if np.isfinite(u)
    )
    source = "data:image/jpeg;base64," + base64.b64encode(scene.jpeg).decode()
    return (
        f'<svg viewBox="0 0 {width} {height}" role="img" aria-label="The fiber in the camera\'s picture">'
        f'<image href="{source}" width="{width}" height="{height}"/>{tracks}{band}{line}{anchors}</svg>'
    )


def street_section(run: Run) -> str:
    """The picture with its words; nothing for a run without a camera, or whose route the camera does not see."""
    scene = run.scene
    if scene is None or not np.isfinite(in_picture(scene, run.result.route[:, :2])).any():
        return ""
    return (
        "<section><h2>The fiber on the street</h2><p>The road above the fiber in the camera's picture: the orange line "
        "is the route, the band its 95 % corridor, white lines are vehicles' tracks, squares are anchors. A wrong "
        f"calibration shows here at once: tracks must lie on the lanes.</p>{street_svg(run, scene)}</section>"
    )
