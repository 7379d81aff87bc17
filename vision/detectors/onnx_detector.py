"""A detector from an ONNX file, run by onnxruntime."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from vision.boxes import area, suppress
from vision.cache import checksum
from vision.contract.errors import InputError
from vision.detectors.detections import Detections, Detector
from vision.detectors.images import Placement, fit_image, shrink, window_of
from vision.detectors.layout import Candidates, Graph, Layout, Size
from vision.detectors.layouts import choose_layout, no_detector
from vision.detectors.names import class_names, wanted_classes
from vision.detectors.session import ImageInput, dry_run, find_input, open_session, run, side_feeds
from vision.frames import Video

FLOOR = 0.1  # lowest score reported; weak detections continue tracks but start none
LARGEST = 0.5  # share of the image; small models detect an empty road as one huge car
BACKGROUND_FRAMES = 50
MOST_CLASSES = 10_000  # class numbers looked at where a graph does not show how many it has
LISTENING_FRAMES = 5  # frames tried before a graph whose scores are all zero is rejected as mute
REVISION = 3  # version of the decoding: raise it when `detect` changes, which invalidates cached detections
BUILT_IN = {
    "nanodet": Path(__file__).parents[1] / "nanodet" / "nanodet_g.onnx",  # the default
    "street": Path(__file__).parents[1] / "street_detector" / "street.onnx",  # for the demo's renderings
}


@dataclass(frozen=True)
class OnnxDetector:
    """An ONNX graph with the layout it was recognized as.

    Parameters
    ----------
    path : the file
    session : onnxruntime session
    layout : how to feed and read it
    image : how it takes images
    size : (width, height) of the input, px
    reads : names of the outputs to read
    names, named : class names in the model's order, and in words, where they are from
    wanted : classes to look for, places in `names`
    threshold : score above which a single detection is credible
    mute : whether all its scores were exactly zero in the dry run, though it gives one for every place
    background : median image [height, width, 3] of the video at input size, for graphs that need one
    feeds, rooms : input tensors, by placement of the image, and scaled images; both are refilled for every frame, so a
        detector serves one thread only
    """

    path: Path
    session: Any
    layout: Layout
    image: ImageInput
    size: Size
    reads: tuple[str, ...]
    names: tuple[str, ...]
    named: str
    wanted: NDArray[np.intp]
    threshold: float
    mute: bool = False
    background: NDArray[np.uint8] | None = None
    feeds: dict[Placement, dict[str, NDArray[Any]]] = field(default_factory=dict, init=False, repr=False)
    rooms: dict[int, NDArray[np.uint8]] = field(default_factory=dict, init=False, repr=False)

    @property
    def identity(self) -> dict[str, Any]:
        """Key of the cache: checksum of the model and the options that decide its detections."""
        return {
            "model": model_checksum(self.path),
            "layout": self.layout.name,
            "size": list(self.size),
            "classes": {str(place): self.names[place] for place in self.wanted},
            "rules": [REVISION, FLOOR, LARGEST],
        }

    @property
    def taken(self) -> str:
        """How the model is read, in words: what its file does not say and might be otherwise."""
        followed = [self.names[place] for place in self.wanted]
        others = [name for name in self.names if name not in followed]
        left = f", not {', '.join(others[:4])}{', ...' * (len(others) > 4)}" if others else ""
        return (
            f"{self.path.name}: layout {self.layout.name}, {self.size[0]} x {self.size[1]} px, "
            f"{self.layout.normalization.words}; class names {self.named}; follows {', '.join(followed)}{left}"
        )

    def prepare(self, video: Video) -> Self:
        """Return a detector with the background: the median of 50 frames spread over the video.

        Raises InputError, where the graph was mute in the dry run and is so on frames of the video.
        """
        if self.mute and all(self._is_mute(frame.image) for frame in video.sample(LISTENING_FRAMES)):
            raise InputError(
                f"{self.path}: all its class scores are exactly zero, as int8 quantization leaves them where boxes and "
                "scores share one tensor; use the float model, or quantize without the last layers"
            )
        if len(self.image.names) == 1:
            return self
        fitting, fill = self.layout.fitting, self.layout.fill
        fitted = [fit_image(frame.image, self.size, fitting, fill)[0] for frame in video.sample(BACKGROUND_FRAMES)]
        return replace(self, background=np.median(fitted, axis=0).astype(np.uint8))

    def detect(self, image: NDArray[np.uint8]) -> Detections:
        """Find the vehicles in an image [height, width, 3], BGR; weak ones too, down to a score of 0.1."""
        return self.detect_all([image])[0]

    def detect_all(self, images: Iterable[NDArray[np.uint8]]) -> list[Detections]:
        """Detect in some images, step by step rather than one by one.

        A network evicts everything else from the processor's cache; steps that find their code and tables there cost
        half.
        """
        scaled = [(self._scaled(number, image), image.shape[:2]) for number, image in enumerate(images)]
        answers = [self._answer(small, shape) for small, shape in scaled]
        return [self._read(answer, shape) for answer, (_, shape) in zip(answers, scaled, strict=True)]

    def _place(self, shape: tuple[int, int]) -> tuple[tuple[slice, slice], Placement]:
        return window_of(shape, self.size, self.layout.fitting)

    def _scaled(self, number: int, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Image number `number` of a few, as large as the input shows it, in a buffer that is reused."""
        (rows, columns), _ = self._place(image.shape[:2])
        shape = (rows.stop - rows.start, columns.stop - columns.start, 3)
        room = self.rooms.get(number)
        if room is None or room.shape != shape:
            room = self.rooms[number] = np.empty(shape, np.uint8)
        shrink(image, room)
        return room

    def _answer(self, small: NDArray[np.uint8], shape: tuple[int, int]) -> list[NDArray[Any]]:
        """Outputs of the graph for a scaled image whose original shape was (height, width)."""
        (rows, columns), placement = self._place(shape)
        if placement not in self.feeds:
            empty = np.full((self.size[1], self.size[0], 3), self.layout.fill, np.uint8)
            canvases = [empty] if self.background is None else [empty, self.background]
            tensors = self.image.tensors(canvases, self.layout.normalization)
            self.feeds[placement] = tensors | side_feeds(self.session, self.image, self.size)
        feeds = self.feeds[placement]
        tensor = feeds[self.image.names[0]]
        window = tensor[:, rows, columns] if self.image.channels_last else tensor[:, :, rows, columns]
        self.layout.normalization.fill(small, window, self.image.channels_last)
        return run(self.session, feeds, self.reads)

    def _read(self, outputs: Sequence[NDArray[Any]], shape: tuple[int, int]) -> Detections:
        found = self.layout.decode(outputs, self.size, self.wanted, FLOOR)
        box = self._place(shape)[1].to_image(found.box)
        size = area(box)
        plausible = np.flatnonzero((size > 0) & (size < LARGEST * shape[0] * shape[1]))
        kept = plausible[suppress(box[plausible], np.asarray(found.score[plausible], float))]
        return Detections(
            box[kept],
            np.asarray(found.score[kept], float),
            np.array([self.names[place] for place in found.label[kept]], dtype=str),
        )

    def _is_mute(self, image: NDArray[np.uint8]) -> bool:
        answer = self._answer(self._scaled(0, image), image.shape[:2])
        return is_mute(self.layout, answer, self.size, len(self.names))


