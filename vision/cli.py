"""`roadfiber track` and `roadfiber quality`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    import pandas as pd

app = typer.Typer()


@app.command()
def track(
    video: Annotated[Path, typer.Argument(help="Video of a fixed camera, or a folder of stills.")],
    calibration: Annotated[
        Path | None, typer.Option(help="Calibration of the view; without it tracks stay in pixels.")
    ] = None,
    detector: Annotated[
        str, typer.Option(help="nanodet or street (built in, the latter for the demo), or the path of an .onnx model.")
    ] = "nanodet",
    layout: Annotated[str | None, typer.Option(help="Layout of the model, where it is not recognized.")] = None,
    names: Annotated[str | None, typer.Option(help="Class names in the model's order, by comma.")] = None,
    classes: Annotated[str | None, typer.Option(help="Classes to follow, by comma.  [default: road vehicles]")] = None,
    start: Annotated[
        str | None,
        typer.Option(help="UTC of the video's first instant, as 2025-08-11T06:00:00.25Z.  [default: its header]"),
    ] = None,
    frame_rate: Annotated[
        float | None,
        typer.Option(help="Of a folder of stills, 1/s.  [default: times in their EXIF data or their names]"),
    ] = None,
    clock_offset: Annotated[float, typer.Option(help="How far the camera's clock is ahead, s; it is taken off.")] = 0.0,
    min_score: Annotated[
        float | None, typer.Option(min=0.0, max=1.0, help="Score that starts a track.  [default: the model's]")
    ] = None,
    every: Annotated[int, typer.Option(min=1, help="Look at every n-th frame.")] = 1,
    cache: Annotated[
        Path | None,
        typer.Option(
            envvar="ROADFIBER_CACHE",
            help="Folder that keeps detections, 1 GB of them or ROADFIBER_CACHE_MB.  [default: the user's cache]",
        ),
    ] = None,
    no_cache: Annotated[bool, typer.Option("--no-cache", help="Neither use nor keep detections.")] = False,
    appearance: Annotated[
        Path | None,
        typer.Option(help="ONNX embedding, [1,3,h,w] to [1,d]: knows hidden vehicles by their looks."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help=".csv, .parquet, or MOTChallenge .txt.  [default: trajectories.csv; pixels: boxes.csv]"),
    ] = None,
    draw: Annotated[
        Path | None,
        typer.Option(help=".mp4 to write: the video with boxes, tails, ids, classes and, with a calibration, speeds."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
) -> None:
    """Follow the vehicles of a video: metric trajectories with a sigma per fix.

    With a calibration (`roadfiber calibrate ground`), writes one row per vehicle and frame: UTC, class, the ground
    under the middle of the wheelbase and its sigma in meters, and the box; and beside it, in OUT.dropped, what was
    detected and could not be placed, with the cause. Without one, boxes in pixels.
    Detections are kept: a second look, with another calibration or score, costs nothing, and a run that was
    interrupted goes on where it stopped.

    Example: `roadfiber track street.mp4 --calibration calibration.json --start 2025-08-11T06:00:00Z`
    """
    from vision.appearance import Appearance
    from vision.cache import cache_folder
    from vision.camera import Calibration
    from vision.contract.files import require_writable
    from vision.detectors import load_detector
    from vision.drawn_video import draw_video, require_drawable
    from vision.dropped import write_dropped
    from vision.pipeline import box_tracks, on_road, start_time, summarize, utc
    from vision.stills import require_rate
    from vision.video import open_video

    out = out or Path("trajectories.csv" if calibration else "boxes.csv")
    check_suffix(out)
    require_writable(out)
    if draw:
        require_drawable(draw, video)
        require_writable(draw)
    view = Calibration.read(calibration) if calibration else None
    model = load_detector(detector, layout=layout, names=split(names), classes=split(classes))
    kept = None if no_cache else cache or cache_folder()
    require_rate(video, frame_rate)
    clip = open_video(video, kept, frame_rate)
    if view:
        view.require_size(clip.width, clip.height, video)
    zero = start_time(start, clip) if view or start else None
    looks = Appearance.load(appearance) if appearance else None
    table, speed, far = box_tracks(
        clip, model, calibration=view, min_score=min_score, every=every, cache=kept, appearance=looks
    )
    dropped = None
    if view and zero is not None:
        table, dropped = on_road(table, view, zero, clock_offset, video, far)
    elif zero is not None:
        table = table.assign(time=utc(table["time"], zero, clock_offset))
    write_table(table, out)
    write_dropped(dropped, out)
    if draw:
        draw_video(clip, table, draw, every)
    summary = summarize(table, speed, dropped) | {"metric": view is not None, "out": str(out)}
    report(summary | ({"drawn": str(draw)} if draw else {}), as_json)


@app.command()
def quality(
    tracks: Annotated[
        list[Path],
        typer.Argument(help="Of one video: .csv or .parquet of `track`, MOTChallenge .txt, .ottrk or .otdet."),
    ],
    out: Annotated[Path, typer.Option(help="Folder to write; an earlier report there is replaced.")] = Path("quality"),
    names: Annotated[str | None, typer.Option(help="Names to show, by comma.  [default: the files']")] = None,
    truth: Annotated[Path | None, typer.Option(help="True tracks; adds MOTA, IDF1 and HOTA.")] = None,
    classes: Annotated[
        str | None,
        typer.Option(help="Classes to compare, by comma.  [default: road vehicles, and what all tables have]"),
    ] = None,
    video: Annotated[Path | None, typer.Option(help="Video of the tracks, shown behind the heat maps.")] = None,
    gauge_length: Annotated[float, typer.Option(help="Of the DAS, m, for the effect on the route.")] = 10.0,
    frame_rate: Annotated[
        float | None, typer.Option(help="Of the video, 1/s, for files without a clock.  [default: the other tables']")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print quality.json.")] = False,
) -> None:
    """Compare the tracks of detectors or settings on one video: which to use, and is it good enough for the fiber.

    Writes report.html (opens offline), quality.json and the pictures. Jitter is judged by the 35 cm rule. A table that
    cannot be read is told and left out. The speed is shown where `track --json` was kept beside its table:
    `roadfiber track ... --out a.csv --json > a.json`.

    Example: `roadfiber quality yolox.csv nanodet.csv --video street.mp4 --out quality`
    """
    import json

    from vision.contract.errors import InputError
    from vision.quality import write_report

    if frame_rate is not None and frame_rate <= 0:
        raise InputError(f"--frame-rate {frame_rate:g}: must be above 0")
    facts = write_report(
        tracks,
        out,
        names=split(names),
        truth=truth,
        classes=split(classes),
        video=video,
        gauge_length=gauge_length,
        frame_rate=frame_rate,
    )
    if as_json:
        print(json.dumps(facts))
        return
    for setting in facts["settings"]:
        print(setting_line(setting))
    for note in facts["notes"]:
        print(note)
    print(f"use {facts['use']}: {facts['because']}. {facts['verdict']}")
    print(f"chosen by {facts['rule']}\nwrote {out / 'report.html'}")


def setting_line(setting: "dict[str, Any]") -> str:
    """One line on a setting of quality.json.

    >>> setting_line({"name": "a", "tracks": 3, "frames_per_track": 40.0, "jitter": {"mean_after": 0.1}, "unit": "m",
    ...     "good_enough": "good", "scores": {"mota": 0.9, "idf1": 0.8, "hota": 0.7}})
    'a: 3 vehicles, 40 frames each, jitter 0.1 m (good), MOTA 0.9, IDF1 0.8, HOTA 0.7'
    """
    jitter = setting["jitter"]["mean_after"]
    size = "unknown" if jitter is None else f"{jitter:.2g} {setting['unit']}"
    grade = f" ({setting['good_enough']})" if setting["unit"] == "m" else ""
    scores = setting["scores"] or {}
    three = "".join(f", {name.upper()} {scores[name]:.3g}" for name in ("mota", "idf1", "hota") if scores)
    frames = f"{setting['frames_per_track']:.0f} frames each"
    return f"{setting['name']}: {setting['tracks']} vehicles, {frames}, jitter {size}{grade}{three}"


def placed_line(summary: dict[str, Any]) -> str:
    """Say how many detected fixes were placed on the road, and why others were not.

    >>> counts = {"cut by the border of the picture": 20, "above the horizon": 5}
    >>> placed_line({"fixes_placed": 75, "fixes_not_placed": counts, "tracks_not_placed": 1})
    '75 of 100 detected fixes placed on the road; 20 cut by the border of the picture, 5 above the horizon; 1 vehicle \
not at all'
    """
    from vision.dropped import words

    placed, left = summary["fixes_placed"], summary["fixes_not_placed"]
    gone = summary["tracks_not_placed"]
    why = f"; {words(left)}" if left else ""
    vehicles = f"; {gone} vehicle{'s' * (gone > 1)} not at all" if gone else ""
    return f"{placed} of {placed + sum(left.values())} detected fixes placed on the road{why}{vehicles}"


def split(text: str | None) -> list[str] | None:
    """Parts of a list given by comma; None for none.

    >>> split("car, van")
    ['car', 'van']
    """
    return [part.strip() for part in text.split(",") if part.strip()] if text else None


def check_suffix(out: Path) -> None:
    """Raise InputError, before the work rather than after it, unless `out` is a .csv, .parquet or .txt file."""
    from vision.contract.errors import InputError

    if out.suffix.lower() not in (".csv", ".parquet", ".txt"):
        raise InputError(f"{out}: tracks are written as .csv or .parquet, or MOTChallenge .txt; give such a suffix")


def write_table(table: "pd.DataFrame", out: Path) -> None:
    """Write trajectories, or tracks in pixels, whole or not at all."""
    from vision.contract.files import writing
    from vision.contract.table import write_trajectories
    from vision.exchange import write_mot

    if out.suffix.lower() == ".txt":
        write_mot(table, out)
        return
    if "x" in table:
        write_trajectories(table, out)
        return
    with writing(out) as temporary:
        if out.suffix.lower() == ".parquet":
            table.to_parquet(temporary, index=False)
        else:
            table.to_csv(temporary, index=False, float_format="%.10g")


def report(summary: dict[str, Any], as_json: bool) -> None:
    """Print what was found, for people or as JSON."""
    import json

    if as_json:
        print(json.dumps(summary))
        return
    by_class = ", ".join(f"{count} {name}" for name, count in summary["by_class"].items())
    rates = ", ".join(f"{step} {rate:g}" for step, rate in summary["frames_per_second"].items())
    print(f"{summary['tracks']} vehicles: {by_class}")
    print(f"median track {summary['median_track_frames']:g} frames, {summary['median_track_seconds']:g} s")
    if summary["metric"]:
        print(f"median sigma {summary['median_sigma_x']:g} m along x, {summary['median_sigma_y']:g} m along y")
        print(placed_line(summary))
    else:
        print("boxes in pixels only; for meters give --calibration (roadfiber calibrate ground makes one)")
    if summary["frames_detected_before"]:
        print(f"detections of {summary['frames_detected_before']} of {summary['frames']} frames were kept from before")
    print(f"frames per second: {rates}")
    print(f"wrote {summary['out']}" + (f" and {summary['drawn']}" if "drawn" in summary else ""))
