"""Maps of a calibration's accuracy: meters per pixel, standard deviation of a position, a view from above."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vision.camera import Calibration
from vision.contract import InputError, writing

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]
Image = NDArray[np.uint8]
CELLS = 160  # across the picture
COARSEST = 5.0  # m/px; coarser parts of the picture are useless
SUFFIXES = (".png", ".pdf", ".svg", ".jpg")
GOOD = 0.35  # m; sigma of a position beyond which it helps little to locate a fiber
LEVELS = (0.02, 0.05, 0.1, 0.2, 0.35, 0.5, 1.0, 2.0, 5.0)
PIXEL_SIGMA = 1.0  # px; sigma of a detection's pixel
MARGIN = 0.15  # share of the surveyed area shown around it in the view from above


def meters_per_pixel(calibration: Calibration, pixels: Array) -> Array:
    """Longest distance on the road that one pixel covers, m, [n]; NaN where there is no road."""
    return _largest(calibration.jacobian(pixels), root=False)


def position_sigma(calibration: Calibration, pixels: Array, pixel_sigma: float = PIXEL_SIGMA) -> Array:
    """Largest principal standard deviation [n], m, of the places of pixels [n, 2] that are known to `pixel_sigma`, px.

    Of calibration and pixel noise together: sqrt of the larger eigenvalue of C + s^2 J J'.
    """
    jacobian = calibration.jacobian(pixels)
    noise = pixel_sigma**2 * jacobian @ jacobian.transpose(0, 2, 1)
    return _largest(calibration.position_covariance(pixels) + noise, root=True)


def _largest(matrices: Array, root: bool) -> Array:
    known: NDArray[np.bool_] = np.asarray(np.isfinite(matrices).all(axis=(1, 2)))
    norms = np.linalg.norm(np.where(known[:, None, None], matrices, 0.0), ord=2, axis=(1, 2))
    return np.asarray(np.where(known, np.sqrt(norms) if root else norms, np.nan))


def pixel_lattice(image_size: tuple[int, int], cells: int = CELLS) -> tuple[Array, tuple[int, int]]:
    """Pixels [n, 2] spread evenly over a picture, and their rows and columns."""
    width, height = image_size
    rows = max(2, round(cells * height / width))
    u = (np.arange(cells) + 0.5) * width / cells
    v = (np.arange(rows) + 0.5) * height / rows
    return np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2), (rows, cells)


def sigma_image(calibration: Calibration, pixel_sigma: float = PIXEL_SIGMA) -> Array:
    """`position_sigma` over the picture [row, column]; NaN off the road and where a pixel is over `COARSEST` m."""
    pixels, shape = pixel_lattice(calibration.image_size)
    coarse = ~(meters_per_pixel(calibration, pixels) < COARSEST)
    return np.where(coarse, np.nan, position_sigma(calibration, pixels, pixel_sigma)).reshape(shape)


def scale_image(calibration: Calibration) -> Array:
    """`meters_per_pixel` over the picture [row, column]; NaN off the road and beyond `COARSEST`."""
    pixels, shape = pixel_lattice(calibration.image_size)
    scale = meters_per_pixel(calibration, pixels)
    return np.where(scale < COARSEST, scale, np.nan).reshape(shape)


def check_suffix(path: Path) -> None:
    """Raise InputError unless figures are written as files of this suffix."""
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"{path}: maps are written as {', '.join(SUFFIXES)}; give one of these suffixes")


def write_maps(calibration: Calibration, path: Path, image: Image | None = None) -> None:
    """Draw meters per pixel and the sigma of a position over the picture, and the sigma from above, into one file."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    check_suffix(path)
    figure = Figure(figsize=(12, 7), layout="constrained")
    FigureCanvasAgg(figure)
    left, right, below = figure.subplot_mosaic("ab;cc", height_ratios=[1.0, 0.8]).values()
    _over_picture(left, calibration, scale_image(calibration), image, "meters per pixel (the longer way)")
    title = f"1 sigma of a position, m ({PIXEL_SIGMA:g} px and the calibration)"
    _over_picture(right, calibration, sigma_image(calibration), image, title)
    _from_above(below, calibration)
    with writing(path) as temporary:
        figure.savefig(temporary, dpi=110)


