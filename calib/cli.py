"""`roadfiber calibrate ...`: the camera calibration tool."""

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from calib.control_points import ControlPoints
    from calib.ground import GroundFit

app = typer.Typer(no_args_is_help=True, help="Calibrate the camera: pixels to meters on the road.")

Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]
Frame = Annotated[Path | None, typer.Option(help="TOML file with [frame] origin, x_azimuth: site.toml.")]
Origin = Annotated[str | None, typer.Option(metavar="LAT,LON", help="In place of --frame.")]
Azimuth = Annotated[float | None, typer.Option(help="Direction of +x, degrees from north; with --origin.")]
Crs = Annotated[str | None, typer.Option(metavar="EPSG:CODE", help="Of easting, northing where there is no zone.")]

Axes = Annotated[
    str,
    typer.Option(help="Where x and y of POINTS point: ahead,right (as here), ahead,left, right,ahead or east,north."),
]


@app.callback()
def calibrate() -> None:
    """Calibrate the camera: pixels to meters on the road."""


@app.command()
def ground(
    points: Annotated[
        Path,
        typer.Argument(
            metavar="POINTS",
            help=".csv or .json: name,px,py and x,y, or latitude,longitude, or easting,northing,zone; .otrfpts.",
        ),
    ],
    video: Annotated[
        Path | None,
        typer.Option(help="Video, picture or folder of stills: its size is taken; the fit is drawn over a frame."),
    ] = None,
    image_size: Annotated[str | None, typer.Option(metavar="WxH", help="In place of --video, as 1280x720.")] = None,
    out: Annotated[Path, typer.Option(help="Calibration file to write.")] = Path("calibration.json"),
    model: Annotated[
        str, typer.Option(help="auto (by leave-one-out error), homography, or camera: focal length, distortion, pose.")
    ] = "auto",
    intrinsics: Annotated[Path | None, typer.Option(help="What `calibrate board` wrote: the lens is known.")] = None,
    height: Annotated[
        str | None, typer.Option(metavar="M,SIGMA", help="Height of the camera above the road, if measured.")
    ] = None,
    picture: Annotated[
        Path | None, typer.Option(help="Picture to write.  [default: beside --out, with --video]")
    ] = None,
    maps: Annotated[
        Path | None, typer.Option(help="Maps of meters per pixel and of sigma to write.  [default: beside --out]")
    ] = None,
    frame: Frame = None,
    origin: Origin = None,
    x_azimuth: Azimuth = None,
    crs: Crs = None,
    axes: Axes = "ahead,right",
    threshold: Annotated[float, typer.Option(help="Points further off than this, px, are left out.")] = 5.0,
    as_json: Json = False,
) -> None:
    """Fit the view of the road plane to control points: at least 4, better 8 or more on both sides of the road.

    Prints how far each point is from its fitted place, and from where the other points alone put it (leave one out):
    the error to expect between the points. The calibration carries its own uncertainty.

    Example: `roadfiber calibrate ground points.csv --video street.mp4 --frame site.toml`
    """
    from calib.control_points import read_control_points
    from calib.ground import MODELS, fit_ground
    from calib.lens_prior import read_intrinsics
    from calib.maps import write_maps
    from calib.options import keep_inputs, measured, one_of, picture_size
    from calib.picture import draw_fit, write_picture
    from calib.proposed_frame import frame_for
    from calib.starts import on_road
    from vision.contract import InputError, writing

    if threshold <= 0:
        raise InputError("--threshold: must be above 0 px")
    kind = one_of(model, MODELS, "--model")
    where = frame_for(points, frame, origin, x_azimuth, crs)
    tall = measured(height, "--height", "m")
    marks = read_control_points(points, where, crs, axes)
    size, image = picture_size(video, image_size)
    if picture and image is None:
        raise InputError("--picture: needs --video, to draw on one of its frames")
    lens = read_intrinsics(intrinsics).prior(size, intrinsics) if intrinsics else None
    maps = maps or out.with_name(f"{out.stem}_maps.png")
    picture = picture or (None if image is None else out.with_suffix(".png"))
    keep_inputs([out, maps, picture], [points, video, intrinsics, frame])
    marks = on_road(marks, size, lens, tall, threshold)
    fit = fit_ground(marks, size, model=kind, threshold=threshold, frame=where, lens=lens, height=tall)
    with ExitStack() as whole:  # nothing takes its place before all are written
        calibration_file, maps_file = (whole.enter_context(writing(path)) for path in (out, maps))
        if image is not None and picture is not None:
            write_picture(draw_fit(image, marks, fit), whole.enter_context(writing(picture)))
        write_maps(fit.calibration, maps_file, image)
        fit.calibration.write(calibration_file)
    _report(marks, fit, [out, maps, *([picture] if picture else [])], as_json)


