"""An ONNX file as a session that takes one image of a known size."""

import ast
import logging
import os
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vision.contract.errors import InputError
from vision.detectors.images import Normalization
from vision.detectors.layout import Size
from vision.detectors.layouts import no_detector

log = logging.getLogger("roadfiber.detectors")

# TensorRT comes after CUDA: it takes minutes to plan at every start.
ACCELERATORS = (
    "CUDAExecutionProvider",
    "TensorrtExecutionProvider",
    "OpenVINOExecutionProvider",
    "CoreMLExecutionProvider",
)
PROCESSOR = "CPUExecutionProvider"
DTYPES = {"tensor(float)": np.float32, "tensor(float16)": np.float16, "tensor(uint8)": np.uint8}
NUMBERS = {**DTYPES, "tensor(int64)": np.int64, "tensor(int32)": np.int32, "tensor(double)": np.float64}
LIMIT = 60.0  # s for one image; the slowest detectors take a few on one core
PATIENCE = 5.0  # s until a graph that is told to end has done so: it looks after every node
USUAL_SIZES = ((640, 640), (416, 416), (320, 320), (512, 512), (300, 300))

# Inputs beside the image, filled so that boxes come out in px of the input: size (w, h), its shape (h, w), scale 1.
SIDE_INPUTS = {
    "orig_target_sizes": lambda size: [size],
    "im_shape": lambda size: [size[::-1]],
    "scale_factor": lambda size: [(1, 1)],
}


@dataclass(frozen=True)
class ImageInput:
    """How a graph takes images.

    Parameters
    ----------
    names : of the inputs that do: the frame's first, then the background's, if it wants one
    dtype : of their values
    channels_last : [1, h, w, 3] rather than [1, 3, h, w]
    shape : (height, width), px; None along an axis that is free
    """

    names: tuple[str, ...]
    dtype: type
    channels_last: bool
    shape: tuple[int | None, int | None]

    def tensors(self, canvases: Sequence[NDArray[np.uint8]], normalization: Normalization) -> dict[str, NDArray[Any]]:
        """Images of the input's size, BGR -> what the graph takes."""
        tensors = (normalization.tensor(canvas, self.dtype, self.channels_last) for canvas in canvases)
        return dict(zip(self.names, tensors, strict=True))


def open_session(path: Path) -> Any:
    """Open an ONNX file on the first accelerator that works here, else on the processor.

    Raises InputError, where onnxruntime cannot run the file.
    """
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3
    # Spinning threads would occupy the cores that decode the next frame.
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.intra_op_num_threads = allotted_cores()
    present = onnxruntime.get_available_providers()
    for provider in (name for name in ACCELERATORS if name in present):
        reason = "its libraries are missing"
        try:
            session = onnxruntime.InferenceSession(str(path), options, providers=[provider, PROCESSOR])
            if session.get_providers()[0] == provider:
                log.debug("%s: runs on %s", path, provider)
                return session
        except Exception as error:  # onnxruntime's errors share no base class
            reason = first_line(error)
        log.warning("%s: %s does not run it here (%s); slower without", path, provider, reason)
    try:
        return onnxruntime.InferenceSession(str(path), options, providers=[PROCESSOR])
    except Exception as error:  # onnxruntime's errors share no base class
        raise InputError(
            f"{path}: not an ONNX model that onnxruntime can run ({first_line(error)}); export it again"
        ) from error


def allotted_cores() -> int:
    """Return how many cores this process is confined to (taskset, a container); 0 where it has all.

    By default, onnxruntime would bind a thread to every core of the machine.
    """
    allotted = len(os.sched_getaffinity(0)) if sys.platform == "linux" else 0
    return allotted if allotted < (os.cpu_count() or 0) else 0


def find_input(session: Any, path: Path) -> ImageInput:
    """Return how the graph takes images; InputError where it takes none, or several at a time."""
    images = [entry for entry in session.get_inputs() if entry.type in DTYPES and len(entry.shape) == 4]
    others = [entry.name for entry in session.get_inputs() if entry not in images and entry.name not in SIDE_INPUTS]
    first = images[0].shape if images else []
    if len(images) not in (1, 2) or not (_may_be(first[1], 3) or _may_be(first[3], 3)):
        raise no_detector(str(path), "takes no image [1,3,h,w] or [1,h,w,3]")
    if others:
        raise no_detector(str(path), f"asks for {', '.join(others)} beside the image")
    if not _may_be(first[0], 1):
        raise InputError(f"{path}: takes {first[0]} images at a time; export it for one (batch=1)")
    channels_last = first[3] == 3 and first[1] != 3
    height, width = first[1:3] if channels_last else first[2:]
    names = sorted((entry.name for entry in images), key=lambda name: name != "frame")
    return ImageInput(tuple(names), DTYPES[images[0].type], channels_last, (_fixed(height), _fixed(width)))


