"""Scenes as video files."""

from pathlib import Path

import cv2

from vision.contract import InputError, progress, writing
from vision.rendered import note_rendered
from vision.scene.render import Scene, render


def write_video(scene: Scene, path: str | Path, fps: float = 12.5, duration: float = 90.0, codec: str = "mp4v") -> int:
    """Write a scene as a video with constant frame rate; frame k shows the time k / fps. The file says it is rendered.

    Parameters
    ----------
    scene : what to film
    path : the file to write (.mp4)
    fps : frames per second
    duration : s
    codec : FourCC of the encoder

    Returns
    -------
    Number of frames.

    Raises
    ------
    InputError
        If this OpenCV has no such encoder.
    """
    frames = round(duration * fps)
    with writing(path) as part:
        writer = cv2.VideoWriter(str(part), cv2.VideoWriter.fourcc(*codec), fps, scene.camera.size)
        if not writer.isOpened():
            raise InputError(f"codec {codec} for {Path(path).name}: this OpenCV cannot encode it; take codec mp4v")
        with progress("rendering", frames) as advance:
            for k in range(frames):
                writer.write(render(scene, k / fps))
                advance(1)
        writer.release()
        # A full disk is not an error to OpenCV.
        if cv2.VideoCapture(str(part)).get(cv2.CAP_PROP_FRAME_COUNT) != frames:
            raise InputError(f"{path}: cannot be written to its end; make room, or write elsewhere")
        note_rendered(part)
    return frames
