"""A rendered street: camera, vehicles, light, frames, and the truth about them.

Serves the demo (a real video whose answer is known) and the embedded detector's training.
"""

from vision.scene.bodies import PAINTS
from vision.scene.camera import Camera
from vision.scene.light import Light
from vision.scene.render import Scene, render
from vision.scene.street import Street
from vision.scene.truth import ControlPoint, Truth, control_point_card, control_points, truth_boxes
from vision.scene.vehicles import SIZES, SceneVehicle, constant_speed
from vision.scene.video import write_video

__all__ = [
    "PAINTS",
    "SIZES",
    "Camera",
    "ControlPoint",
    "Light",
    "Scene",
    "SceneVehicle",
    "Street",
    "Truth",
    "constant_speed",
    "control_point_card",
    "control_points",
    "render",
    "truth_boxes",
    "write_video",
]
