"""Class names: the COCO list, spellings models differ in, and which classes are road vehicles."""

import ast
import logging
from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches

from vision.contract.classes import VEHICLES, plain_name
from vision.contract.errors import InputError
from vision.contract.text import LONGEST, is_name

log = logging.getLogger("roadfiber.detectors")

COCO_LIST = (
    "person,bicycle,car,motorcycle,airplane,bus,train,truck,boat,traffic light,fire hydrant,"
    "stop sign,parking meter,bench,bird,cat,dog,horse,sheep,cow,elephant,bear,zebra,giraffe,"
    "backpack,umbrella,handbag,tie,suitcase,frisbee,skis,snowboard,sports ball,kite,"
    "baseball bat,baseball glove,skateboard,surfboard,tennis racket,bottle,wine glass,cup,fork,"
    "knife,spoon,bowl,banana,apple,sandwich,orange,broccoli,carrot,hot dog,pizza,donut,cake,"
    "chair,couch,potted plant,bed,dining table,toilet,tv,laptop,mouse,remote,keyboard,"
    "cell phone,microwave,oven,toaster,sink,refrigerator,book,clock,vase,scissors,teddy bear,"
    "hair drier,toothbrush"
)
COCO = tuple(COCO_LIST.split(","))

# COCO numbers its classes 1 to 90 and never used these ten; models that answer by number leave them empty.
UNUSED_IDS = (0, 12, 26, 29, 30, 45, 66, 68, 69, 71, 83)


def _by_id() -> tuple[str, ...]:
    names = iter(COCO)
    return tuple("unused" if number in UNUSED_IDS else next(names) for number in range(91))


COCO_IDS = _by_id()
ASSUMED = "COCO's, which is assumed: its file names none"


def class_names(
    metadata: Mapping[str, str],
    count: int | None,
    given: Sequence[str] | None,
    model: str,
    usual: Sequence[str] = COCO,
) -> tuple[list[str], str]:
    """Names of a model's classes in its order: those given, else its metadata's (`names`), else the `usual` ones.

    And in words, which of these they are. `count` is how many classes the graph has, where its shapes say. Raises
    InputError where that does not agree.
    """
    names, source = (list(given), "as given") if given else (_metadata_names(metadata, model), "its own")
    if names is None:
        if count not in (None, len(usual)):
            raise InputError(f"{model}: has {count} classes and no names in its metadata; name them with --names")
        names, source = list(usual), ASSUMED
        if count is None:
            log.warning(
                "%s: its file neither names nor counts its classes, so COCO's names are assumed; where it was trained "
                "on others, cars become motorcycles and buses vanish: name them with --names",
                model,
            )
    if count not in (None, len(names)):
        raise InputError(f"{model}: has {count} classes but {len(names)} names; give one name for each (--names)")
    if odd := [name for name in names if not is_name(name)]:
        raise InputError(f"{model}: class name {odd[0][:LONGEST]!r} is no text in one line; name them with --names")
    return [plain_name(name) for name in names], source


def _metadata_names(metadata: Mapping[str, str], model: str) -> list[str] | None:
    if "names" not in metadata:
        return None
    try:
        names = ast.literal_eval(metadata["names"])
        if isinstance(names, Mapping):
            names = [names[key] for key in sorted(names, key=int)]
        return [str(name) for name in names]
    except (ValueError, SyntaxError, TypeError) as error:
        raise InputError(f"{model}: its metadata's class names cannot be read; name them with --names") from error


def wanted_classes(names: Sequence[str], wanted: Iterable[str] | None, model: str) -> list[int]:
    """Return the places in `names` of the classes to keep (road vehicles unless said otherwise).

    >>> wanted_classes(COCO, None, "a.onnx")
    [2, 3, 5, 7]
    """
    keep = {plain_name(name) for name in wanted} if wanted else set(VEHICLES)
    unknown = sorted(keep - set(names)) if wanted else []
    if unknown or not keep & set(names):
        known = ", ".join(names[:12]) + (", ..." if len(names) > 12 else "")
        near = [match for name in unknown for match in get_close_matches(name, names, n=1)]
        hint = f"did you mean {', '.join(near)}? " if near else ""
        raise InputError(f"{model}: knows no class {', '.join(unknown or sorted(keep))}; {hint}it has {known}")
    return [place for place, name in enumerate(names) if name in keep]
