"""The video's frame of a moment, with the boxes of the vehicles, where the survey's video is still there."""

import base64
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vision.contract import InputError, read_trajectories

if TYPE_CHECKING:
    from solver.run.seen import Seen
    from vision.frames import Video
    from vision.overlay import Drawn

#: Width of a frame on the page, px, and quality as JPEG.
WIDTH, QUALITY = 480, 80


@dataclass(frozen=True, eq=False)
class Film:
    """A survey's video in step with its record.

    Parameters
    ----------
    video : of the survey
    begun : of its time zero, s since the record's start
    boxes : by frame
    """

    video: "Video"
    begun: float
    boxes: "dict[int, list[Drawn]]"

    @lru_cache(maxsize=64)  # noqa: B019 one film is open for as long as its page
    def at(self, place: int) -> str:
        """The frame at a place of the video, with boxes, as a data address; "" where it does not decode."""
        import cv2

        from vision.overlay import draw

        frame = next(self.video.frames_at(np.array([place])), None)
        if frame is None:
            return ""
        image = draw(frame.image, self.boxes.get(int(self.video.index[place]), []))
        height = round(WIDTH * image.shape[0] / image.shape[1])
        small = cv2.resize(image, (WIDTH, height), interpolation=cv2.INTER_AREA)
        content = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes()
        return f"data:image/jpeg;base64,{base64.b64encode(content).decode()}"

    def place(self, second: float) -> int | None:
        """Which frame is nearest to a second of the record; None where the video shows none."""
        at = second - self.begun
        place = int(np.abs(self.video.time - at).argmin())
        return place if abs(self.video.time[place] - at) <= max(2 * self.video.frame_interval, 0.1) else None


def film_of(run: "Seen") -> Film | str:
    """The film of a run, or why there is none.

    The video is that of the survey by its checksum; its start is that of the survey's site.toml, as the tracks, which
    tell a frame and a time, have it.
    """
    video = next((one for one in run.facts["inputs"] if one["role"] == "video"), None)
    tracks = next((one for one in run.facts["inputs"] if one["role"] == "trajectories"), None)
    if video is None:
        return "This survey has no video."
    path = Path(video["path"])
    if not path.is_file():
        return f"The survey's video is no longer there: {path.name}"
    own = None if run.folder is None else run.folder / "trajectories.csv"
    table_path = Path(tracks["path"]) if tracks is not None else own
    if table_path is None or not table_path.is_file():
        return "The tracks of this survey are no longer there; without them the video's clock is not known."
    from vision.video import open_video

    try:
        opened = open_video(path)
        if opened.checksum != video["sha256"]:
            return f"{path.name} is another video than the one that this run was made with."
        return joined(run, opened, read_trajectories([table_path]))
    except InputError as error:
        return str(error)


def joined(run: "Seen", video: "Video", table: Any) -> Film | str:
    """Video and tracks on the clock of the record."""
    from vision.drawn_video import vehicles_by_frame
    from vision.interpolate import BOX

    if not {"frame", "interpolated", *BOX} <= set(table.columns):
        return "The tracks of this survey are not of its video: they name no frames."
    times = dict(zip(video.index.tolist(), video.time.tolist(), strict=True))
    table = table[table["frame"].isin(times)]
    if not len(table):
        return "The tracks of this survey are not of its video: they name other frames."
    since = (table["time"].dt.tz_convert(None).to_numpy() - run.start) / np.timedelta64(1, "s")
    begun = float(np.median(since - table["frame"].map(times).to_numpy()))
    return Film(video, begun, vehicles_by_frame(table, times))
