"""Write the report folder: report.html, quality.json and the pictures as PNG."""

import hashlib
import json
import math
import re
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from matplotlib.figure import Figure

from vision.contract.errors import InputError
from vision.contract.figures import png_bytes, styled
from vision.contract.files import require_writable, writing
from vision.frames import Video
from vision.interpolate import BOX
from vision.jitter import LIMIT
from vision.quality.classes import compared_classes, of_classes, tracks_by_class, without_parked
from vision.quality.figures import class_figure, jitter_figure, route_figure
from vision.quality.heat import blank_scene, empty_scene, heat_map
from vision.quality.measures import Measures, measure, shared_edges
from vision.quality.page import Content, Truth, render
from vision.quality.reading import read_tracks
from vision.quality.route_effect import GAUGE_LENGTH
from vision.quality.scores import looked_at
from vision.quality.setting import Picture, Setting, Tables, clip_boxes, read_settings
from vision.quality.verdict import grade, judge
from vision.stills import ANY_RATE
from vision.video import open_video

if TYPE_CHECKING:
    import pandas as pd

FORMAT = "roadfiber track quality 2"
FACTS = "quality.json"
PNG_DPI = 150


def write_report(
    paths: Sequence[Path],
    out: Path,
    *,
    names: Sequence[str] | None = None,
    truth: Path | None = None,
    classes: Sequence[str] | None = None,
    video: Path | str | None = None,
    gauge_length: float = GAUGE_LENGTH,
    frame_rate: float | None = None,
) -> dict[str, Any]:
    """Compare tables of tracks of one video, and write the report.

    Parameters
    ----------
    paths, names, frame_rate : as for `read_settings`; tables that cannot be used are left out, with the reason
    out : folder to write: `report.html`, `quality.json`, `jitter.png`, `classes.png`, with meters `route.png`, with
        boxes `heat-NAME.png`; an earlier report there is replaced
    truth : true tracks, of a kind that `paths` may be; adds MOTA, IDF1 and HOTA
    classes : to compare; by default road vehicles, and what else all tables and the truth have
    video : shown behind the heat maps; boxes are clipped to its picture
    gauge_length : of the DAS, m, for the effect on the route

    Returns
    -------
    what `quality.json` holds

    Raises
    ------
    InputError
        If no table, or the truth or the video cannot be used or they do not belong together, or `out` is something
        else.
    """
    check_target(out)
    if gauge_length <= 0:
        raise InputError(f"--gauge-length {gauge_length:g}: must be above 0 m")
    clip = open_video(video, rate=ANY_RATE) if video else None
    picture = Picture(Path(clip.path), clip.width, clip.height, clip.index, clip.time) if clip else None
    tables = read_settings(paths, names, frame_rate, picture)
    if clip and not any(setting.has_boxes for setting in tables.settings):
        raise InputError(f"{video}: the tables have no boxes to show on it; leave --video out")
    tables, true = same_classes(tables, read_truth(truth, picture), classes)
    settings = tables.settings
    edges = shared_edges(settings)
    known = (true.tracks, true.others) if true else (None, None)
    found = [measure(setting, edges, gauge_length, *known) for setting in settings]
    heat = heat_maps(settings, clip)
    created = datetime.now(UTC)
    content = Content(
        found=found,
        verdict=judge(found),
        truth=true,
        left_out=tables.left_out,
        heat=heat,
        inputs=[
            *checksums("tracks", [one.path for one in settings]),
            *checksums("truth", [truth]),
            *([("video", clip.path.name, clip.checksum)] if clip else []),
        ],
        title=clip.path.name if clip else ", ".join(setting.name for setting in settings),
        created=f"{created:%Y-%m-%d %H:%M} UTC",
        version=version("roadfiber"),
    )
    facts = plain(as_json(content))
    with writing(out) as folder:
        folder.mkdir()
        (folder / FACTS).write_text(json.dumps(facts, allow_nan=False, indent=1) + "\n", encoding="utf-8")
        (folder / "report.html").write_text(render(content), encoding="utf-8")
        write_pictures(folder, found, heat)
    return facts