def _contours(axes: "Axes", x: Array, y: Array, values: Array) -> None:
    from matplotlib.colors import LogNorm

    drawn = axes.contourf(
        x, y, np.ma.masked_invalid(values), LEVELS, cmap="viridis_r", norm=LogNorm(LEVELS[0], LEVELS[-1]), alpha=0.6,
        extend="both",
    )  # fmt: skip
    bar = axes.figure.colorbar(drawn, ax=axes, shrink=0.85)
    bar.ax.set_yticks(LEVELS, [f"{level:g}" for level in LEVELS])
    known = values[np.isfinite(values)]
    if len(known) and known.min() < GOOD < known.max():
        axes.contour(x, y, np.ma.masked_invalid(values), [GOOD], colors="crimson", linewidths=1.5)


def _over_picture(axes: "Axes", calibration: Calibration, values: Array, image: Image | None, title: str) -> None:
    width, height = calibration.image_size
    extent: Any = (0, width, height, 0)
    if image is not None:
        axes.imshow(image[..., ::-1], extent=extent)
    rows, columns = values.shape
    u, v = (np.arange(columns) + 0.5) * width / columns, (np.arange(rows) + 0.5) * height / rows
    _contours(axes, u, v, values)
    axes.plot([p.u for p in calibration.control_points], [p.v for p in calibration.control_points], "k+", ms=7)
    axes.set(xlim=(0, width), ylim=(height, 0), xlabel="px", title=title, aspect="equal")
    axes.title.set_fontsize(10)


def area(calibration: Calibration) -> tuple[Array, Array]:
    """Corners (low, high) [2] each, m, of the control points' area with a margin."""
    ground = np.array([(point.x, point.y) for point in calibration.control_points])
    span = np.maximum(np.ptp(ground, axis=0), 4.0)
    return ground.min(axis=0) - MARGIN * span, ground.max(axis=0) + MARGIN * span


def _from_above(axes: "Axes", calibration: Calibration) -> None:
    from matplotlib.patheffects import withStroke

    low, high = area(calibration) if calibration.control_points else seen_area(calibration)
    x, y = np.linspace(low[0], high[0], 160), np.linspace(low[1], high[1], 80)
    ground = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    pixels = calibration.to_image(ground)
    seen = ((pixels >= 0) & (pixels <= calibration.image_size)).all(axis=1)
    sigma = np.full(len(ground), np.nan)
    sigma[seen] = position_sigma(calibration, pixels[seen])
    if seen.any():
        _contours(axes, x, y, sigma.reshape(len(y), len(x)))
    for point in calibration.control_points:
        axes.plot(point.x, point.y, "k+", ms=7)
        inward = 1 if point.x < (low[0] + high[0]) / 2 else -1  # so that no name extends beyond the panel
        axes.annotate(
            point.name, (point.x, point.y), xytext=(3 * inward, 3), textcoords="offset points", fontsize=7,
            ha="left" if inward > 0 else "right", parse_math=False,
            path_effects=[withStroke(linewidth=2, foreground="white")],
        )  # fmt: skip
    title = f"from above: 1 sigma of a position, m (red: {GOOD:g} m)"
    axes.set(xlim=(low[0], high[0]), ylim=(high[1], low[1]), xlabel="x, m", ylabel="y, m (right of +x)", title=title)
    axes.set_aspect("equal")
    axes.title.set_fontsize(10)


def seen_area(calibration: Calibration) -> tuple[Array, Array]:
    """Corners (low, high) [2] each, m, of the road that the picture shows at under 0.3 m per pixel."""
    pixels, _ = pixel_lattice(calibration.image_size, 40)
    ground = calibration.to_ground(pixels)[meters_per_pixel(calibration, pixels) < 0.3]
    if not len(ground):
        return np.array([-10.0, -10.0]), np.array([10.0, 10.0])
    return ground.min(axis=0), ground.max(axis=0)
