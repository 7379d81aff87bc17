"""The layouts detectors are exported in, and the choice among them."""

from collections.abc import Mapping

from vision.contract.errors import InputError
from vision.detectors.distances import DISTANCES
from vision.detectors.layout import Graph, Layout
from vision.detectors.lists import LISTS
from vision.detectors.queries import QUERIES
from vision.detectors.yolo import YOLO

LAYOUTS = (*LISTS, *QUERIES, *YOLO, *DISTANCES)


def no_detector(model: str, why: str) -> InputError:
    """Say that a graph is not one of the known kinds of detector."""
    return InputError(f"{model}: not a detector of a known layout, it {why}; give a detector's export, as of YOLO11")


def layout_named(name: str, model: str) -> Layout:
    """Return the layout of a name; InputError where there is none."""
    by_name = {layout.name: layout for layout in LAYOUTS}
    if name not in by_name:
        raise InputError(f"{model}: layout {name!r} is unknown; known are {', '.join(by_name)}")
    return by_name[name]


def choose_layout(graph: Graph, given: str | None, model: str) -> Layout:
    """Return the layout given, else the one the metadata names, else the one that names, shapes and values fit.

    Raises InputError where there is none.
    """
    stated = given or _stated(graph.metadata)
    if stated:
        return layout_named(stated, model)
    for layout in LAYOUTS:
        if layout.matches(graph):
            return layout
    shapes = ", ".join(f"{n} {list(s)}" for n, s in zip(graph.outputs, graph.shapes, strict=True))
    raise no_detector(model, f"gives {shapes}")


def _stated(metadata: Mapping[str, str]) -> str | None:
    name = metadata.get("layout")  # other exporters write a tensor's axes there ("NCHW")
    return name if name in {layout.name for layout in LAYOUTS} else None
