"""Pictures of the response maps."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from solver.start.response_maps import ResponseMaps

TITLES = {"y": "offset: change per meter", "z": "depth: change per meter", "nu": "Poisson ratio: change per 0.01"}
UNIT = {"y": 1.0, "z": 1.0, "nu": 0.01}


def draw_maps(maps: "ResponseMaps") -> "Figure":
    """Draw width, strength, the three sensitivities that a free weight leaves, and which place they favor."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 6.4), layout="constrained")
    axes = figure.subplots(2, 3)
    panel(maps, axes[0, 0], maps.width, "width of the response, m", "viridis")
    panel(maps, axes[0, 1], np.log10(maps.strength / maps.strength.max()), "strength, powers of ten", "magma")
    # Right under the vehicle nothing tells the offset: the response is symmetric there.
    ratio = np.log10(maps.told["z"] / np.maximum(maps.told["y"], 1e-9))
    panel(maps, axes[0, 2], ratio, "depth over offset, powers of ten", "coolwarm", limit=1.0)
    for axis, (name, title) in zip(axes[1], TITLES.items(), strict=True):
        panel(maps, axis, 100 * maps.told[name] * UNIT[name], f"{title}, %", "cividis")
    title = f"{maps.vehicle_class}: response of a straight fiber, weight of the vehicle unknown"
    figure.suptitle(title, parse_math=False)
    return figure


def panel(
    maps: "ResponseMaps",
    axis: "Axes",
    values: NDArray[np.float64],
    title: str,
    colors: str,
    limit: float | None = None,
) -> None:
    """Draw one map [depth, offset] with contours."""
    # A few cells right under the wheels must not take all colors.
    low, high = np.quantile(values, [0.02, 0.98]) if limit is None else (-limit, limit)
    mesh = axis.pcolormesh(maps.offset, maps.depth, values, cmap=colors, shading="nearest", vmin=low, vmax=high)
    if min(values.shape) > 1 and np.ptp(values) > 0:
        axis.contour(maps.offset, maps.depth, values, colors="white", linewidths=0.5)
    axis.figure.colorbar(mesh, ax=axis)
    axis.invert_yaxis()
    axis.set(title=title, xlabel="lateral offset, m", ylabel="depth, m")