def load_detector(
    model: str | Path,
    *,
    layout: str | None = None,
    names: Sequence[str] | None = None,
    classes: Iterable[str] | None = None,
) -> OnnxDetector:
    """Load an ONNX detector, or a built-in one by name ("nanodet", "street").

    The layout is the one given, else the one its metadata names (`layout`), else the first that fits the metadata,
    names, shapes and values that a dry run shows.

    Parameters
    ----------
    model : path of an .onnx file, or the name of a built-in one
    layout : name of one of `LAYOUTS`
    names : class names in the model's order, for models that carry none
    classes : names of the classes to detect; road vehicles (car, van, bus, truck, motorcycle) by default

    Raises
    ------
    InputError, for a file that is missing, no ONNX graph, or no detector of a known layout, and for classes that the
    model does not know.
    """
    path = BUILT_IN.get(str(model), Path(model))
    if not path.is_file():
        raise InputError(f"{path}: no such file; give an .onnx detector, or a built-in one: {', '.join(BUILT_IN)}")
    session = open_session(path)
    metadata = session.get_modelmeta().custom_metadata_map
    _require_task(metadata, path)
    image = find_input(session, path)
    size, values = dry_run(session, image, metadata, path)
    outputs = tuple(entry.name for entry in session.get_outputs())
    stems = tuple(name.split(":")[0] for name in outputs)  # TensorFlow numbers the outputs of a node: "scores:0"
    graph = Graph(tuple(entry.name for entry in session.get_inputs()), stems, tuple(values), size, metadata)
    chosen = choose_layout(graph, layout, str(path))
    places = _places(stems, chosen, path)
    answer = [values[place] for place in places]
    with _read_as(chosen, path):
        count = chosen.classes([np.shape(part) for part in answer])
    known, named = class_names(metadata, count, names, str(path), chosen.names)
    with _read_as(chosen, path):
        found: Candidates = chosen.decode(answer, size, np.arange(len(known) if count else MOST_CLASSES), FLOOR)
        mute = chosen.dense and is_mute(chosen, answer, size, len(known))
    _require_named(found, len(known), path)
    wanted = np.array(wanted_classes(known, classes, str(path)), np.intp)
    reads = tuple(outputs[place] for place in places)
    threshold = float(metadata.get("threshold", chosen.threshold))
    return OnnxDetector(path, session, chosen, image, size, reads, tuple(known), named, wanted, threshold, mute)


