"""Checks of a survey before it is located: files, units, coverage, overlap in time, clocks, and places on the map."""

import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import roadfiber as rf
from roadfiber.web.site_draft import Draft
from solver.survey.anchors import stated_anchors
from solver.survey.das.description import Description, describe
from solver.survey.site import Site, read_site
from solver.survey.site_sections import CameraSection
from solver.survey.survey import Survey
from vision.contract import InputError, LocalFrame
from vision.contract.statements import Statements, caution_lines
from vision.contract.table import read_tracks

if TYPE_CHECKING:
    import pandas as pd

#: A check's verdicts, and how they begin on the page.
SIGNS = {"good": "✓ good", "look": "! look", "failed": "✗ failed"}
#: m from the origin beyond which a place is not of one street; sigmas of a clock's offset that are told.
FAR, CLOCK = 5000.0, 3.0
#: m from all vehicles beyond which a known point of the fiber is not beside their road.
ASIDE = 100.0
#: s by which clocks may differ before it is worth a look.
LATE = 0.5

Span = tuple[np.datetime64, np.datetime64]


@dataclass(frozen=True)
class Check:
    """One check: what was looked at, whether it is good, and what was found, in words."""

    what: str
    verdict: str
    words: str


@dataclass
class Checked:
    """What was found of a survey.

    Parameters
    ----------
    checks : in their order
    spans : what was recorded from when to when, UTC
    tracks : name -> x, y of each vehicle, m
    anchors : name, x, y, m
    azimuth : of +x, degrees
    statements : what each file of the record and of the tracks states, and what is taken of it
    """

    checks: list[Check] = field(default_factory=list)
    spans: dict[str, Span] = field(default_factory=dict)
    tracks: dict[str, tuple[list[float], list[float]]] = field(default_factory=dict)
    anchors: list[tuple[str, float, float]] = field(default_factory=list)
    azimuth: float = 0.0
    statements: list[Statements] = field(default_factory=list)

    @property
    def able(self) -> bool:
        """Whether a site.toml of it may be written."""
        return bool(self.checks) and all(one.verdict != "failed" for one in self.checks)

    def add(self, what: str, verdict: str, words: str) -> None:
        """Note a check."""
        self.checks.append(Check(what, verdict, words))


def check(folder: Path, draft: Draft, tell: Callable[[str], None] = lambda line: None) -> Checked:
    """Check a survey whose site.toml would stand in a folder; nothing is left there.

    Parameters
    ----------
    folder : that names in the draft are relative to
    tell : called with what is looked at
    """
    found = Checked()
    try:
        site = drafted(folder, draft)
    except InputError as error:
        found.add("Fields", "failed", str(error))
        return found
    found.add("Fields", "good", "all that site.toml needs is there, and every file is found")
    found.azimuth = site.frame.x_azimuth
    steps: list[tuple[str, Callable[[], Any]]] = [("Record", lambda: check_record(found, site))]
    if site.camera is not None:
        camera = site.camera
        steps.append(("Video", lambda: check_camera(found, camera, site.frame)))
    if site.trajectories is not None:
        steps.append(("Vehicles", lambda: check_tracks(found, site)))
    if site.anchors is not None:
        steps.append(("Anchors", lambda: check_anchors(found, site)))
    for what, step in steps:
        tell(what)
        try:
            step()
        except InputError as error:
            found.add(what, "failed", str(error))
    check_overlap(found)
    if site.trajectories is not None and found.able:
        tell("Clocks")
        check_together(found, folder, draft)
    return found


def drafted(folder: Path, draft: Draft) -> Site:
    """The site of a draft, read as if it stood in the folder."""
    with tempfile.NamedTemporaryFile("w", dir=folder, prefix=".site-", suffix=".toml", encoding="utf-8") as file:
        file.write(draft.text())
        file.flush()
        try:
            return read_site(Path(file.name))
        except InputError as error:
            raise InputError(str(error).replace(file.name, "site.toml")) from error


def check_record(found: Checked, site: Site) -> None:
    """Headers of the DAS files: times, channels, gauge, unit."""
    known: Description = describe(site.das.files, **site.das.said)
    first, last = known.channels
    found.statements += known.statements
    found.spans["DAS record"] = known.start, known.end
    words = (
        f"{known.files} file{'s' * (known.files != 1)} of {known.stored.quantity.replace('_', ' ')}, "
        f"channels {first} to {last} every "
        f"{known.channel_spacing:g} m, gauge {known.gauge_length:g} m; {span_words(known.start, known.end)}"
    )
    found.add("Record", "look" if known.lines else "good", "; ".join([words, *known.notes, *known.lines]))


def check_camera(found: Checked, camera: CameraSection, frame: LocalFrame) -> None:
    """Video, calibration and frame: that they belong together, and when it was."""
    from vision.camera import Calibration
    from vision.video import open_video

    video, view = open_video(camera.video), Calibration.read(camera.calibration)
    view.require_size(video.width, video.height, camera.video)
    view.require_frame(frame, camera.calibration)
    start = np.datetime64(camera.start.astimezone(UTC).replace(tzinfo=None), "ns")
    first, last = (start + np.timedelta64(round(1e9 * (at - camera.clock_offset)), "ns") for at in video.time[[0, -1]])
    found.spans["video"] = first, last
    words = f"{len(video)} pictures of {video.width} x {video.height}; {span_words(first, last)}"
    line = video.header_line(start)
    found.add("Video", "look" if line else "good", f"{words}; {line}" if line else words)


