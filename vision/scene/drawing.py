"""Vehicles and their shadows, as polygons in a picture."""

from typing import NamedTuple

import cv2
import numpy as np

from vision.scene.camera import NEAR, Camera
from vision.scene.light import Light
from vision.scene.street import SHIFT, Floats, Image
from vision.scene.vehicles import Pose, SceneVehicle


class Drawn(NamedTuple):
    """A vehicle's visible polygons in drawing order: pixels [k, 2] each, and colors [n, 3]."""

    outlines: list[Floats]
    colors: Floats


def clipped(corners: Floats) -> Floats:
    """Cut a polygon [k, 3] of the camera frame at the near plane (Sutherland and Hodgman 1974)."""
    kept: list[Floats] = []
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if a[2] >= NEAR:
            kept.append(a)
        if (a[2] - NEAR) * (b[2] - NEAR) < 0:
            kept.append(a + (b - a) * (NEAR - a[2]) / (b[2] - a[2]))
    return np.array(kept).reshape(-1, 3)


def placed(points: Floats, pose: Pose) -> Floats:
    """Body frame [n, 3] -> local frame, m."""
    x, y, heading = pose
    cos, sin = np.cos(heading), np.sin(heading)
    return points @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]]) + [x, y, 0]


def seen_faces(camera: Camera, light: Light, vehicle: SceneVehicle, pose: Pose, sunlit: float) -> Drawn:
    """Visible polygons of a vehicle, far ones first, details last.

    Parameters
    ----------
    camera, light, vehicle : as in the scene
    pose : x, y (m), heading (rad)
    sunlit : share of the direct light that reaches the vehicle, 0-1
    """
    mesh = vehicle.mesh
    corners, centers = placed(mesh.corners, pose), placed(mesh.centers, pose)
    normals = placed(mesh.normals, (0.0, 0.0, pose[2]))
    to_camera = camera.position - centers
    distance = np.linalg.norm(to_camera, axis=1)
    visible = np.einsum("ij,ij->i", to_camera, normals) > 0
    order = np.lexsort((-distance, mesh.decal))
    order = order[visible[order]]
    in_camera = camera.in_camera(corners)
    behind = in_camera[:, 2].min() < NEAR
    pixels = in_camera[:, :2] / in_camera[:, 2:] * camera.focal + np.array(camera.size) / 2
    outlines = []
    for k in order:
        part = slice(mesh.starts[k], mesh.starts[k + 1])
        outlines.append(camera.picture(clipped(in_camera[part])) if behind else pixels[part])
    shade = light.shade(normals[order], sunlit)[:, None]
    gloss = np.clip(-normals[order, 2:], 0, 1) * mesh.glossy[order, None] * 0.35
    colors = (mesh.colors[order] * (1 - gloss) + gloss * light.sky) * shade * light.tint
    return Drawn(outlines, np.clip(light.through_air(colors, distance[order]), 0, 255))


def draw_faces(image: Image, drawn: Drawn) -> None:
    """Fill a vehicle's polygons."""
    for outline, color in zip(drawn.outlines, drawn.colors.tolist(), strict=True):
        if len(outline) > 2:
            fill(image, outline, color)


def fill(image: Image, outline: Floats, color: float | list[float]) -> None:
    """Fill a polygon [k, 2] in pixels whose corner of the picture is (0, 0)."""
    points = np.clip((outline - 0.5) * 2**SHIFT, -1e8, 1e8).round().astype(np.int32)
    cv2.fillPoly(image, [points], color, cv2.LINE_8, SHIFT)


def cast_shadow(image: Image, camera: Camera, light: Light, vehicle: SceneVehicle, pose: Pose, sunlit: float) -> None:
    """Darken the ground under a vehicle and where it takes the sun."""
    length, width, height = vehicle.size[:3]
    front = vehicle.size.wheelbase / 2 + vehicle.size.overhang
    ring = np.array(
        [(front, -width / 2), (front, width / 2), (front - length, width / 2), (front - length, -width / 2)]
    )
    foot = placed(np.column_stack([ring, np.zeros(4)]), pose)
    soften(image, camera, foot, 0.45)
    if light.sun * sunlit > 0.05:
        inset = ring * [0.86, 0.86]
        top = placed(np.column_stack([inset, np.full(4, -height)]), pose)
        belt = placed(np.column_stack([ring, np.full(4, -0.6 * height)]), pose)
        cast = light.cast(np.concatenate([foot, belt, top]))
        hull = cv2.convexHull(cast.astype(np.float32))[:, 0].astype(float)
        soften(image, camera, np.column_stack([hull, np.zeros(len(hull))]), 0.5 * light.sun * sunlit)


def soften(image: Image, camera: Camera, outline: Floats, darkness: float) -> None:
    """Multiply the picture inside a polygon [k, 3] on the ground by 1 - darkness, with a soft rim."""
    in_camera = clipped(camera.in_camera(outline))
    if len(in_camera) < 3:
        return
    pixels = camera.picture(in_camera)
    rim = int(np.clip(0.12 * camera.focal / in_camera[:, 2].mean(), 1, 14))
    height, width = image.shape[:2]
    left, top = np.maximum(np.floor(pixels.min(0)) - 2 * rim, 0).astype(int)
    right, bottom = np.minimum(np.ceil(pixels.max(0)) + 2 * rim, (width, height)).astype(int)
    if right <= left or bottom <= top:
        return
    mask = np.full((bottom - top, right - left), 255, np.uint8)
    fill(mask, pixels - (left, top), 255 * (1 - darkness))
    mask = cv2.blur(mask, (2 * rim + 1, 2 * rim + 1))
    window = image[top:bottom, left:right]
    cv2.multiply(window, cv2.merge([mask] * 3), dst=window, scale=1 / 255)
