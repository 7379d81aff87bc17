"""A video to a trajectory table: decode, detect, track, fill, place on the road, put on the clock."""

import logging
from collections.abc import Iterable, Sequence
from contextlib import closing
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vision.appearance import Appearance
from vision.camera import Calibration
from vision.contract.errors import InputError
from vision.contract.progress import progress
from vision.contract.table import COLUMNS
from vision.contract.text import moment
from vision.detectors import Detector, OnnxDetector, is_street, load_detector
from vision.detectors.look import Look, look
from vision.dropped import causes, join, words
from vision.follow import FEWEST_FIXES, PIXEL_COLUMNS, detection_table, follow, patience
from vision.frames import Video
from vision.ground_track import SIZE, ground_tracks, unplaceable
from vision.interpolate import BOX, fill_frames
from vision.rendered import is_rendered
from vision.stills import require_rate
from vision.tracked import Speed, Tracked
from vision.tracker import Tracker
from vision.video import open_video

if TYPE_CHECKING:
    import pandas as pd

log = logging.getLogger("roadfiber.pipeline")

DEMO_GRADE = (
    "%s: the detector `street` was trained on renderings alone and is not to be trusted on real streets (MOTA -0.25 to "
    "0.88, by clip); leave --detector out for NanoDet-g, or bring weights: --detector yolox_s.onnx"
)
SIZES = "length, width and wheelbase of a vehicle are those usual of its class where the pictures do not tell them"
EXTRA_COLUMNS = (
    *("speed", "confidence", "interpolated", *SIZE, "frame", *BOX, "detected_class"),
    *("x_measured", "y_measured"),
)


def track(
    video: Path | str,
    *,
    detector: str | Path | Detector = "nanodet",
    layout: str | None = None,
    names: Sequence[str] | None = None,
    calibration: Path | str | Calibration | None = None,
    start: datetime | str | None = None,
    frame_rate: float | None = None,
    clock_offset: float = 0.0,
    min_score: float | None = None,
    classes: Iterable[str] | None = None,
    every: int = 1,
    cache: Path | None = None,
    appearance: Appearance | Path | str | None = None,
) -> Tracked:
    """Track the vehicles of a video, on the road where the view is calibrated, else in the picture.

    Parameters
    ----------
    video : file, or folder of pictures
    detector : name of a built-in detector, path of an .onnx file, or one that is loaded
    layout, names : of an .onnx file: its layout where it is not recognized, class names in the model's order
    calibration : of the view, or its file; without one, tracks stay in pixels
    start : UTC of the video's time zero; by default the creation time in its header
    frame_rate : of a folder of pictures, 1/s; by default they must tell their times
    clock_offset : s that the camera's clock is ahead of true time; it is taken off
    min_score : score that starts a track; by default the detector's own
    classes : names of the classes to follow; road vehicles by default
    every : look at every n-th frame
    cache : folder where detections are kept for another run (`vision.cache.cache_folder()`); by default they are not
    appearance : embedding that knows vehicles again by their looks, or its file; by default motion alone does

    Returns
    -------
    tracked : with its `table` [fix]: `time` datetime64[ns, UTC], `track_id` text, `class`, `x, y, sigma_x, sigma_y`
    (m; the ground under the middle of the wheelbase, smoothed), `speed` (m/s, of the smoothed motion), `confidence`,
    `interpolated`, `length`, `sigma_length`, `width`, `wheelbase`, `sigma_wheelbase` (m; empty where no more is known
    than the class says), `frame`, the box (px), `detected_class`, and `x_measured, y_measured` (m; what each box alone
    says). In pixels: `PIXEL_COLUMNS`, and `time` in UTC if the start is given, else in s

    Raises
    ------
    InputError, where the video, the detector or the calibration cannot be used or do not belong together, the start
    is unknown, or no vehicle was followed on the road.
    """
    view = calibration if isinstance(calibration, Calibration | None) else Calibration.read(calibration)
    finder = (
        load_detector(detector, layout=layout, names=names, classes=classes)
        if isinstance(detector, str | Path)
        else detector
    )
    require_rate(Path(video), frame_rate)
    clip = open_video(video, cache, frame_rate)
    if view is not None:
        view.require_size(clip.width, clip.height, clip.path)
    zero = None if view is None and start is None else start_time(start, clip)
    looks = Appearance.load(Path(appearance)) if isinstance(appearance, str | Path) else appearance
    boxes, speed, far = box_tracks(
        clip, finder, calibration=view, min_score=min_score, every=every, cache=cache, appearance=looks
    )
    told = "not known" if zero is None else f"{zero}Z, {'as given' if start else 'as its header says'}"
    taken = [
        *([finder.taken] if isinstance(finder, OnnxDetector) else []),
        f"a track starts at a score of {finder.threshold if min_score is None else min_score:g}",
        f"{clip.path.name}: frames timed by {f'--frame-rate {frame_rate:g}' if frame_rate else 'the file'}, "
        f"{1 / max(clip.frame_interval, 1e-9):.4g} a second; start {told}",
    ]
    if view is not None and view.covariance is None:
        taken.append("the calibration states no uncertainty of its own: the sigmas are those of the pictures alone")
    if view is None or zero is None:
        timed = boxes if zero is None else boxes.assign(time=utc(boxes["time"], zero, clock_offset))
        return Tracked(timed, None, speed, clip, every, tuple(taken))
    table, dropped = on_road(boxes, view, zero, clock_offset, clip.path, far)
    return Tracked(table, dropped, speed, clip, every, (*taken, SIZES), view)