@app.command()
def board(
    sources: Annotated[
        list[Path] | None, typer.Argument(metavar="PICTURES|FOLDER|VIDEO...", help="That show the board.")
    ] = None,
    squares: Annotated[str, typer.Option(metavar="CxR", help="Columns and rows of squares.")] = "9x6",
    kind: Annotated[str, typer.Option(help="charuco or checkerboard.")] = "charuco",
    markers: Annotated[str, typer.Option(help="ArUco dictionary of a ChArUco board.")] = "4X4_50",
    marker_share: Annotated[float, typer.Option(min=0.1, max=0.95, help="Side of a marker over a square's.")] = 0.75,
    legacy: Annotated[bool, typer.Option("--legacy", help="Board drawn by OpenCV before 4.6, even rows.")] = False,
    out: Annotated[Path, typer.Option(help="File to write; for `calibrate ground --intrinsics`.")] = Path(
        "intrinsics.json"
    ),
    picture: Annotated[Path | None, typer.Option(help="Figure to write.  [default: beside --out]")] = None,
    draw: Annotated[Path | None, typer.Option(help="Only draw the board, to print it on something flat.")] = None,
    as_json: Json = False,
) -> None:
    """Measure a lens: focal length, principal point, distortion, from a ChArUco board or checkerboard held before it.

    Film the board near and far, tilted, out to the picture's corners, with the size and zoom that film the road.

    Example: `roadfiber calibrate board --draw board.png`, print it, film it, then
    `roadfiber calibrate board board.mp4`
    """
    import json

    from calib.board import Board, draw_board, fit_board, read_views
    from calib.board_report import facts, words, write_board_picture
    from calib.options import keep_inputs, one_of, two_counts
    from calib.picture import write_picture

    columns, rows = two_counts(squares, "--squares", "9x6")
    plain = one_of(kind, ("charuco", "checkerboard"), "--kind") == "checkerboard"
    target = Board(columns, rows, None if plain else markers, marker_share, legacy)
    if draw:
        write_picture(draw_board(target), draw)
        print(f"wrote {draw}")
        return
    picture = picture or out.with_suffix(".png")
    keep_inputs([out, picture], sources or [])
    fit = fit_board(*read_views(sources or [], target))
    write_board_picture(fit, picture)
    fit.intrinsics.write(out)
    print(json.dumps(facts(fit)) if as_json else f"{words(fit)}\nwrote {out}, {picture}")


@app.command()
def check(
    calibration: Annotated[Path, typer.Argument(help="Calibration file, of any origin.")],
    video: Annotated[Path, typer.Argument(help="Video or picture to draw on.")],
    lengths: Annotated[
        Path | None, typer.Option(help="csv of known lengths: name,px1,py1,px2,py2,length[,sigma] (px, m).")
    ] = None,
    time: Annotated[
        float | None, typer.Option(help="Frame of the video, s from its start.  [default: the middle]")
    ] = None,
    out: Annotated[Path, typer.Option(help="Picture to write.")] = Path("check.png"),
    as_json: Json = False,
) -> None:
    """Check a calibration on a frame: ground grid, horizon, known lengths (as lane dashes) predicted against measured.

    Example: `roadfiber calibrate check calibration.json street.mp4 --lengths dashes.csv`
    """
    import json

    from calib.check import draw_check, facts, words
    from calib.lengths import predict_lengths, read_lengths
    from calib.options import keep_inputs, read_frame
    from calib.picture import write_picture
    from vision.camera import Calibration

    keep_inputs([out], [calibration, video, lengths])
    view = Calibration.read(calibration)
    known = read_lengths(lengths) if lengths else None
    image = read_frame(video, time)
    view.require_size(image.shape[1], image.shape[0], video)
    found = predict_lengths(view, known) if known else None
    write_picture(draw_check(image, view, known, found), out)
    result = facts(view, known, found)
    print(json.dumps(result | {"written": [str(out)]}) if as_json else f"{words(result)}\nwrote {out}")


