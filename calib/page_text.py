"""What the page shows and takes back as text: the table of marks, typed values, the fit in a few lines."""

import html
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from calib.control_points import MAP_SIGMA, PLACE_SIGMA
from calib.ground import GroundFit
from calib.next_mark import next_mark
from calib.report import scores_text
from calib.session import Mark, Marks
from vision.contract import LocalFrame
from vision.contract.columns import to_frame
from vision.contract.rounding import with_sigma

EDITED = ("name", "px", "py", "x", "y", "sigma", "sigma_xy")
FOUND = ("residual_px", "residual_m", "leave_one_out_m", "color")
FIELDS = {"name": "selected mark", "px": "px", "py": "py", "x": "x, m", "y": "y, m", "sigma": "unsure, px",
          "sigma_xy": "unsure, m"}  # fmt: skip
LISTED = {"name": "mark", "leave_one_out_m": "left out, m", "residual_m": "off, m", "residual_px": "off, px",
          "x": "x, m", "y": "y, m", "px": "px", "py": "py"}  # fmt: skip
#: Style of the page's words; colors are those of all pages.
STYLE = """
:host { font: 14px/1.45 system-ui, -apple-system, "Segoe UI", Roboto, sans-serif; color: #1f2933; }
h1 { font-size: 19px; margin: 0 0 2px; } p { margin: 2px 0; } small { color: #5d6873; }
.wrong { color: #a84800; font-weight: 600; } .next { border-left: 4px solid #0072b2; padding-left: 8px; }
code { color: #5d6873; }
"""
#: What the page is for, and what to do on it.
HEAD = (
    "<h1>Where the camera looks: calibration by marks on the road</h1><p>Click the picture to add a mark, drag it to "
    "its place, and type where it is on the road. Each mark is also placed by the others alone (<i>left out</i>): "
    "where that is far off, look at the mark first.</p>"
)
USED, LEFT_OUT, UNPLACED = "#37d067", "#ff4040", "#ffd23c"


def read_marks(data: dict[str, Any]) -> Marks:
    """Marks of the table's columns.

    Bokeh's tool that adds a mark sets only its pixel; other columns are zero and the name is empty.

    >>> rows = {"name": ["a", ""], "px": [1, 5], "py": [2, 6], "x": [3, 0], "y": [4, 0]}
    >>> [mark.placed for mark in read_marks(rows | {"sigma": [1, 0], "sigma_xy": [0, 0]})]
    [True, False]
    """
    rows = zip(*(data[name] for name in EDITED), strict=True)
    return tuple(
        Mark(name, *(float(value) for value in values)) if name else Mark("", float(values[0]), float(values[1]))
        for name, *values in rows
    )


def with_place(texts: dict[str, str], frame: LocalFrame | None) -> dict[str, str]:
    """Turn "LATITUDE, LONGITUDE" typed or pasted for x into x and y, m; leave anything else unchanged.

    Raises
    ------
    ValueError, for people: there is no local frame, or the two are not a place near its origin.

    >>> here = LocalFrame((32.0, 34.8), 90.0)
    >>> with_place({"x": "32.0, 34.801", "y": ""}, here)
    {'x': '94.493', 'y': '-0.000'}
    """
    if texts["x"].count(",") != 1:
        return texts
    if frame is None:
        raise ValueError("latitude, longitude need a local frame: open the page with --frame site.toml")
    try:
        latitude, longitude = (np.array([float(part)]) for part in texts["x"].split(","))
    except ValueError as error:
        raise ValueError(f"{texts['x']}: give LATITUDE, LONGITUDE in degrees, or x in meters") from error
    x, y = to_frame(latitude, longitude, frame, Path(texts["x"]))
    usual = texts.get("sigma_xy") == f"{PLACE_SIGMA:g}"  # of meters; a place on the globe is known less well
    return texts | {"x": f"{x[0]:.3f}", "y": f"{y[0]:.3f}"} | ({"sigma_xy": f"{MAP_SIGMA:g}"} if usual else {})


