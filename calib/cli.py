"""`roadfiber calibrate ...`: the camera calibration tool; `ground`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from calib.control_points import ControlPoints
    from calib.ground import GroundFit

app = typer.Typer(no_args_is_help=True, help="Calibrate the camera: pixels to meters on the road.")


@app.callback()
def calibrate() -> None:
    """Calibrate the camera: pixels to meters on the road."""


@app.command()
def ground(
    points: Annotated[Path, typer.Argument(metavar="POINTS.csv", help="name,px,py,x,y[,sigma] or latitude,longitude.")],
    video: Annotated[Path | None, typer.Option(help="Take the image size from it; draw the fit over a frame.")] = None,
    image_size: Annotated[str | None, typer.Option(metavar="WxH", help="In place of --video, as 1280x720.")] = None,
    out: Annotated[Path, typer.Option(help="Calibration file to write.")] = Path("calibration.json"),
    picture: Annotated[
        Path | None, typer.Option(help="Picture to write.  [default: beside --out, with --video]")
    ] = None,
    frame: Annotated[Path | None, typer.Option(help="TOML file with [frame] origin, x_azimuth: site.toml.")] = None,
    origin: Annotated[str | None, typer.Option(metavar="LAT,LON", help="In place of --frame.")] = None,
    x_azimuth: Annotated[float | None, typer.Option(help="Direction of +x, degrees from north; with --origin.")] = None,
    threshold: Annotated[float, typer.Option(help="Points further off than this, px, are left out.")] = 5.0,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False,
) -> None:
    """Fit the homography of the road plane to control points: at least 4, better 8 or more on both sides of the road.

    Prints how far each point is from its fitted place (px, m), and from where the other points alone put it
    (leave one out, m): the error to expect between the points.

    Example: `roadfiber calibrate ground points.csv --video street.mp4 --frame site.toml`
    """
    from calib.control_points import read_control_points
    from calib.ground import fit_ground
    from calib.options import local_frame, picture_size
    from vision.contract import InputError

    if threshold <= 0:
        raise InputError("--threshold: must be above 0 px")
    where = local_frame(frame, origin, x_azimuth)
    marks = read_control_points(points, where)
    size, image = picture_size(video, image_size)
    if picture and image is None:
        raise InputError("--picture: needs --video, to draw on one of its frames")
    fit = fit_ground(marks, size, threshold=threshold, frame=where)
    if image is not None:
        from calib.picture import draw_fit, write_picture

        picture = picture or out.with_suffix(".png")
        write_picture(draw_fit(image, marks, fit), picture)
    fit.calibration.write(out)
    _report(marks, fit, out, picture, as_json)


def _report(points: "ControlPoints", fit: "GroundFit", out: Path, picture: Path | None, as_json: bool) -> None:
    import json

    from calib.report import summary, table

    if as_json:
        print(json.dumps(summary(points, fit) | {"calibration": str(out), "picture": picture and str(picture)}))
        return
    print(table(points, fit))
    print(f"wrote {out}" + (f" and {picture}" if picture else ""))
