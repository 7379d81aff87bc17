"""What `roadfiber calibrate board` says and draws: coverage, errors per view, distortion over the picture."""

from pathlib import Path
from typing import Any

import numpy as np

from calib.board import CELLS, BoardFit
from calib.maps import check_suffix
from vision.contract import writing
from vision.contract.rounding import with_sigma
from vision.lens import NAMES

MAGNIFY = 100.0


def facts(fit: BoardFit) -> dict[str, Any]:
    """Everything found, JSON-ready."""
    intrinsics = fit.intrinsics
    sigma = np.sqrt(np.diagonal(intrinsics.covariance))
    values, sigmas = intrinsics.lens.vector, sigma.copy()
    values[:2], sigmas[:2] = intrinsics.lens.focal, sigma[:2] * intrinsics.lens.focal
    names = ("fx", "fy", *NAMES[2:])
    return {
        "image_size": list(intrinsics.image_size),
        "parameters": {
            name: {"value": float(value), "sigma": float(deviation)}
            for name, value, deviation in zip(names, values, sigmas, strict=True)
        },
        "rms_px": intrinsics.rms_px,
        "coverage": fit.coverage,
        "views": [
            {"name": name, "corners": count, "rms_px": rms, "tilt_deg": float(tilt)}
            for (name, count, rms), tilt in zip(intrinsics.views, fit.tilts, strict=True)
        ],
        "warnings": list(fit.warnings),
    }


def words(fit: BoardFit) -> str:
    """Lines of text of `facts`."""
    found = facts(fit)
    width = max(4, *(len(row["name"]) for row in found["views"]))
    lines = [f"{'view':<{width}}  corners  rms px  tilt deg"]
    for row in found["views"]:
        lines.append(f"{row['name']:<{width}}  {row['corners']:7d}  {row['rms_px']:6.3f}  {row['tilt_deg']:8.1f}")
    lines.append(
        f"all {len(found['views'])} views: rms {found['rms_px']:.3f} px; {found['coverage']:.0%} of the picture"
    )
    for name, row in found["parameters"].items():
        lines.append(f"  {name:<3} {with_sigma(row['value'], row['sigma']):>20}")
    return "\n".join(lines + [f"warning: {message}" for message in fit.warnings])


def write_board_picture(fit: BoardFit, path: Path) -> None:
    """Draw where the corners were and how they fit, the error of every view, and the distortion over the picture."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    check_suffix(path)
    figure = Figure(figsize=(12, 7), layout="constrained")
    FigureCanvasAgg(figure)
    corners, bend, bars = figure.subplot_mosaic("ab;cc", height_ratios=[1.0, 0.6]).values()
    width, height = fit.intrinsics.image_size
    pixels = np.concatenate([view.pixels for view in fit.views])
    off = np.concatenate(fit.residuals)
    size = np.linalg.norm(off, axis=1)
    arrows = corners.quiver(*pixels.T, *off.T, size, angles="xy", scale_units="xy", scale=1 / MAGNIFY, cmap="viridis")
    figure.colorbar(arrows, ax=corners, label="px")
    corners.set_xticks(np.linspace(0, width, CELLS[0] + 1).round())
    corners.set_yticks(np.linspace(0, height, CELLS[1] + 1).round())
    corners.grid(alpha=0.4)
    corners.set_title(f"residuals x{MAGNIFY:g}; corners in {fit.coverage:.0%} of the cells", fontsize=10)
    u, v = np.meshgrid(np.linspace(0, width, 60), np.linspace(0, height, 40))
    places = np.stack([u, v], axis=-1).reshape(-1, 2)
    shift = np.linalg.norm(fit.intrinsics.lens.undistort(places) - places, axis=1).reshape(u.shape)
    lines = bend.contourf(u, v, np.ma.masked_invalid(shift), 12, cmap="magma_r")
    figure.colorbar(lines, ax=bend, label="px")
    bend.set_title("how far distortion moves a pixel", fontsize=10)
    for axes in (corners, bend):
        axes.set(xlim=(0, width), ylim=(height, 0), aspect="equal")
    names = [name for name, _, _ in fit.intrinsics.views]
    bars.bar(range(len(names)), [rms for _, _, rms in fit.intrinsics.views], color="steelblue")
    bars.axhline(fit.intrinsics.rms_px, color="crimson", lw=1)
    bars.set_xticks(range(len(names)), names, rotation=60, ha="right", fontsize=6, parse_math=False)
    bars.set(ylabel="rms, px", title="error of every view (red: all)")
    bars.title.set_fontsize(10)
    with writing(path) as temporary:
        figure.savefig(temporary, dpi=110)
