"""Where vehicles were seen: a heat map over the scene."""

import cv2
import matplotlib
import numpy as np
from numpy.typing import NDArray

from vision.frames import Video
from vision.interpolate import BOX
from vision.quality.setting import Setting

Image = NDArray[np.uint8]

WIDTH = 640  # px of the picture in the page
FRAMES = 15  # of the video, whose median shows the empty scene
SMOOTH = 0.008  # sd of the blur, widths
OPAQUE = 0.75


def empty_scene(clip: Video) -> Image:
    """Median of frames all over the video [row, column, 3], blue, green, red: the scene without what moves."""
    return np.median([frame.image for frame in clip.sample(FRAMES)], axis=0).astype(np.uint8)


def blank_scene(settings: list[Setting]) -> Image:
    """Return a dark ground of the size that the boxes span, where there is no video."""
    corners = np.max([setting.tracks[[BOX[2], BOX[3]]].max().to_numpy(float) for setting in settings], axis=0)
    width, height = np.maximum(np.ceil(corners), 16).astype(int)
    return np.full((height, width, 3), 40, np.uint8)


def heat_map(setting: Setting, scene: Image) -> Image:
    """Density of the lower edges of boxes over the scene.

    Parameters
    ----------
    setting : tracks with boxes; what was detected counts, placed on the road or not
    scene : [row, column, 3], blue, green, red

    Returns
    -------
    picture [row, column, 3], red, green, blue, `WIDTH` px wide
    """
    height, width = scene.shape[:2]
    scale = WIDTH / width
    size = (WIDTH, max(1, round(height * scale)))
    ground = cv2.resize(scene, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR)
    gray = cv2.cvtColor(cv2.cvtColor(ground, cv2.COLOR_BGR2GRAY), cv2.COLOR_GRAY2RGB).astype(float)
    parts = [setting.tracks[~setting.tracks["missed"]]] + ([] if setting.dropped is None else [setting.dropped])
    seen = np.concatenate([part[BOX].to_numpy(float) for part in parts])
    column = np.clip(((seen[:, 0] + seen[:, 2]) / 2 * scale).astype(int), 0, size[0] - 1)
    row = np.clip((seen[:, 3] * scale).astype(int), 0, size[1] - 1)
    counts = np.bincount(row * size[0] + column, minlength=size[0] * size[1]).reshape(size[::-1]).astype(float)
    density = np.asarray(cv2.GaussianBlur(counts, (0, 0), max(SMOOTH * WIDTH, 1.0)))
    # The square root keeps rare detections visible beside a parked car.
    share = np.sqrt(density / max(float(density.max()), 1e-12))
    colors = matplotlib.colormaps["inferno"](0.25 + 0.75 * share)[..., :3] * 255
    weight = (OPAQUE * np.clip(2 * share, 0, 1))[..., None]
    return (gray * 0.8 * (1 - weight) + colors * weight).round().astype(np.uint8)