def read_truth(path: Path | None, picture: Picture | None) -> "pd.DataFrame | None":
    """Read true tracks, boxes clipped to the picture; None without a file."""
    if path is None:
        return None
    table = read_tracks(path)
    return clip_boxes(table, picture, path)[0] if picture and set(BOX) <= set(table) else table


def same_classes(
    tables: Tables, truth: "pd.DataFrame | None", wanted: Sequence[str] | None
) -> tuple[Tables, Truth | None]:
    """Keep of all tables, and of the truth, the classes that are compared; and of the truth what drives."""
    sides = [setting.tracks for setting in tables.settings] + ([] if truth is None else [truth])
    names = compared_classes(sides, wanted)

    def keep(setting: Setting) -> Setting:
        tracks, _, others = of_classes(setting.tracks, names, str(setting.path))
        return replace(setting, tracks=tracks.reset_index(drop=True), others=others)

    tables = tables.each(keep)
    if truth is None:
        return tables, None
    known = Truth(*without_parked(*of_classes(truth, names, "--truth")))

    def shared(setting: Setting) -> Setting:
        looked_at(known.tracks, setting.tracks, str(setting.path))
        return setting

    return tables.each(shared), known


def check_target(out: Path) -> None:
    """Raise InputError where `out` is there and is not a report of this kind, or cannot be written."""
    if out.exists() and not (out.is_dir() and not any(out.iterdir())):
        try:
            mine = json.loads((out / FACTS).read_text(encoding="utf-8")).get("format") == FORMAT
        except (OSError, ValueError, AttributeError):
            mine = False
        if not mine:
            raise InputError(f"{out}: is there and is not an earlier report of tracks; give another --out")
    require_writable(out)


def heat_maps(settings: list[Setting], clip: Video | None) -> dict[str, bytes]:
    """PNG of every setting's heat map, of those that have boxes."""
    boxed = [setting for setting in settings if setting.has_boxes]
    if not boxed:
        return {}
    scene = empty_scene(clip) if clip else blank_scene(boxed)
    return {setting.name: png_bytes(heat_map(setting, scene)) for setting in boxed}


def checksums(role: str, paths: Sequence[Path | None]) -> list[tuple[str, str, str]]:
    """(role, name, SHA-256) of files; None is passed over."""
    there = [path for path in paths if path]
    return [(role, path.name, hashlib.sha256(path.read_bytes()).hexdigest()) for path in there]


def as_json(content: Content) -> dict[str, Any]:
    """What quality.json holds."""
    verdict, truth = content.verdict, content.truth
    return {
        "format": FORMAT,
        "created": content.created,
        "version": content.version,
        "limit_m": LIMIT,
        "use": verdict.use,
        "because": verdict.because,
        "rule": verdict.rule,
        "good_enough": verdict.grade,
        "verdict": verdict.words,
        "notes": content.notes(),
        "left_out": list(content.left_out),
        "truth": truth and {"tracks_by_class": tracks_by_class(truth.tracks), "tracks_not_compared": truth.left_out},
        "settings": [one.as_json() | {"good_enough": grade(one)} for one in content.found],
        "inputs": [{"role": role, "name": name, "sha256": code} for role, name, code in content.inputs],
    }


def plain(value: Any) -> Any:
    """Return `value` with numbers that JSON has: null for NaN, six significant digits.

    >>> plain({"a": float("nan"), "b": [0.12345678]})
    {'a': None, 'b': [0.123457]}
    """
    if isinstance(value, dict):
        return {name: plain(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [plain(part) for part in value]
    if isinstance(value, float):
        return float(f"{value:.6g}") if math.isfinite(value) else None
    return value


def write_pictures(folder: Path, found: Sequence[Measures], heat: dict[str, bytes]) -> None:
    """Write the figures as PNG."""
    save(jitter_figure(found), folder / "jitter.png")
    save(class_figure([one.setting for one in found]), folder / "classes.png")
    if found[0].effect is not None:
        save(route_figure(found), folder / "route.png")
    for name, png in heat.items():
        (folder / f"heat-{re.sub(r'[^A-Za-z0-9_.-]', '_', name)}.png").write_bytes(png)


@styled
def save(figure: Figure, path: Path) -> None:
    """Write a figure as PNG on white."""
    figure.savefig(path, dpi=PNG_DPI, facecolor="white")
