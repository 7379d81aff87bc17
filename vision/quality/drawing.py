"""Common parts of the report's figures: class colors, and panels side by side."""

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vision.contract.figures import DPI, INK, styled
from vision.contract.palette import SERIES

BLUE, RED, GREEN, PINK, ORANGE, SKY = SERIES
CLASS_COLORS = {
    "car": BLUE,
    "van": SKY,
    "truck": RED,
    "bus": ORANGE,
    "motorcycle": GREEN,
    "bicycle": PINK,
}
LETTER = 7.5  # px, of a title, on average


def class_color(name: str) -> str:
    """Color of a class of vehicles; that of text for others, whose gray would be pink to the color-blind."""
    return CLASS_COLORS.get(name, INK)


def fitted(name: str, width: float) -> str:
    """Shorten a name in its middle until it fits a title of `width` px.

    >>> fitted("deimv2_hgnetv2_atto_coco_every_2", 140), fitted("yolox", 140)
    ('deimv2_hg…_every_2', 'yolox')
    """
    most = max(int(width / LETTER), 5)
    head = (most - 1) // 2 + (most - 1) % 2
    return name if len(name) <= most else f"{name[:head]}…{name[len(name) - (most - 1 - head) :]}"


@styled
def panels(count: int, width: int, height: int, columns: int = 2) -> tuple[Figure, list[Axes]]:
    """Figure of this width in CSS pixels with `count` panels of this height, that share both axes."""
    across = min(columns, count)
    rows = -(-count // across)
    figure = Figure(figsize=(width / DPI, (rows * height + 30) / DPI), dpi=DPI, layout="constrained")
    grid = figure.subplots(rows, across, sharex=True, sharey=True, squeeze=False)
    axes: list[Axes] = list(grid.ravel())
    for spare in axes[count:]:
        spare.set_visible(False)
    for lowest in axes[max(count - across, 0) : count]:
        lowest.tick_params(labelbottom=True)
    return figure, axes[:count]
