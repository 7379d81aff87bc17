"""A detector from an ONNX file, run by onnxruntime."""

import ast
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from vision.boxes import area, suppress
from vision.contract.errors import InputError
from vision.detectors.detections import Detections
from vision.detectors.images import fit_image
from vision.detectors.layouts import LAYOUTS, Layout, Signature
from vision.detectors.names import class_names, wanted_classes
from vision.video import Video

PROVIDERS = ("CUDAExecutionProvider", "OpenVINOExecutionProvider", "CoreMLExecutionProvider", "CPUExecutionProvider")
FLOAT_TYPES = {"tensor(float)": np.float32, "tensor(float16)": np.float16}
FLOOR = 0.1  # lowest score handed on; the tracker continues tracks, but starts none, on weak detections
LARGEST = 0.5  # share of the image; small models call an empty road one huge car
BUILT_IN = {"street": Path(__file__).parents[1] / "street_detector" / "street.onnx"}


@dataclass(frozen=True)
class OnnxDetector:
    """An ONNX graph with the layout it was recognized as.

    Parameters
    ----------
    session : onnxruntime session
    layout : how to feed and read it
    image_inputs : names of the image inputs: the frame and, if there is a second, the background
    size : (width, height) of the input, px
    dtype : of the input
    names : class names in the model's order
    wanted : classes to look for, places in `names`
    threshold : score above which a detection is believable on its own
    background : median image [height, width, 3] of the video at input size, for graphs that want one
    """

    session: Any
    layout: Layout
    image_inputs: tuple[str, ...]
    size: tuple[int, int]
    dtype: type
    names: tuple[str, ...]
    wanted: NDArray[np.intp]
    threshold: float
    background: NDArray[np.uint8] | None = None

    def prepare(self, video: Video) -> Self:
        """Return a detector that knows the background: the median of 50 frames spread over the video."""
        if len(self.image_inputs) == 1:
            return self
        fitted = [self._fit(frame.image)[0] for frame in video.sample(50)]
        return replace(self, background=np.median(fitted, axis=0).astype(np.uint8))

    def detect(self, image: NDArray[np.uint8]) -> Detections:
        """Find the vehicles in an image [height, width, 3], BGR; weak ones too, down to a score of 0.1."""
        canvas, placement = self._fit(image)
        images = [canvas] if self.background is None else [canvas, self.background]
        outputs = _run(self.session, _feeds(self.session, self._tensors(images), self.size))
        found = self.layout.decode(outputs, self.size, self.wanted, FLOOR)
        box = placement.to_image(found.box)
        plausible = np.flatnonzero((area(box) > 0) & (area(box) < LARGEST * image.shape[0] * image.shape[1]))
        kept = plausible[suppress(box[plausible], np.asarray(found.score[plausible], float))]
        return Detections(
            box[kept],
            np.asarray(found.score[kept], float),
            np.array([self.names[place] for place in found.label[kept]], dtype=str),
        )

    def _fit(self, image: NDArray[np.uint8]) -> Any:
        return fit_image(image, self.size, self.layout.fitting, self.layout.fill)

    def _tensors(self, images: Sequence[NDArray[np.uint8]]) -> dict[str, NDArray[Any]]:
        tensors: list[NDArray[Any]] = [
            self.layout.normalization.tensor(image).astype(self.dtype, copy=False) for image in images
        ]
        return dict(zip(self.image_inputs, tensors, strict=True))


def load_detector(
    model: str | Path,
    *,
    layout: str | None = None,
    names: Sequence[str] | None = None,
    classes: Iterable[str] | None = None,
) -> OnnxDetector:
    """Load an ONNX detector, or a built-in one by name ("street").

    The layout is the one given, else the one its metadata names (`layout`), else the first that fits the inputs,
    outputs and shapes that a dry run shows.

    Parameters
    ----------
    model : path of an .onnx file, or "street"
    layout : name of one of `LAYOUTS`
    names : class names in the model's order, for models that carry none
    classes : names of the classes to detect; road vehicles (car, van, bus, truck, motorcycle) by default

    Raises
    ------
    InputError, for a file that is missing, no ONNX graph, or no detector of a known layout, and for classes that the
    model does not know.
    """
    path = BUILT_IN.get(str(model), Path(model))
    session = _open_session(path)
    metadata = session.get_modelmeta().custom_metadata_map
    image_inputs, dtype = _image_inputs(session, path)
    size = _input_size(session, metadata)
    blank: NDArray[Any] = np.full((1, 3, size[1], size[0]), 0.5, dtype)
    outputs = _dry_run(session, _feeds(session, dict.fromkeys(image_inputs, blank), size), path)
    signature = Signature(
        tuple(entry.name for entry in session.get_inputs()),
        tuple(entry.name for entry in session.get_outputs()),
        tuple(np.shape(output) for output in outputs),
        size,
    )
    chosen = _choose_layout(signature, layout, metadata, path)
    known = class_names(metadata, chosen.classes(signature.shapes), names, str(path))
    wanted = np.array(wanted_classes(known, classes, str(path)), np.intp)
    _dry_decode(chosen, outputs, size, wanted, path)
    threshold = float(metadata.get("threshold", chosen.threshold))
    return OnnxDetector(session, chosen, image_inputs, size, dtype, tuple(known), wanted, threshold)