def box_tracks(
    video: Video,
    detector: Detector,
    *,
    calibration: Calibration | None = None,
    min_score: float | None = None,
    every: int = 1,
    cache: Path | None = None,
    appearance: Appearance | None = None,
) -> tuple["pd.DataFrame", Speed, "pd.DataFrame"]:
    """Follow vehicles through the pictures.

    With a calibration, vehicles too far away to be placed are not followed: near the vanishing point a leaving and an
    arriving vehicle cover the same few pixels, and would become one track. With a folder as `cache`, what an ONNX
    detector finds is kept there, and what it found before is used. With an `appearance` embedding, vehicles are found
    again by their looks after they were hidden.

    Returns
    -------
    table [fix] of `PIXEL_COLUMNS`, without gaps, time in s since the file's time zero; the speed; and the detections
    with a score that starts a track that were too far off, [detection] of `vision.dropped.COLUMNS`

    Raises
    ------
    InputError, where there is no vehicle in five frames.
    """
    if is_street(detector) and not is_rendered(video.path):
        log.warning(DEMO_GRADE, video.path)
    strong = detector.threshold if min_score is None else min_score
    looked_at = len(range(0, len(video), every))
    looks = look(video, detector, every, cache=cache, images=appearance is not None)
    with progress("detecting vehicles", looked_at) as advance, closing(looks):
        seen, far, detected = [], [], 0
        for now in looks:
            near, beyond = _placeable(now, strong, calibration, appearance)
            seen.append(near)
            far += [beyond] if beyond is not None else []
            detected += len(now.found)
            advance(1)
    begun = perf_counter()
    table = follow(seen, Tracker(strong, patience(every * video.frame_interval), calibration))
    tracking = perf_counter() - begun
    done = [now for now, _ in seen]
    spent = (sum(now.decode for now in done), sum(now.detect for now in done), tracking)
    speed = Speed(looked_at, sum(now.fresh for now in done), *spent)
    if table.empty and detected >= FEWEST_FIXES and not any(len(now.found) for now in done):
        raise off_road(video.path, join(far))
    if table.empty:
        raise InputError(
            f"{video.path}: no vehicle was followed through {FEWEST_FIXES} frames; try a lower --min-score than "
            f"{strong:g}, or another --detector"
        )
    filled = fill_frames(table, video.index[::every], video.time[::every])
    return filled[list(PIXEL_COLUMNS)], speed, join(far)


def _placeable(
    now: Look, strong: float, calibration: Calibration | None, appearance: Appearance | None
) -> tuple[tuple[Look, NDArray[np.float64] | None], "pd.DataFrame | None"]:
    """Those of a frame's detections that can be placed, without the image, with vectors of their looks.

    And those from the score `strong` on that cannot, with the cause; None where there are none.
    """
    found = now.found
    cause = unplaceable(found.box, calibration) if calibration else np.full(len(found), "", object)
    near, far = found.select(cause == ""), (cause != "") & (found.score >= strong)
    vectors = appearance.embed(now.image, near.box) if appearance and now.image is not None else None
    beyond = detection_table(now.index, found.select(far)).assign(track_id="", cause=cause[far]) if far.any() else None
    return (replace(now, found=near, image=None), vectors), beyond


def on_road(
    boxes: "pd.DataFrame",
    calibration: Calibration,
    zero: np.datetime64,
    clock_offset: float,
    video: Path,
    far: "pd.DataFrame",
) -> tuple["pd.DataFrame", "pd.DataFrame"]:
    """Turn the boxes of tracks into the trajectory table `track` returns.

    And join what could not be placed to what was too `far` off to be followed: [fix] of `vision.dropped.COLUMNS`.
    """
    placed, dropped = ground_tracks(boxes, calibration)
    dropped = join([dropped.assign(track_id=dropped["track_id"].astype(str)), far])
    if placed.empty:
        raise off_road(video, dropped)
    placed = placed.assign(time=utc(placed["time"], zero, clock_offset), track_id=placed["track_id"].astype(str))
    return placed[[*COLUMNS, *EXTRA_COLUMNS]], dropped


def off_road(video: Path, dropped: "pd.DataFrame") -> InputError:
    """Say that what was found is not where the calibration knows the road."""
    return InputError(
        f"{video}: nothing that it shows lies on the calibrated road ({words(causes(dropped))}); check the control "
        "points (roadfiber calibrate ground --picture)"
    )


def utc(seconds: "pd.Series", zero: np.datetime64, clock_offset: float = 0.0) -> "pd.Series":
    """Time in s since `zero` by a clock that is `clock_offset` s ahead -> datetime64[ns, UTC]."""
    import pandas as pd

    elapsed = pd.to_timedelta(((seconds - clock_offset) * 1e9).round().astype("int64"), unit="ns")
    return (pd.Timestamp(zero).tz_localize("UTC") + elapsed).dt.as_unit("ns")


def start_time(start: datetime | str | None, video: Video) -> np.datetime64:
    """Return the UTC of a video's time zero: as given (ISO 8601 with Z or an offset), else from its header."""
    if start is None:
        if video.created is None:
            raise InputError(
                f"{video.path}: does not say when it was recorded; give --start, as 2025-08-11T06:00:00.25Z"
            )
        log.warning(
            "%s: taken to start at %sZ, as its header says; some cameras write the end there, %.0f s after the start: "
            "give --start if not",
            *(video.path, video.created, video.time[-1]),
        )
        return video.created
    zero = np.datetime64(round(moment(start, "--start").timestamp() * 1e6), "us").astype("datetime64[ns]")
    if line := video.header_line(zero):
        log.warning("%s: %s", video.path, line)
    return zero