@app.command()
def page(
    video: Annotated[Path, typer.Argument(help="Video or picture to mark.")],
    points: Annotated[
        Path | None,
        typer.Option(help="Control points to begin with, as for `calibrate ground`, or a calibration.json."),
    ] = None,
    out: Annotated[Path, typer.Option(help="Calibration file that Save writes.")] = Path("calibration.json"),
    time: Annotated[
        float | None, typer.Option(help="Frame of the video, s from its start.  [default: the middle]")
    ] = None,
    intrinsics: Annotated[Path | None, typer.Option(help="What `calibrate board` wrote: the lens is known.")] = None,
    height: Annotated[
        str | None, typer.Option(metavar="M,SIGMA", help="Height of the camera above the road, if measured.")
    ] = None,
    frame: Frame = None,
    origin: Origin = None,
    x_azimuth: Azimuth = None,
    crs: Crs = None,
    axes: Axes = "ahead,right",
    port: Annotated[int, typer.Option(min=0, max=65535, help="0: any free one.")] = 0,
    browser: Annotated[bool, typer.Option(help="Open the page.")] = True,
) -> None:
    """Calibrate in the browser: drag marks on a frame, type their places, see errors, grid and view from above live.

    Works offline; Save writes the file that `calibrate ground` writes, and the points as csv beside it.

    Example: `roadfiber calibrate page street.mp4 --frame site.toml --out calibration.json`
    """
    from calib.control_points import read_control_points
    from calib.ground import THRESHOLD
    from calib.lens_prior import read_intrinsics
    from calib.options import keep_inputs, measured, read_frame
    from vision.contract.extras import require_extra

    require_extra("workbench", ("bokeh",), "the calibration page")
    from calib.page import serve
    from calib.proposed_frame import frame_for
    from calib.session import Session, marks_of
    from calib.starts import on_road

    keep_inputs([out], [video, intrinsics, frame])
    where, tall = frame_for(points, frame, origin, x_azimuth, crs), measured(height, "--height", "m")
    given = read_control_points(points, where, crs, axes) if points else None
    image = read_frame(video, time)
    size = (image.shape[1], image.shape[0])
    lens = read_intrinsics(intrinsics).prior(size, intrinsics) if intrinsics else None
    marks = marks_of(on_road(given, size, lens, tall, THRESHOLD)) if given else ()
    serve(Session(size, marks, frame=where, lens=lens, height=tall), image, out, port, browser)


@app.command()
def clock(
    site: Annotated[Path, typer.Argument(help="The survey's site.toml, or its folder.")],
    offset: Annotated[
        float | None, typer.Option(help="Try this clock_offset, s, in place of the one in site.toml.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Show how the video's frames are put on UTC: start, header, clock_offset, first and last frame, gaps.

    `roadfiber clock RUN` estimates the offset against the DAS from a located run.

    Example: `roadfiber calibrate clock surveys/main-street --offset 0.35`
    """
    import json

    from calib.clock import facts, read_clock, words

    found = read_clock(site, offset)
    print(json.dumps(facts(found)) if as_json else words(found))


def _report(points: "ControlPoints", fit: "GroundFit", written: list[Path], as_json: bool) -> None:
    import json

    from calib.report import summary, table

    if as_json:
        print(json.dumps(summary(points, fit) | {"written": [str(path) for path in written]}))
        return
    print(table(points, fit))
    print(f"wrote {', '.join(map(str, written))}")