def sizes_to_try(image: ImageInput, metadata: Mapping[str, str], path: Path) -> Iterator[Size]:
    """(width, height), px: that fixed by the graph; if it is free, the metadata's `imgsz`, then usual sizes."""
    height, width = image.shape
    stated = stated_size(metadata, path)
    if width and height:
        if stated and stated != (width, height):
            log.warning(
                "%s: says it takes %d x %d px but its graph takes %d x %d; the graph is followed",
                *(path, *stated, width, height),
            )
        yield width, height
        return
    sizes = dict.fromkeys([*([stated] if stated else []), *USUAL_SIZES])
    yield from dict.fromkeys((width or size[0], height or size[1]) for size in sizes)


def stated_size(metadata: Mapping[str, str], path: Path) -> Size | None:
    """Return the (width, height) the metadata states, as `imgsz`: [height, width] or one number; None without it."""
    try:
        stated = ast.literal_eval(metadata.get("imgsz", "None"))
        height, width = (stated, stated) if isinstance(stated, int) else stated or (0, 0)
        return (int(width), int(height)) if width and height else None
    except (ValueError, SyntaxError, TypeError):
        log.warning("%s: the size its metadata states cannot be read: %s", path, metadata["imgsz"][:40])
        return None


def side_feeds(session: Any, image: ImageInput, size: Size) -> dict[str, NDArray[Any]]:
    """Inputs of the graph other than the image."""
    others = (entry for entry in session.get_inputs() if entry.name not in image.names)
    return {entry.name: np.array(SIDE_INPUTS[entry.name](size), NUMBERS[entry.type]) for entry in others}


def run(session: Any, feeds: Mapping[str, NDArray[Any]], reads: Sequence[str] = ()) -> list[NDArray[Any]]:
    """Run the graph; half precision comes back as single.

    It runs in a thread: while it does, nothing else would, Ctrl-C included, and a graph may hold an endless loop.

    Raises
    ------
    InputError
        If it is not done after `LIMIT`.
    """
    from onnxruntime import RunOptions

    options, answer = RunOptions(), Future[list[Any]]()

    def work() -> None:
        try:
            answer.set_result(session.run(list(reads) or None, feeds, options))
        except BaseException as error:
            answer.set_exception(error)

    thread = Thread(target=work, daemon=True)
    thread.start()
    try:
        found = answer.result(LIMIT)
    except TimeoutError as error:
        raise InputError(f"the model is not done with one image after {LIMIT:g} s; give another") from error
    finally:
        options.terminate = True
        thread.join(PATIENCE)  # a process must not end while onnxruntime is at work
    outputs = map(np.asarray, found)
    return [output.astype(np.float32) if output.dtype == np.float16 else output for output in outputs]


def dry_run(
    session: Any, image: ImageInput, metadata: Mapping[str, str], path: Path
) -> tuple[Size, list[NDArray[Any]]]:
    """Run the graph on noise; return the size that it accepted, (width, height), and its outputs.

    Raises InputError if it accepts no size.
    """
    reason, sizes = "", list(sizes_to_try(image, metadata, path))
    for size in sizes:
        noise = np.random.default_rng(0).integers(0, 256, (size[1], size[0], 3), dtype=np.uint8)
        tensors = image.tensors([noise] * len(image.names), Normalization("RGB", deviation=(255.0, 255.0, 255.0)))
        try:
            outputs = run(session, {**tensors, **side_feeds(session, image, size)})
        except InputError as error:
            raise InputError(f"{path}: {error}") from error
        except Exception as error:  # onnxruntime's errors share no base class
            reason = reason or first_line(error)
            continue
        if size != sizes[0]:
            log.warning("%s: refuses %d x %d px, so %d x %d is taken", path, *sizes[0], *size)
        return size, outputs
    raise no_detector(str(path), f"refuses an image of {sizes[0][0]} x {sizes[0][1]} px ({reason})")


def first_line(error: Exception) -> str:
    """Return the start of an error's first line, without onnxruntime's numbers and the path it repeats.

    >>> first_line(RuntimeError("[ONNXRuntimeError] : 10 : INVALID_GRAPH : Load model from a.onnx failed:No graph"))
    'No graph'
    """
    line = (str(error).splitlines() or [type(error).__name__])[0]
    return re.sub(r"^\[ONNXRuntimeError\] : \d+ : \w+ : (Load model from .* failed:)?", "", line)[:120]


def _may_be(axis: int | str | None, length: int) -> bool:
    return not isinstance(axis, int) or axis == length


def _fixed(axis: int | str | None) -> int | None:
    return axis if isinstance(axis, int) and axis > 0 else None