def _open_session(path: Path) -> Any:
    import onnxruntime

    if not path.is_file():
        raise InputError(f"{path}: no such file; give an .onnx detector, or a built-in one: {', '.join(BUILT_IN)}")
    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3
    # Spinning threads would take the cores that decode the next frame.
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    present = onnxruntime.get_available_providers()
    providers = [provider for provider in PROVIDERS if provider in present]
    try:
        return onnxruntime.InferenceSession(str(path), options, providers=providers)
    except Exception as error:  # onnxruntime's errors share no base class
        reason = str(error).splitlines()[0][:120]
        raise InputError(f"{path}: not an ONNX model that onnxruntime can run ({reason}); export it again") from error


def _image_inputs(session: Any, path: Path) -> tuple[tuple[str, ...], type]:
    """Names and type of the inputs that take images [1, 3, h, w]; a graph's "frame" comes first."""
    images = [
        entry
        for entry in session.get_inputs()
        if entry.type in FLOAT_TYPES and len(entry.shape) == 4 and entry.shape[1] == 3
    ]
    if len(images) not in (1, 2):
        raise _no_detector(path, "takes no float image [1,3,h,w]")
    names = sorted((entry.name for entry in images), key=lambda name: name != "frame")
    return tuple(names), FLOAT_TYPES[images[0].type]


def _input_size(session: Any, metadata: Mapping[str, str]) -> tuple[int, int]:
    """(width, height), px: of the graph where it is fixed, else of the metadata (`imgsz`, height first), else 640."""
    shape = next(entry.shape for entry in session.get_inputs() if len(entry.shape) == 4)
    height, width = shape[2:]
    if isinstance(height, int) and isinstance(width, int):
        return width, height
    stated = ast.literal_eval(metadata.get("imgsz", "[640, 640]"))
    return int(stated[1]), int(stated[0])


def _feeds(session: Any, images: Mapping[str, NDArray[Any]], size: tuple[int, int]) -> dict[str, NDArray[Any]]:
    """Image tensors, and the size (w, h) for graphs that scale their boxes themselves: to px of the input."""
    others = {entry.name: np.array([size], np.int64) for entry in session.get_inputs() if entry.name not in images}
    return {**images, **others}


def _run(session: Any, feeds: Mapping[str, NDArray[Any]]) -> list[NDArray[Any]]:
    return list(session.run(None, feeds))


def _dry_run(session: Any, feeds: Mapping[str, NDArray[Any]], path: Path) -> list[NDArray[Any]]:
    try:
        return _run(session, feeds)
    except Exception as error:  # onnxruntime's errors share no base class
        raise _no_detector(path, f"refuses an image ({str(error).splitlines()[0][:120]})") from error


def _dry_decode(
    layout: Layout, outputs: Sequence[Any], size: tuple[int, int], wanted: NDArray[np.intp], path: Path
) -> None:
    try:
        layout.decode(outputs, size, wanted, FLOOR)
    except (IndexError, ValueError) as error:
        raise _no_detector(path, f"cannot be read as {layout.name}") from error


def _choose_layout(signature: Signature, given: str | None, metadata: Mapping[str, str], path: Path) -> Layout:
    by_name = {layout.name: layout for layout in LAYOUTS}
    if given is not None and given not in by_name:
        raise InputError(f"{path}: layout {given!r} is unknown; known are {', '.join(by_name)}")
    stated = by_name.get(given or metadata.get("layout", ""))
    if stated:
        return stated
    for layout in LAYOUTS:
        if layout.matches(signature):
            return layout
    shapes = ", ".join(f"{n} {list(s)}" for n, s in zip(signature.outputs, signature.shapes, strict=True))
    raise _no_detector(path, f"gives {shapes}")


def _no_detector(path: Path, why: str) -> InputError:
    layouts = "; ".join(f"{layout.name}: {layout.graph}" for layout in LAYOUTS)
    return InputError(f"{path}: not a detector of a known layout, it {why}; recognized are {layouts}")
