"""Parts of the calibration page: its style, the picture, the view from above, and the tables."""

from typing import Any

import numpy as np
from bokeh.models import (
    ColorBar,
    ColumnDataSource,
    DataTable,
    GlobalInlineStyleSheet,
    HoverTool,
    LogColorMapper,
    NumberFormatter,
    PointDrawTool,
    Range1d,
    StringFormatter,
    TableColumn,
)
from bokeh.palettes import Viridis256
from bokeh.plotting import figure
from numpy.typing import NDArray

from calib.layers import rgba
from calib.maps import LEVELS

#: px: of the frame, and of all at its right; together with axes and margins no more than a window of 1280.
WIDTH, BESIDE = 590, 540
#: Those of the other pages: ink, muted, paper, ground, and the color of what belongs to the route.
STYLE = """
body { margin: 0 auto; padding: 14px 18px 30px; max-width: 1244px; background: #f5f6f7; color: #1f2933;
  font: 15px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, sans-serif; color-scheme: light; }
h1 { font-size: 1.5rem; line-height: 1.25; margin: 0 0 .2rem; font-weight: 650; letter-spacing: -.01em; }
"""
CARD = {
    "font-size": "13px",
    "background": "#ffffff",
    "border": "1px solid #d5dae0",
    "border-radius": "8px",
    "padding": "8px 12px",
    "color": "#1f2933",
}
PIXELS = ("px", "py", "residual_px", "sigma")
TITLES = {"name": "name", "px": "px", "py": "py", "x": "x, m", "y": "y, m", "sigma": "σ, px",
          "sigma_xy": "σ, m", "residual_px": "off, px", "residual_m": "off, m",
          "leave_one_out_m": "held out"}  # fmt: skip
TIPS = [("", "@name"), ("place", "@x{0.00}, @y{0.00} m"), ("off", "@residual_px{0.0} px, @residual_m{0.00} m"),
        ("held out", "@leave_one_out_m{0.00} m")]  # fmt: skip


def style_sheet() -> GlobalInlineStyleSheet:
    """Of the page as a whole."""
    return GlobalInlineStyleSheet(css=STYLE)


def picture_plot(
    image: NDArray[np.uint8], sources: dict[str, ColumnDataSource], size: tuple[int, int]
) -> tuple[Any, list[Any]]:
    """The frame with marks to drag, names on hover and of the selected mark alone; and its layers.

    Parameters
    ----------
    image : [row, column, 3], BGR
    sources : marks, chosen (those selected), lines, residuals, errors
    size : width and height of the picture, px
    """
    width, height = size
    plot = figure(
        name="picture", frame_width=WIDTH, frame_height=round(WIDTH * height / width), x_range=Range1d(0, width),
        y_range=Range1d(height, 0), tools="pan,wheel_zoom,reset", active_scroll="wheel_zoom",
        title="drag marks; click to add one; click one to select it and type its place",
    )  # fmt: skip
    plot.image_rgba([rgba(image)], x=0, y=0, dw=width, dh=height)
    colors = LogColorMapper(palette=Viridis256[::-1], low=LEVELS[0], high=LEVELS[-1], nan_color="rgba(0,0,0,0)")
    errors = plot.image("image", source=sources["errors"], x="x", y="y", dw="dw", dh="dh", color_mapper=colors,
                        alpha=0.5)  # fmt: skip
    bar = ColorBar(color_mapper=colors, title="1 sigma, m", height=8, width=WIDTH - 60, visible=False)
    plot.add_layout(bar, "below")
    grid = plot.multi_line("xs", "ys", source=sources["lines"], color="#6ec8ff", line_width=1)
    residuals = plot.multi_line("xs", "ys", source=sources["residuals"], color="#ffe600", line_width=2)
    points = plot.scatter("px", "py", source=sources["marks"], size=11, fill_alpha=0.25, color="color", line_width=2,
                          selection_line_color="white", selection_fill_alpha=0.6)  # fmt: skip
    plot.text("px", "py", "name", source=sources["chosen"], x_offset=8, y_offset=-4, text_color="white",
              text_font_size="12px", background_fill_color="black", background_fill_alpha=0.6)  # fmt: skip
    points.nonselection_glyph = None  # the same as unselected: not faded
    draw = PointDrawTool(renderers=[points])
    plot.add_tools(draw, HoverTool(renderers=[points], tooltips=TIPS))
    plot.toolbar.active_tap = draw
    errors.visible = False
    return plot, [grid, residuals, errors, bar]


def above_plot(sources: dict[str, ColumnDataSource]) -> Any:
    """The view from above; names on hover alone.

    Parameters
    ----------
    sources : image, ellipses, points
    """
    plot = figure(
        name="above", width=WIDTH + 90, height=400, x_range=Range1d(0, 1), y_range=Range1d(1, 0),
        tools="pan,wheel_zoom,reset", title="from above: typed places (+), 2 sigma around where their pixels are",
        x_axis_label="x, m", y_axis_label="y, m (right of +x)",
    )  # fmt: skip
    plot.image_rgba("image", source=sources["image"], x="x", y="y", dw="dw", dh="dh")
    plot.patches("xs", "ys", source=sources["ellipses"], fill_alpha=0.15, color="#ffe600")
    crosses = plot.scatter("x", "y", source=sources["points"], marker="cross", size=12, color="#ff40ff", line_width=2)
    plot.add_tools(HoverTool(renderers=[crosses], tooltips=[("", "@name"), ("place", "@x{0.00}, @y{0.00} m")]))
    return plot


def mark_table(source: ColumnDataSource) -> DataTable:
    """All marks, in the order in which they were set."""
    number, pixels = NumberFormatter(format="0.000", nan_format="-"), NumberFormatter(format="0.0", nan_format="-")
    columns = [
        TableColumn(
            field=name,
            title=title,
            formatter=StringFormatter() if name == "name" else pixels if name in PIXELS else number,
            width=80 if name == "name" else 50,
        )
        for name, title in TITLES.items()
    ]
    return DataTable(source=source, columns=columns, width=BESIDE, height=330, index_position=None, sortable=False,
                     reorderable=False, name="table", autosize_mode="none", css_classes=["all-marks"])  # fmt: skip


def worst_table(source: ColumnDataSource) -> DataTable:
    """Marks by how far off the others predict them, the largest first."""
    number = NumberFormatter(format="0.00", nan_format="-")
    titles = {"name": "largest leave-one-out errors", "off": "off, m", "expected": "expected, m", "times": "times"}
    columns = [
        TableColumn(field=field, title=title, width=230 if field == "name" else 100,
                    formatter=StringFormatter() if field == "name" else number)
        for field, title in titles.items()
    ]  # fmt: skip
    return DataTable(source=source, columns=columns, width=BESIDE, height=132, index_position=None, sortable=False,
                     reorderable=False, name="worst", autosize_mode="none", css_classes=["worst-marks"])  # fmt: skip