def check_tracks(found: Checked, site: Site) -> None:
    """Trajectories: how many, of which classes, where."""
    assert site.trajectories is not None
    table, stated = read_tracks(site.trajectories.files, site.frame)
    found.statements += stated
    for line in caution_lines(stated):
        found.add("Fixes", "look", line)
    times = table["time"].dt.tz_convert(None).to_numpy()
    found.spans["vehicles"] = times.min(), times.max()
    found.tracks = {
        str(name): (rows["x"].round(2).tolist(), rows["y"].round(2).tolist())
        for name, rows in table.groupby("track_id")
    }
    classes = ", ".join(f"{count} {name}" for name, count in class_counts(table).items())
    x = table["x"]
    words = f"{table['track_id'].nunique()} vehicles ({classes}), x from {x.min():.0f} to {x.max():.0f} m"
    sigma = float(np.median(np.hypot(table["sigma_x"], table["sigma_y"])))
    if sigma > 1.0:
        found.add("Vehicles", "look", f"{words}; places are good to {sigma:.1f} m, and the route to no better")
    else:
        found.add("Vehicles", "good", f"{words}; places are good to {sigma:.2f} m")
    far = float(np.hypot(x, table["y"]).max())
    if far > FAR:
        found.add("Map", "look", f"vehicles are up to {far / 1000:.0f} km from the origin: is it that of this street?")


def class_counts(table: "pd.DataFrame") -> dict[str, int]:
    """Number of vehicles of each class."""
    return dict(table.groupby("track_id")["class"].first().value_counts())


def check_anchors(found: Checked, site: Site) -> None:
    """Anchors: that they are near the vehicles."""
    assert site.anchors is not None
    anchors, stated = stated_anchors(site.anchors.file, site.frame)
    found.statements += stated
    found.anchors = [(one.name, one.x, one.y) for one in anchors]
    words = f"{len(anchors)} known points, channels {anchors[0].channel:g} to {anchors[-1].channel:g}"
    every = (
        np.concatenate([np.column_stack(one) for one in found.tracks.values()]) if found.tracks else np.zeros((0, 2))
    )
    off = [float(np.hypot(*(every - (x, y)).T).min()) for _, x, y in found.anchors if len(every)]
    if off and max(off) > 100:
        found.add(
            "Anchors", "look", f"{words}; one is {max(off):.0f} m from all vehicles: origin, azimuth, or x and y?"
        )
        return
    found.add("Anchors", "look" if stated else "good", "; ".join([words, *caution_lines(stated)]))


def check_overlap(found: Checked) -> None:
    """That the record was made while vehicles were seen."""
    record = found.spans.get("DAS record")
    for name, (first, last) in found.spans.items():
        if record is None or name == "DAS record":
            continue
        both = (min(last, record[1]) - max(first, record[0])) / np.timedelta64(1, "s")
        if both <= 0:
            away = "before" if last < record[0] else "after"
            words = f"the {name} end {away} the record: see the zones of both clocks ({span_words(first, last)})"
            found.add("Overlap in time", "failed", words)
        else:
            share = both / max((last - first) / np.timedelta64(1, "s"), 1e-9)
            verdict = "good" if share > 0.5 else "look"
            found.add("Overlap in time", verdict, f"{both:.0f} s of the {name} were recorded ({100 * share:.0f} %)")


def check_together(found: Checked, folder: Path, draft: Draft) -> None:
    """That record, tracks and anchors are of one road and one time, as `locate` finds before it fits."""
    from solver.run.locate import begin

    with tempfile.NamedTemporaryFile("w", dir=folder, prefix=".site-", suffix=".toml", encoding="utf-8") as file:
        file.write(draft.text())
        file.flush()
        try:
            survey = Survey.read(Path(file.name))
            for line in begin(survey, [], {}).found.disputed:
                found.add("Anchors", "look", line)
            heard = rf.vehicles(survey)
        except InputError as error:
            found.add("Coverage and clocks", "look", str(error).replace(file.name, "site.toml"))
            return
    known = np.isfinite(heard.clock_offset)
    late = known and abs(heard.clock_offset) > max(LATE, CLOCK * heard.clock_sigma)
    found.add("Coverage and clocks", "look" if late or not known else "good", heard.headline)


def span_words(first: np.datetime64, last: np.datetime64) -> str:
    """From when to when, UTC.

    >>> span_words(np.datetime64("2025-08-11T06:00:00"), np.datetime64("2025-08-11T06:03:00"))
    '2025-08-11 06:00:00 to 06:03:00 UTC'
    """
    begin, end = (str(np.datetime_as_string(one, unit="s")).replace("T", " ") for one in (first, last))
    return f"{begin} to {end[11:] if begin[:10] == end[:10] else end} UTC"
