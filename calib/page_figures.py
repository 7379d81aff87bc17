"""The figures of the calibration page: the picture with its marks, the road from above, the table of marks. Bokeh."""

from typing import Any

import numpy as np
from bokeh.models import (
    ColorBar,
    ColumnDataSource,
    CustomJS,
    DataTable,
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

from calib.control_points import ControlPoints
from calib.ground import GroundFit
from calib.layers import ellipses, from_above, grid_in_picture, rgba
from calib.maps import LEVELS, area, sigma_image
from calib.next_mark import next_mark
from calib.page_text import EDITED, FOUND, LISTED

Image = NDArray[np.uint8]
NO_LINES: dict[str, list[Any]] = {"xs": [], "ys": []}
NO_IMAGE: dict[str, list[Any]] = {"image": [], "x": [], "y": [], "dw": [], "dh": []}
NO_POINTS: dict[str, list[Any]] = {"x": [], "y": [], "name": []}
NO_LABELS: dict[str, list[Any]] = {"px": [], "py": [], "name": []}
PIXELS = ("px", "py", "residual_px", "sigma")
MAGNIFY = 20.0
WIDTH, BESIDE = 690, 490  # px; of the frame on the page, and of what stands beside it


class Figures:
    """What a page draws, and the sources that it draws from.

    Parameters
    ----------
    image : [height, width, 3], BGR
    image_size : width and height, px
    """

    def __init__(self, image: Image, image_size: tuple[int, int]):
        self.image = image
        self.marks = ColumnDataSource({name: [] for name in (*EDITED, *FOUND)}, name="marks")
        self.table = ColumnDataSource({name: [] for name in (*LISTED, "at")}, name="rows")
        self.labels = ColumnDataSource(dict(NO_LABELS), name="labels")
        self.wanted = ColumnDataSource(dict(NO_POINTS), name="wanted")
        self.lines = ColumnDataSource(dict(NO_LINES))
        self.residuals = ColumnDataSource(dict(NO_LINES))
        self.errors = ColumnDataSource(dict(NO_IMAGE))
        self.above_image = ColumnDataSource(dict(NO_IMAGE))
        self.above_ellipses = ColumnDataSource(dict(NO_LINES))
        self.above_points = ColumnDataSource(dict(NO_POINTS), name="above_points")
        self.picture, self.layers = self._picture(*image_size)
        self.above = self._above()

    def _picture(self, width: int, height: int) -> tuple[Any, list[Any]]:
        plot = figure(
            name="picture", frame_width=WIDTH, frame_height=round(WIDTH * height / width), x_range=Range1d(0, width),
            y_range=Range1d(height, 0), tools="pan,wheel_zoom,reset", active_scroll="wheel_zoom",
            title="The picture: drag marks, click to add one, point at one to read it",
        )  # fmt: skip
        plot.image_rgba([rgba(self.image)], x=0, y=0, dw=width, dh=height)
        colors = LogColorMapper(palette=Viridis256[::-1], low=LEVELS[0], high=LEVELS[-1], nan_color="rgba(0,0,0,0)")
        errors = plot.image("image", source=self.errors, x="x", y="y", dw="dw", dh="dh", color_mapper=colors, alpha=0.5)
        bar = ColorBar(color_mapper=colors, title="error map: 1 sigma, m", height=8, visible=False)
        plot.add_layout(bar, "below")
        grid = plot.multi_line("xs", "ys", source=self.lines, color="#6ec8ff", line_width=1)
        residuals = plot.multi_line("xs", "ys", source=self.residuals, color="#ffe600", line_width=2)
        points = plot.scatter("px", "py", source=self.marks, size=11, fill_alpha=0.25, color="color", line_width=2,
                              selection_line_color="white", selection_fill_alpha=0.6)  # fmt: skip
        plot.text("px", "py", "name", source=self.labels, x_offset=8, y_offset=-4, text_color="white",
                  text_font_size="12px", background_fill_color="black", background_fill_alpha=0.5)  # fmt: skip
        plot.scatter("x", "y", source=self.wanted, marker="diamond", size=14, fill_alpha=0, line_color="#56b4e9",
                     line_width=2, line_dash=[3, 3])  # fmt: skip
        points.nonselection_glyph = None  # the same as unselected: not faded
        tips = [("mark", "@name"), ("left out, m", "@leave_one_out_m{0.000}"), ("off, px", "@residual_px{0.0}")]
        plot.add_tools(HoverTool(renderers=[points], tooltips=tips))
        plot.toolbar.logo = None
        draw = PointDrawTool(renderers=[points])
        plot.add_tools(draw)
        plot.toolbar.active_tap = draw
        errors.visible = False
        errors.js_link("visible", bar, "visible")
        return plot, [grid, residuals, errors]

    def _above(self) -> Any:
        plot = figure(
            name="above", width=BESIDE, height=380, x_range=Range1d(0, 1), y_range=Range1d(1, 0),
            tools="pan,wheel_zoom,reset", title="From above: typed places (+), 2 sigma around those of their pixels",
            x_axis_label="x, m", y_axis_label="y, m (right of +x)",
        )  # fmt: skip
        plot.toolbar.logo = None
        plot.image_rgba("image", source=self.above_image, x="x", y="y", dw="dw", dh="dh")
        plot.patches("xs", "ys", source=self.above_ellipses, fill_alpha=0.15, color="#ffe600")
        crosses = plot.scatter("x", "y", source=self.above_points, marker="cross", size=12, color="#ff40ff",
                               line_width=2)  # fmt: skip
        plot.add_tools(HoverTool(renderers=[crosses], tooltips=[("mark", "@name"), ("x, y, m", "@x{0.00}, @y{0.00}")]))
        return plot

    def rows(self) -> Any:
        """The table of marks."""
        number, text = NumberFormatter(format="0.000", nan_format="-"), StringFormatter()
        pixels = NumberFormatter(format="0.0", nan_format="-")
        columns = [
            TableColumn(
                field=name,
                title=title,
                formatter=text if name == "name" else pixels if name in PIXELS else number,
                width=84 if name == "name" else 64 if name == "leave_one_out_m" else 54,
            )
            for name, title in LISTED.items()
        ]
        table = DataTable(source=self.table, columns=columns, width=BESIDE, height=250, index_position=None,
                          sortable=False, reorderable=False, name="table", autosize_mode="none")  # fmt: skip
        # Bokeh draws rows anew only where their number changes.
        self.table.js_on_change("data", CustomJS(args={"view": table.view}, code="view.change.emit()"))
        return table

    def draw(self, points: ControlPoints | None, fit: GroundFit | None) -> None:
        """Draw all that depends on the marks whose place is known; nothing where they determine no fit."""
        if fit is None or points is None:
            self.lines.data, self.residuals.data, self.errors.data = dict(NO_LINES), dict(NO_LINES), dict(NO_IMAGE)
            self.above_image.data, self.above_ellipses.data = dict(NO_IMAGE), dict(NO_LINES)
            self.above_points.data, self.wanted.data = dict(NO_POINTS), dict(NO_POINTS)
            return
        view = fit.calibration
        width, height = view.image_size
        wanted = next_mark(view)
        self.wanted.data = dict(NO_POINTS) if wanted is None else {
            "x": [wanted.pixel[0]], "y": [wanted.pixel[1]], "name": ["next"]
        }  # fmt: skip
        xs, ys = grid_in_picture(view, points.ground)
        self.lines.data = {"xs": xs, "ys": ys}
        ends = points.pixels + MAGNIFY * (view.to_image(points.ground) - points.pixels)
        pairs = np.stack([points.pixels, ends], axis=1)
        self.residuals.data = {"xs": list(pairs[:, :, 0]), "ys": list(pairs[:, :, 1])}
        self.errors.data = {"image": [sigma_image(view)], "x": [0], "y": [0], "dw": [width], "dh": [height]}
        low, high = area(view)
        seen = from_above(self.image, view, low, high)
        self.above_image.data = {
            "image": [seen], "x": [low[0]], "y": [low[1]], "dw": [high[0] - low[0]], "dh": [high[1] - low[1]]
        }  # fmt: skip
        xs, ys = ellipses(view, points.pixels, points.sigma)
        self.above_ellipses.data = {"xs": xs, "ys": ys}
        self.above_points.data = {"x": points.ground[:, 0], "y": points.ground[:, 1], "name": list(points.names)}
        self.above.x_range.update(start=float(low[0]), end=float(high[0]))
        self.above.y_range.update(start=float(high[1]), end=float(low[1]))
