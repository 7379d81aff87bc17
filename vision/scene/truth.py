"""What a frame shows: the vehicles' boxes, and the surveyed points of the ground."""

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.scene.drawing import fill, seen_faces
from vision.scene.render import FINER, Scene, present
from vision.scene.street import Floats, Image, control_targets
from vision.scene.vehicles import Pose, SceneVehicle


@dataclass(frozen=True)
class Truth:
    """Vehicles of one frame, the hidden ones first.

    Attributes
    ----------
    boxes : [n, 4] x1, y1, x2, y2 of the whole vehicle inside the picture, px
    labels : classes [n]
    visibility : [n] share of the vehicle's picture that is neither hidden nor outside the frame, 0-1
    index : [n] place in `scene.vehicles`
    ground : [n, 2] x, y of the ground point under the middle of the wheelbase, m
    """

    boxes: Floats
    labels: tuple[str, ...]
    visibility: Floats
    index: NDArray[np.intp]
    ground: Floats


def truth_boxes(scene: Scene, t: float) -> Truth:
    """Find where the vehicles are in the frame at time `t` (s); those wholly outside are left out."""
    width, height = scene.camera.size
    owners = np.zeros((height, width), np.uint8)
    rows: list[tuple[int, SceneVehicle, Pose, Floats, float, float]] = []
    for index, vehicle, pose in present(scene, t):
        outlines = [
            o + scene.shift(t) for o in seen_faces(scene.camera, scene.light, vehicle, pose, 1.0).outlines if len(o) > 2
        ]
        if not outlines:
            continue
        points = np.concatenate(outlines)
        whole = np.concatenate([points.min(0), points.max(0)])
        box = np.clip(whole, 0, [width, height, width, height])
        inside = np.prod(box[2:] - box[:2]) / np.prod(whole[2:] - whole[:2])
        if inside > 0:
            alone = np.zeros_like(owners)
            for outline in outlines:
                fill(alone, outline, 1.0)
            owners[alone > 0] = len(rows) + 1
            rows.append((index, vehicle, pose, box, float(inside), float(alone.sum())))
    seen = np.bincount(owners[~hidden(scene)], minlength=len(rows) + 1)[1:]
    areas = np.array([row[5] for row in rows])
    return Truth(
        boxes=np.array([row[3] for row in rows]).reshape(-1, 4),
        labels=tuple(row[1].cls for row in rows),
        visibility=seen / np.maximum(areas, 1) * np.array([row[4] for row in rows]),
        index=np.array([row[0] for row in rows], np.intp),
        ground=np.array([row[2][:2] for row in rows]).reshape(-1, 2),
    )


def hidden(scene: Scene) -> NDArray[np.bool_]:
    """Pixels [height, width] taken by trees and posts between the camera and the road."""
    return cv2.resize(scene.still.foreground, scene.camera.size, interpolation=cv2.INTER_AREA) > 127


class ControlPoint(NamedTuple):
    """A surveyed point of the ground and where the picture shows it: x, y m; px, py pixels."""

    name: str
    x: float
    y: float
    px: float
    py: float


def control_points(scene: Scene, *, reach: float = 110.0, margin: float = 4.0) -> list[ControlPoint]:
    """Survey the drawn points of the street that the camera sees.

    Parameters
    ----------
    scene : street and camera
    reach : farthest distance from the camera, m
    margin : distance kept from the picture's border, px

    Returns
    -------
    Dash ends, manhole covers and survey marks with their exact pixels, none hidden by a tree or a post.
    """
    width, height = scene.camera.size
    covered = hidden(scene)
    points = []
    for name, x, y in control_targets(scene.street):
        px, py = scene.camera.project([x, y, 0.0])
        near = np.hypot(x - scene.camera.position[0], y - scene.camera.position[1]) < reach
        if near and margin < px < width - margin and margin < py < height - margin and not covered[int(py), int(px)]:
            points.append(ControlPoint(name, x, y, float(px), float(py)))
    return points


def control_point_card(scene: Scene, points: list[ControlPoint]) -> Image:
    """Return the empty street, twice as large, with each control point ringed and named."""
    card = scene.still.picture.copy()
    for point in points:
        center = (round(point.px * FINER), round(point.py * FINER))
        cv2.circle(card, center, 7, (0, 0, 255), 1, cv2.LINE_AA)
        cv2.putText(card, point.name, (center[0] + 9, center[1] - 5), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (0, 0, 255), 1)
    return card
