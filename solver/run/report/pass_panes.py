"""Measured, model and residual of the passes that fit worst, as the parts of a run's page that show them."""

from html import escape

import numpy as np
from matplotlib.colors import AsinhNorm

from solver.run.report.misfit import Misfit, pass_label
from solver.run.report.misfit_figure import Pictures, pictures_of, scale_figure, wave_pictures, worst
from solver.run.run import Run
from solver.trajectory.vehicle_pass import Pass
from vision.contract.drawing import coarse, color_map, color_scale
from vision.contract.figures import data_uri, png_bytes, svg

PANEL, SCALE = 340, 350  # px
MOST_PASSES = 16  # that the page shows in full
MOST_CELLS, THUMBNAIL = 300, 60  # rows or columns of a picture
PIXELS = 1_000_000  # of all pictures together, which keeps the page below 4 MB


def chip(one: Pass, number: int, chi2: float, pictures: Pictures, scale: AsinhNorm) -> str:
    """Thumbnail of a pass's residual that selects the pass."""
    image = coarse(pictures.residual, THUMBNAIL)
    source = data_uri(png_bytes(color_map()(scale(np.ma.masked_invalid(image)))))
    return (
        f'<label for="pass-{number}"><img alt="residual" src="{source}">'
        f"<b>{escape(pass_label(one))}</b>{3.6 * abs(one.speed):.0f} km/h<br>chi² {chi2:.2f}</label>"
    )


def pane(run: Run, number: int, pictures: Pictures, scale: AsinhNorm) -> str:
    """Measured, model and residual of one pass."""
    names, maps = zip(*vars(pictures).items(), strict=True)
    drawn = wave_pictures(run, run.passes[number], maps, scale, PANEL)
    figures = [
        f"<figure><figcaption>{name.capitalize()}</figcaption>{one}</figure>"
        for name, one in zip(names, drawn, strict=True)
    ]
    return f'<div class="pane pane-{number}">{"".join(figures)}</div>'


def rules(shown: list[int]) -> str:
    """Style that shows the pane of the selected pass, without a script."""
    return "".join(
        f"#pass-{i}:checked ~ .panes .pane-{i} {{ display: grid; }} "
        f"#pass-{i}:checked ~ .chips [for=pass-{i}] {{ outline: 2px solid var(--ink); }} "
        f"#pass-{i}:focus-visible ~ .chips [for=pass-{i}] {{ outline-style: dashed; }}\n"
        for i in shown
    )


def explained(shown: int, passes: int, discounted: float) -> str:
    """Caption of the pictures."""
    text = (
        "Each picture is one vehicle going by: time runs down, channels run along the fiber, "
        "the dotted line is the vehicle. All pictures share one color scale, so a residual as pale as the quiet "
        "corners of the measurement is noise."
    )
    if shown < passes:
        text += f" Shown are the {shown} passes that fit worst, of {passes}."
    if discounted >= 0.0005:
        text += f" {100 * discounted:.1f} % of the samples were discounted, as outliers or for an unsure vehicle."
    return text


def waves(run: Run, misfit: Misfit) -> dict[str, str]:
    """Parts of the page that show measured, model and residual."""
    shown = worst(misfit.by_pass, MOST_PASSES)
    cells = min(MOST_CELLS, int((PIXELS / (3 * len(shown))) ** 0.5))
    pictures = [pictures_of(run.result, run.passes[i], cells) for i in shown]
    scale = color_scale(np.concatenate([part.measured.ravel() for part in pictures]))
    first = max(shown, key=lambda i: misfit.by_pass[i])
    both = list(zip(shown, pictures, strict=True))
    return {
        "rules": rules(shown),
        "radios": "".join(
            f'<input type="radio" name="pass" id="pass-{i}"{" checked" if i == first else ""}>' for i in shown
        ),
        "chips": "".join(chip(run.passes[i], i, misfit.by_pass[i], part, scale) for i, part in both),
        "panes": "".join(pane(run, i, part, scale) for i, part in both),
        "scale": svg(scale_figure(scale, SCALE)),
        "explained": explained(len(shown), len(run.passes), misfit.discounted),
    }
