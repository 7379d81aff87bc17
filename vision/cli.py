"""`roadfiber track` and `roadfiber quality`."""

from pathlib import Path
from typing import Annotated, Any

import typer

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
    import json

    from vision.cache import cache_folder
    from vision.contract.files import require_writable
    from vision.drawn_video import require_drawable
    from vision.pipeline import track as track_video
    from vision.tracked import check_suffix

    out = out or Path("trajectories.csv" if calibration else "boxes.csv")
    check_suffix(out)
    require_writable(out)
    if draw:
        require_drawable(draw, video)
        require_writable(draw)
    tracked = track_video(
        video,
        detector=detector,
        layout=layout,
        names=split(names),
        calibration=calibration,
        start=start,
        frame_rate=frame_rate,
        clock_offset=clock_offset,
        min_score=min_score,
        classes=split(classes),
        every=every,
        cache=None if no_cache else cache or cache_folder(),
        appearance=appearance,
    )
    tracked.save(out)
    if draw:
        tracked.draw(draw)
    if as_json:
        print(json.dumps(tracked.facts | {"out": str(out)} | ({"drawn": str(draw)} if draw else {})))
        return
    print("\n".join([*tracked.lines(), f"wrote {out}" + (f" and {draw}" if draw else "")]))


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
        float | None,
        typer.Option(
            help="Of the video, 1/s, for files without a clock.  [default: the other tables', else the video's]"
        ),
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


def split(text: str | None) -> list[str] | None:
    """Parts of a list given by comma; None for none.

    >>> split("car, van")
    ['car', 'van']
    """
    return [part.strip() for part in text.split(",") if part.strip()] if text else None