def is_street(detector: Detector) -> bool:
    """Whether this is the built-in detector for the demo's renderings."""
    return isinstance(detector, OnnxDetector) and detector.path == BUILT_IN["street"]


def is_mute(layout: Layout, outputs: Sequence[NDArray[Any]], size: Size, classes: int) -> bool:
    """Whether all scores of all classes are exactly zero."""
    found: Candidates = layout.decode(outputs, size, np.arange(classes), 0.0)
    return not found.score.any()


def model_checksum(path: Path) -> str:
    """Checksum of a model: of its file, and of files of weights beside it that start with its name."""
    return "-".join(checksum(part) for part in sorted({path, *path.parent.glob(f"{path.name}?data*")}))


@contextmanager
def _read_as(layout: Layout, path: Path) -> Iterator[None]:
    try:
        yield
    except (IndexError, TypeError, ValueError) as error:
        raise no_detector(str(path), f"cannot be read as {layout.name} ({layout.graph})") from error


def _require_task(metadata: Mapping[str, str], path: Path) -> None:
    task = metadata.get("task", "detect")
    if task != "detect":
        raise InputError(f"{path}: is a model for the task {task!r}, not a detector; give one of the task 'detect'")


def _require_named(found: Candidates, names: int, path: Path) -> None:
    if (found.label >= names).any():
        raise InputError(
            f"{path}: finds class number {found.label.max()} (from 0) but {names} are named; give one name for each "
            "(--names)"
        )


def _places(outputs: Sequence[str], layout: Layout, path: Path) -> list[int]:
    """Indices of the outputs that a layout reads."""
    missing = [name for name in layout.reads if name not in outputs]
    if missing:
        raise no_detector(str(path), f"cannot be read as {layout.name} ({layout.graph}) without {', '.join(missing)}")
    return [outputs.index(name) for name in layout.reads] or list(range(len(outputs)))
