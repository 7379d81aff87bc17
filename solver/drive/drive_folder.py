"""The run folder of a drive: written whole, and read as data."""

import json
from pathlib import Path
from typing import Any, Literal

import numpy as np

from solver.drive.drive_figures import MOST_LEGS
from solver.drive.drive_format import is_drive
from solver.drive.drive_page import drive_page
from solver.drive.drive_run import DriveRun
from solver.run.arrays import Expected, read_arrays
from solver.run.read_stored import read_model
from solver.run.report.joined import join
from solver.run.route_table import route_csv
from solver.run.stored import AnchorFile, FittedNumber, FrameFile, InputFile, StatementsFile, TrustFile
from solver.run.stored_types import Moment, Size, Spread, Stored, Text
from solver.survey.anchors import Anchor
from vision.contract import InputError, LocalFrame, require_writable, writing

MEND = "give a folder that `roadfiber locate` wrote of a drive"
#: Kind and axes of every array.
EXPECTED: Expected = {
    "channel": ("count", ("channel",)),
    "distance": ("number", ("channel",)),
    "route": ("number", ("channel", 3)),
    "covariance": ("number", ("channel", 3, 3)),
    "constrained": ("flag", ("channel",)),
    "loop": ("flag", ("channel",)),
    "in_loop": ("number", ("channel",)),
    "along": ("number", ("channel",)),
    "sigma_along": ("number", ("channel",)),
    "heard": ("flag", ("channel",)),
    "beside": ("flag", ("channel",)),
    "residual": ("number", ("leg", "channel")),
    "picture": ("number", ("row", "column")),
    "car_time": ("number", ("moment",)),
    "car_channel": ("number", ("moment",)),
    "car": ("number", ("moment", 2)),
    "map": ("number", ("vertex", 2)),
    "noise": ("number", ("channel",)),
}


class LoopFile(Stored):
    """A loop of slack.

    Attributes
    ----------
    first_channel, last_channel : in it
    length : of cable in it, m
    sigma : standard deviation of its length, m
    along : the map, m from its begin
    x, y : of the manhole in the local frame, m
    latitude, longitude : of the manhole, degrees
    probability : that there is one
    """

    first_channel: int
    last_channel: int
    length: float
    sigma: float
    along: float
    x: float
    y: float
    latitude: float
    longitude: float
    probability: float


class UnheardFile(Stored):
    """A stretch that the drive does not decide.

    Attributes
    ----------
    channels : first and last
    along : the map, m from its begin: from and to
    beside_the_car : whether the car drove beside it
    """

    channels: tuple[int, int]
    along: tuple[float, float]
    beside_the_car: bool


class MisstatedFile(Stored):
    """What files may state wrongly.

    Attributes
    ----------
    effect, title : its name in the catalogue, and in words
    value, sigma : how far it is from what is stated, and its standard deviation, relative
    shows : size from which on it would be named
    probability : that it is wrong; null where it is fitted
    fitted : whether it is part of the model
    words : the same in a sentence or two
    """

    effect: Text
    title: Text
    value: float
    sigma: Spread
    shows: Size
    probability: float | None
    fitted: bool
    words: Text


class DriveFile(Stored):
    """fit.json of a drive: what `solver.drive.locate_drive.locate_drive` makes.

    Attributes
    ----------
    format : of the run folder
    name : of the survey
    headline : where the fiber is, in a sentence
    trust : every check of the fit, and the sentence that follows from them
    next : what must be known of record and tracks, and what a second drive or a tap test should look at, a line each
    clock : how far the clocks are apart, in words
    converged : whether the clock stands still
    iterations : rounds until it did
    parameters : clock offset (s), length factor and polarity, by name
    misstated : what files may state wrongly, the most probable first
    effects : those that the model takes for stated wrongly, and fits
    map_reversed : whether the map runs against the channels
    loops : of slack in manholes
    unheard : stretches that no channel hears
    legs : runs of the car in one direction
    gps_left_out : fixes that are far from the smoothed drive
    map_length : of the map, m
    active_channels : first and last that the drive decides; empty where there are none
    frame : the local frame
    start : of the record that was read, UTC
    seconds_shown : length of that record, s
    anchors : as given
    settings : what the fit was given
    statements : what each file of the record and of the tracks states, and what was taken of it
    inputs : every file that was read, with its checksum
    timings : of each step, s
    versions : of Python, roadfiber and what it computes with
    created : UTC
    """

    format: Literal["roadfiber drive 3"]
    name: Text
    headline: Text
    trust: TrustFile
    next: tuple[Text, ...]
    clock: Text
    converged: bool
    iterations: int
    parameters: dict[Text, FittedNumber]
    misstated: tuple[MisstatedFile, ...]
    effects: tuple[Text, ...]
    map_reversed: bool
    loops: tuple[LoopFile, ...]
    unheard: tuple[UnheardFile, ...]
    legs: int
    gps_left_out: int
    map_length: Size
    active_channels: tuple[int, ...]
    frame: FrameFile
    start: Moment
    seconds_shown: Size
    anchors: tuple[AnchorFile, ...]
    settings: dict[Text, float | tuple[float, ...]]
    statements: tuple[StatementsFile, ...]
    inputs: tuple[InputFile, ...]
    timings: dict[Text, Size]
    versions: dict[Text, Text]
    created: Moment


def write_drive_run(folder: Path, run: DriveRun) -> None:
    """Write a run folder, whole or not at all; an earlier run there is replaced.

    `route.csv`, `route.geojson`, `fit.json`, `report.html`, `index.html` and `data.npz` go there.

    Raises
    ------
    InputError
        If `folder` holds something else than a run, or cannot be written.
    """
    from solver.run.folder import check_target

    if not is_drive(folder):
        check_target(folder)
    require_writable(folder)
    table = run.route
    text = {name: table[name].map(lambda flag: str(bool(flag)).lower()) for name in ("loop", "heard")}
    text |= {name: table[name].map("{:.2f}".format) for name in ("along", "sigma_along")}
    with writing(folder) as temporary:
        temporary.mkdir()
        (temporary / "route.csv").write_text(route_csv(table.assign(**text)), encoding="utf-8")
        (temporary / "route.geojson").write_text(json.dumps(run.features(), allow_nan=False), encoding="utf-8")
        (temporary / "fit.json").write_text(json.dumps(run.facts, allow_nan=False, indent=1), encoding="utf-8")
        kept: dict[str, Any] = {name: run.arrays[name] for name in EXPECTED}
        np.savez_compressed(temporary / "data.npz", **kept)
        (temporary / "report.html").write_text(drive_page(run), encoding="utf-8")
        join(temporary, called=folder.resolve().name)


def read_drive_run(folder: Path) -> DriveRun:
    """Read the run folder of a drive back; nothing in it is executed.

    Raises
    ------
    InputError
        If it is no such folder, or a part of it is missing or corrupt.
    """
    folder = Path(folder)
    facts: dict[str, Any] = read_model(folder / "fit.json", DriveFile, MEND).model_dump(mode="json")
    arrays = read_arrays(folder / "data.npz", EXPECTED)
    if len(arrays["residual"]) > MOST_LEGS or not np.isfinite(arrays["route"]).all():
        raise InputError(f"{folder / 'data.npz'}: not the arrays of a drive; run `roadfiber locate` again")
    frame = LocalFrame(tuple(facts["frame"]["origin"]), facts["frame"]["x_azimuth"])
    anchors = [Anchor(**one) for one in facts["anchors"]]
    return DriveRun(frame, facts, arrays, anchors, folder.resolve())
