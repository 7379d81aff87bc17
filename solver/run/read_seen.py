"""Reading what is seen of a run from its folder, without its model."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from solver.fit.result import Corner, FitResult, Parameter
from solver.noise.law import NoiseLaw
from solver.run.arrays import Arrays, read_arrays
from solver.run.ladder_file import read_ladder
from solver.run.pass_arrays import passes_from
from solver.run.read_stored import read_model
from solver.run.seen import Seen
from solver.run.soundness import check_arrays
from solver.run.stored import FitFile
from solver.survey.anchors import Anchor
from vision.contract import InputError, LocalFrame

# What of a FitResult are arrays, and so goes into data.npz; maps are stored in single precision, 1e-7 of their value.
# What was measured is in the problem's record.
ROUTE = ("channel", "distance", "route", "covariance", "tails", "constrained", "data_share")
ARRAYS = (*ROUTE, "vector", "samples", "fitted_channel", "noise")
MAPS = ("model", "weight")


def read_facts(folder: Path) -> dict[str, Any]:
    """Read fit.json of a run folder.

    Raises
    ------
    InputError
        If there is none, or it is not of a run.
    """
    path = Path(folder) / "fit.json"
    mend = "give a folder that `roadfiber locate` wrote"
    if not path.is_file():
        raise InputError(f"{folder}: no run folder (it has no fit.json); {mend}")
    return read_model(path, FitFile, mend).model_dump(mode="json")


def number(value: float | None) -> float:
    """Return a number of fit.json, where null is what is not known."""
    return float("nan") if value is None else float(value)


@contextmanager
def read_parts(folder: Path) -> Iterator[Arrays]:
    """The checked arrays of a run folder; a ValueError that comes of them is told as one of its data.npz."""
    path = Path(folder) / "data.npz"
    arrays = read_arrays(path)
    try:
        check_arrays(arrays)
        yield arrays
    except (ValueError, OverflowError) as error:
        raise InputError(f"{path}: not the arrays of this run ({error}); run `roadfiber locate` again") from error


def parts_of(facts: dict[str, Any], arrays: Arrays) -> dict[str, Any]:
    """What of a run is in its facts and arrays, but for its model; ValueError where they contradict each other."""
    maps: dict[str, Any] = {name: arrays[name].astype(np.float64) for name in MAPS}
    maps["measured"] = arrays["record"][arrays["samples"]].astype(np.float64)
    maps |= {name: arrays[name] for name in ARRAYS}
    parameters = {
        name: Parameter(number(p["value"]), number(p["sigma"]), p["unit"], p["free"])
        for name, p in facts["parameters"].items()
    }
    scalars = {f.name: facts[f.name] for f in fields(FitResult) if f.name in facts and f.name != "parameters"}
    scalars |= {name: number(facts[name]) for name in ("chi2", "chi2_per_dof", "cost")}
    scalars["corners"] = tuple(Corner(**one) for one in facts["corners"])
    return {
        "result": FitResult(**maps, **scalars, parameters=parameters, law=law_from(arrays)),
        "frame": LocalFrame(tuple(facts["frame"]["origin"]), facts["frame"]["x_azimuth"]),
        "start": np.datetime64(facts["start"].removesuffix("Z"), "ns"),
        "time": arrays["time"],
        "passes": passes_from(arrays),
        "anchors": [Anchor(**anchor) for anchor in facts["anchors"]],
        "facts": facts,
        "added": arrays["added"] if facts["corridor"]["full"] else None,
    }


def law_from(arrays: Arrays) -> NoiseLaw:
    """The law of the noise."""
    return NoiseLaw(**{f.name: arrays[f"law_{f.name}"] for f in fields(NoiseLaw)})


def read_seen(folder: Path) -> Seen:
    """Read what is seen of the run in a folder; no code is run, and no plugin is asked for.

    Raises
    ------
    InputError
        If it is not a run folder, or a part of it is missing or corrupt.
    """
    facts = read_facts(folder)
    with read_parts(folder) as arrays:
        parts = parts_of(facts, arrays)
    return Seen(**parts, rungs=tuple(read_ladder(folder)), folder=Path(folder).resolve())
