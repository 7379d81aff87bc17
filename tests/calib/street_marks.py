"""Control points as a known pinhole camera sees them."""

import numpy as np

from calib.control_points import control_points
from vision.scene.camera import Camera

SIZE = (1280, 720)
CAMERA = Camera(position=(-6.0, 9.0, -7.0), yaw=-12.0, pitch=9.0, focal=900.0, size=SIZE)
GROUND = np.array(
    [[12, -4], [12, 3.5], [22, -1.8], [24, 3.4], [30, -5.2], [41, 1.9], [48, -4], [55, 3.4], [70, -1.8], [72, 3.5]],
    float,
)


def marks(ground=GROUND, noise=0.0, seed=0, sigma=1.0):
    pixels = CAMERA.project(np.column_stack([ground, np.zeros(len(ground))]))
    pixels = pixels + noise * np.random.default_rng(seed).normal(size=pixels.shape)
    return control_points(tuple(f"p{k}" for k in range(len(ground))), pixels, np.array(ground, float), sigma)
