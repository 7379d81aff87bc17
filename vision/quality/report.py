"""Write the report folder: report.html, quality.json and the pictures as PNG."""

import hashlib
import json
import math
import re
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from vision.contract.errors import InputError
from vision.contract.figures import png_bytes, styled
from vision.contract.files import writing
from vision.jitter import LIMIT
from vision.quality.figures import class_figure, jitter_figure, route_figure
from vision.quality.heat import blank_scene, empty_scene, heat_map
from vision.quality.measures import Measures, measure, shared_edges
from vision.quality.page import Content, render
from vision.quality.route_effect import GAUGE_LENGTH
from vision.quality.setting import Setting, read_settings, read_tracks
from vision.quality.verdict import Verdict, grade, judge

FORMAT = "roadfiber track quality 1"
FACTS = "quality.json"
PNG_DPI = 150


def write_report(
    paths: Sequence[Path],
    out: Path,
    *,
    names: Sequence[str] | None = None,
    truth: Path | None = None,
    video: Path | None = None,
    gauge_length: float = GAUGE_LENGTH,
    frame_rate: float | None = None,
) -> dict[str, Any]:
    """Compare tables of tracks of one video, and write the report.

    Parameters
    ----------
    paths, names, frame_rate : as for `read_settings`
    out : folder to write: `report.html`, `quality.json`, `jitter.png`, `classes.png`, with meters `route.png`, with
        boxes `heat-NAME.png`; an earlier report there is replaced
    truth : true tracks, of a kind that `paths` may be; adds MOTA, IDF1 and HOTA
    video : shown behind the heat maps
    gauge_length : of the DAS, m, for the effect on the route

    Returns
    -------
    what `quality.json` holds

    Raises
    ------
    InputError
        If a table, the truth or the video cannot be used or they do not belong together, or `out` is something else.
    """
    check_target(out)
    if gauge_length <= 0:
        raise InputError(f"--gauge-length {gauge_length:g}: must be above 0 m")
    settings = read_settings(paths, names, frame_rate)
    true = None if truth is None else read_tracks(truth)
    edges = shared_edges(settings)
    found = [measure(setting, edges, gauge_length, true) for setting in settings]
    verdict = judge(found)
    heat = heat_maps(settings, video)
    created = datetime.now(UTC)
    content = Content(
        found=found,
        verdict=verdict,
        heat=heat,
        inputs=[*checksums("tracks", paths), *checksums("truth", [truth]), *checksums("video", [video])],
        title=video.name if video else ", ".join(setting.name for setting in settings),
        created=f"{created:%Y-%m-%d %H:%M} UTC",
        version=version("roadfiber"),
    )
    facts = plain(as_json(content, verdict))
    with writing(out) as folder:
        folder.mkdir()
        (folder / FACTS).write_text(json.dumps(facts, allow_nan=False, indent=1) + "\n", encoding="utf-8")
        (folder / "report.html").write_text(render(content), encoding="utf-8")
        write_pictures(folder, found, heat)
    return facts


def check_target(out: Path) -> None:
    """Raise InputError where `out` is there and is no report of this kind."""
    if not out.exists() or (out.is_dir() and not any(out.iterdir())):
        return
    try:
        mine = json.loads((out / FACTS).read_text(encoding="utf-8")).get("format") == FORMAT
    except (OSError, ValueError, AttributeError):
        mine = False
    if not mine:
        raise InputError(f"{out}: is there and is no earlier report of tracks; give another --out")


def heat_maps(settings: list[Setting], video: Path | None) -> dict[str, bytes]:
    """PNG of every setting's heat map, of those that have boxes."""
    boxed = [setting for setting in settings if setting.has_boxes]
    if not boxed:
        if video:
            raise InputError(f"{video}: the tables have no boxes to show on it; leave --video out")
        return {}
    scene = empty_scene(video, boxed) if video else blank_scene(boxed)
    return {setting.name: png_bytes(heat_map(setting, scene)) for setting in boxed}


def checksums(role: str, paths: Sequence[Path | None]) -> list[tuple[str, str, str]]:
    """(role, name, SHA-256) of files; None is passed over."""
    there = [path for path in paths if path]
    return [(role, path.name, hashlib.sha256(path.read_bytes()).hexdigest()) for path in there]


def as_json(content: Content, verdict: Verdict) -> dict[str, Any]:
    """What quality.json holds."""
    return {
        "format": FORMAT,
        "created": content.created,
        "version": content.version,
        "limit_m": LIMIT,
        "use": verdict.use,
        "because": verdict.because,
        "good_enough": verdict.grade,
        "verdict": verdict.words,
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
