"""The picture of tracks: on the road from above, or in the video's picture."""

from typing import TYPE_CHECKING

from matplotlib.figure import Figure

from vision.contract.drawing import canvas, place
from vision.contract.figures import styled
from vision.frames import Video

if TYPE_CHECKING:
    import pandas as pd

WIDTH, HEIGHT = 960, 420  # px


@styled
def tracked_figure(table: "pd.DataFrame", clip: Video) -> Figure:
    """Draw every track, colored by class.

    Parameters
    ----------
    table : trajectory table, m; or of boxes, px
    clip : the video
    """
    figure = canvas(WIDTH, HEIGHT)
    axes = place(figure, "tracks", 66, 30, WIDTH - 90, HEIGHT - 80)
    metric = "x" in table
    colors = {name: f"C{number}" for number, name in enumerate(table["class"].unique())}
    for _, track in table.groupby("track_id", sort=False):
        name = str(track["class"].iloc[0])
        x = track["x"] if metric else (track["box_left"] + track["box_right"]) / 2
        y = track["y"] if metric else track["box_bottom"]
        axes.plot(x, y, color=colors[name], lw=1.2)
    for name, color in colors.items():
        axes.plot([], [], color=color, label=name)
    if metric:
        axes.set(xlabel="x, m along the road", ylabel="y, m to the right", title="Tracks on the road, from above")
        axes.invert_yaxis()
    else:
        axes.set(xlim=(0, clip.width), ylim=(clip.height, 0), xlabel="px", ylabel="px")
        axes.set_title("Lower edges of the vehicles in the picture")
    axes.legend(ncols=len(colors), loc="upper right")
    return figure
