"""Why a path cannot be read as a video, in one line that says how to mend it."""

import re
from pathlib import Path

from vision.contract.errors import InputError

STREAM = re.compile(r"([a-z][a-z0-9+.-]+):/{1,2}(?:[^/@]*@)?(.*)", re.IGNORECASE)  # the address without the password
LACKING = {"AV01": "AV1", "vvc1": "VVC (H.266)", "vvi1": "VVC (H.266)"}  # codecs that OpenCV's FFmpeg cannot decode


def require_file(path: Path) -> None:
    """Raise InputError where there is no file: for the address of a stream, with the way to record it.

    >>> require_file(Path("rtsp://admin:secret@10.0.0.5/live"))
    Traceback (most recent call last):
    vision.contract.errors.InputError: rtsp://10.0.0.5/live: is a stream, not a file; record it first, then give \
street.mp4 (ffmpeg -rtsp_transport tcp -i URL -c copy -t 600 street.mp4)
    """
    if path.is_file():
        return
    if address := STREAM.fullmatch(path.as_posix()):
        scheme, place = address.groups()
        option = "-rtsp_transport tcp " if scheme.lower().startswith("rtsp") else ""
        raise InputError(
            f"{scheme}://{place}: is a stream, not a file; record it first, then give street.mp4 "
            f"(ffmpeg {option}-i URL -c copy -t 600 street.mp4)"
        )
    raise InputError(f"{path}: no such file; give a video or a folder of stills")


def undecodable(path: Path, codec: str) -> InputError:
    """Say why no frame of a file decodes, by the four characters of its codec."""
    if codec in LACKING:
        return InputError(
            f"{path}: holds {LACKING[codec]}, for which this build of OpenCV has no decoder; convert it first, then "
            f"give h264.mp4 (ffmpeg -i {path.name} -c:v libx264 -crf 18 -fps_mode passthrough h264.mp4)"
        )
    return InputError(f"{path}: no frame decodes; the file is empty or damaged, export the video again")