def typed_mark(mark: Mark, texts: dict[str, str]) -> Mark:
    """Change a mark to what was typed, where an empty place is unknown; ValueError, for people, if it is not a number.

    >>> typed_mark(Mark("p1", 5.0, 6.0), {"name": "curb", "x": "12.5", "y": ""})
    Mark(name='curb', px=5.0, py=6.0, x=12.5, y=nan, sigma=1.0, sigma_xy=0.05)
    """
    values: dict[str, Any] = {}
    for name, text in texts.items():
        if name == "name":
            values[name] = text.strip()
            continue
        try:
            values[name] = float(text) if text.strip() else float("nan")
        except ValueError as error:
            raise ValueError(f"{FIELDS[name]}: {text} is not a number") from error
        if not np.isfinite(values[name]) and (text.strip() or name not in ("x", "y")):
            raise ValueError(f"{FIELDS[name]}: give a number")
    return replace(mark, **values)


def table_data(marks: Marks, fit: GroundFit | None) -> dict[str, list[Any]]:
    """Columns of the table: the marks and, where there is a fit, how far off they are."""
    data: dict[str, list[Any]] = {name: [getattr(mark, name) for mark in marks] for name in EDITED}
    missing = float("nan")
    data |= {name: [missing] * len(marks) for name in FOUND[:3]} | {"color": [UNPLACED] * len(marks)}
    if fit is None:
        return data
    held_out = iter(fit.calibration.leave_one_out_m or ())
    for index, place in enumerate([index for index, mark in enumerate(marks) if mark.placed]):
        used = bool(fit.used[index])
        left_out = next(held_out, None) if used else None
        data["residual_px"][place] = float(fit.residuals_px[index])
        data["residual_m"][place] = float(fit.residuals_m[index])
        data["leave_one_out_m"][place] = missing if left_out is None else left_out
        data["color"][place] = USED if used else LEFT_OUT
    return data


def listed(data: dict[str, list[Any]]) -> dict[str, list[Any]]:
    """Rows of the table on the page, the largest leave-one-out error first, with the place `at` of each mark.

    >>> missing = float("nan")
    >>> marks = {name: [1.0, 2.0, 3.0] for name in LISTED} | {"leave_one_out_m": [0.1, missing, 0.4]}
    >>> listed(marks)["at"]
    [2, 0, 1]
    """
    error = np.nan_to_num(np.array(data["leave_one_out_m"], float), nan=-1.0)
    order = np.argsort(-error, kind="stable").tolist()
    return {name: [data[name][at] for at in order] for name in LISTED} | {"at": order}


def wrong(words: object) -> str:
    """Words on something that must be mended, as HTML."""
    return f"<span class='wrong'>{html.escape(str(words))}</span>"


def describe(fit: GroundFit) -> str:
    """The fit in a few lines of HTML."""
    rms_px = float(np.sqrt(np.mean(fit.residuals_px[fit.used] ** 2)))
    rms_m = float(np.sqrt(np.mean(fit.residuals_m[fit.used] ** 2)))
    lines = [
        f"Model <b>{fit.calibration.model}</b>: marks are off by <span id='rms'>{rms_px:.3f}</span> px, {rms_m:.3f} m "
        f"(rms); places between them are good to {fit.worst_sigma:.2f} m (1 sigma) or better.",
        f"<small>Each mark placed by the others, rms: {html.escape(scores_text(fit))}</small>",
    ]
    if parameters := fit.calibration.parameters:
        shown = [name for name in ("focal", "k1", "height", "tilt") if name in parameters]
        lines.append(
            ", ".join(
                f"{n} {with_sigma(parameters[n].value, parameters[n].sigma)} {parameters[n].unit}".strip()
                for n in shown
            )
        )
    if wanted := next_mark(fit.calibration):
        lines.append(f"<b>What to add next.</b> {wanted.sentence}")
    lines += [f"<span class='wrong'>{html.escape(message)}</span>" for message in fit.warnings]
    return "".join(f"<p>{line}</p>" for line in lines)
