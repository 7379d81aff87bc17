"""The comparison as one page: it opens offline, and its pictures share one zoom."""

import base64
from html import escape
from importlib.resources import files
from string import Template
from typing import Any

import numpy as np
from matplotlib.colors import AsinhNorm
from matplotlib.figure import Figure
from numpy.typing import NDArray

from solver.catalogue.catalogue import title_of
from solver.criticism.comparison import comparison_words as words
from solver.criticism.comparison.comparison import Comparison
from solver.criticism.comparison.figures import figures_of
from solver.criticism.comparison.map_figure import CELLS
from solver.criticism.comparison.pass_windows import path_of, shown, touches
from solver.criticism.comparison.regions import Region
from solver.run.report.glossary import glossary
from solver.run.report.misfit import misfit_of, pass_label, rows_of
from solver.run.report.misfit_figure import Pictures, pictures_of, scale_figure, worst
from solver.run.report.parts import json_text, next_section, resource, with_commands
from solver.run.report.pass_panes import MOST_PASSES, THUMBNAIL
from solver.run.run import Run
from vision.contract.drawing import coarse, color_map, color_scale
from vision.contract.figures import data_uri, png_bytes, svg

WIDE, NARROW = 1060, 350  # px
PIXELS = 1_500_000  # of all pictures together, which keeps the page below 6 MB
STEP = 0.02  # noise sigmas by which the page knows each sample
COLORS = 256


def packed(picture: NDArray[np.float64]) -> str:
    """A picture [row, channel] as base64 of 16-bit integers in steps of `STEP`; -32768 where there is none.

    >>> base64.b64decode(packed(np.array([[0.04, np.nan]]))).hex()
    '02000080'
    """
    steps = np.where(np.isfinite(picture), np.clip(np.nan_to_num(picture) / STEP, -32767, 32767), -32768)
    return base64.b64encode(np.round(steps).astype("<i2").tobytes()).decode()


def table_of_colors(scale: AsinhNorm) -> list[list[int]]:
    """Colors [color, 3], 0 to 255, from the lower to the upper end of the scale."""
    return [[int(v) for v in row[:3]] for row in color_map()(np.linspace(0, 1, COLORS), bytes=True)]


def one_map(run: Run, comparison: Comparison, number: int, pictures: Pictures) -> dict[str, Any]:
    """What the script draws of a pass."""
    result, one = run.result, run.passes[number]
    seconds = run.time[rows_of(result, shown(run, one))]
    at, path = path_of(run, one)
    forward = 1 if np.nansum(np.diff(path)) >= 0 else -1
    boxes = []
    for index, region in enumerate(comparison.regions):
        times = touches(region, run, number)
        if times is not None:
            box = {"region": index, "channels": region.channels, "time": [t - seconds[0] for t in times]}
            spacing = run.facts["settings"]["channel_spacing"] * forward
            band = None if region.ahead is None else [meters / spacing for meters in region.ahead]
            boxes.append(box | {"band": band})
    return {
        "label": pass_label(one),
        "start": float(seconds[0]),
        "seconds": float(seconds[-1] - seconds[0]),
        "channels": result.fitted_channel[[0, -1]],
        "shape": pictures.measured.shape,
        "measured": packed(pictures.measured),
        "model": packed(pictures.model),
        "residual": packed(pictures.residual),
        "path": np.round(path, 2),
        "at": np.round(at - seconds[0], 3),
        "boxes": boxes,
    }


def chip(run: Run, number: int, at: int, pictures: Pictures, chi2: float, scale: AsinhNorm) -> str:
    """Button that selects a pass, with a thumbnail of its residual."""
    image = coarse(pictures.residual, THUMBNAIL)
    source = data_uri(png_bytes(color_map()(scale(np.ma.masked_invalid(image)))))
    one = run.passes[number]
    return (
        f'<button type="button" data-pass="{at}"><img alt="residual" src="{source}">'
        f"<b>{escape(pass_label(one))}</b>{3.6 * abs(one.speed):.0f} km/h<br>chi² {chi2:.2f}</button>"
    )


def maps(comparison: Comparison, run: Run) -> dict[str, str]:
    """Parts of the page that show measured, model and residual."""
    by_pass = misfit_of(run.result, run.passes).by_pass
    chosen = worst(by_pass, MOST_PASSES)
    cells = min(CELLS, int((PIXELS / (3 * len(chosen))) ** 0.5))
    pictures = [pictures_of(run.result, shown(run, run.passes[i]), cells) for i in chosen]
    scale = color_scale(np.concatenate([part.measured.ravel() for part in pictures]))
    data = {
        "day": str(run.start),
        "step": STEP,
        "linear": float(scale.linear_width),
        "top": float(scale.vmax or 1.0),
        "colors": table_of_colors(scale),
        "first": chosen.index(max(chosen, key=lambda i: by_pass[i])),
        "passes": [one_map(run, comparison, i, part) for i, part in zip(chosen, pictures, strict=True)],
    }
    chips = (
        chip(run, i, at, part, by_pass[i], scale) for at, (i, part) in enumerate(zip(chosen, pictures, strict=True))
    )
    more = (
        f"Shown are the {len(chosen)} passes that fit worst, of {len(run.passes)}."
        if len(chosen) < len(run.passes)
        else ""
    )
    return {"maps": json_text(data), "chips": "".join(chips), "scale": svg(scale_figure(scale, NARROW)), "more": more}


def region_row(region: Region, index: int, run: Run, total: float) -> str:
    """Row of the list of regions."""
    what = escape(words.region_words(region, run))
    size = words.size_words(region)
    x = f"{region.x[0]:.0f} to {region.x[1]:.0f}"
    return (
        f'<tr data-region="{index}" tabindex="0"><td>{what[:1].upper() + what[1:]}</td><td>{x}</td>'
        f"<td>{escape(size)}</td><td>{region.chi2:,.0f}</td><td>{100 * region.chi2 / total:.1f}</td></tr>"
    )


def region_table(comparison: Comparison, run: Run) -> str:
    """Where the model fails, as a table."""
    if not comparison.regions:
        return "<p>Nothing stands out: no gain, delay, shift or offset of any channels in any passes, and no power.</p>"
    total = comparison.split.chi2
    rows = "".join(region_row(region, i, run, total) for i, region in enumerate(comparison.regions))
    head = "<th>what is wrong</th><th>x, m</th><th>size</th><th>chi²</th><th>% of all</th>"
    table = f'<table class="regions"><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>'
    return f'<div class="wide-table">{table}</div>'


def key_figures(comparison: Comparison) -> list[tuple[str, str, str]]:
    """Figures at the top: label, value, what it means."""
    split = comparison.split
    above = max(split.chi2 - split.noise, 0.0)
    name = words.largest_source(comparison)
    share = f"{100 * split.explained[name] / above:.0f} %" if name else "none"
    floor = comparison.noise_floor
    alone = "what noise alone leaves is not known" if floor is None else f"noise alone leaves {floor:.3f}"
    beyond = "not known" if floor is None else f"{100 * max(comparison.excess, 0.0):.1f} %"
    return [
        ("Misfit, chi²/dof", f"{comparison.chi2_per_dof:.3f}", alone),
        ("Above the noise", beyond, f"of {split.samples:,} samples"),
        ("Largest one cause", share, words.NAMES[name] if name else "explains a fifth of that"),
        ("Regions that fail", str(len(comparison.regions)), "noise makes one in under 5 of 100 surveys"),
    ]


def split_text(comparison: Comparison) -> str:
    """How to read the split."""
    split = comparison.split
    noise = 100 * split.noise / split.chi2
    return (
        f"Of chi², {noise:.1f} % is noise. The rest is shared out by least squares: a gain and a shift of each "
        "channel, a gain and a delay of each pass, and for each lane any shape that travels with the vehicles, "
        f"averaged over the orders of taking them in; what their {sum(split.freedom.values())} numbers would "
        "explain of noise is subtracted."
    )


NEXT = (
    "`roadfiber diagnose RUN` says which physical effect the model lacks, if any.",
    "`roadfiber workbench RUN` shows the same in the browser, to try effects by hand.",
)


def render(comparison: Comparison, run: Run, wide: dict[str, Figure] | None = None) -> str:
    """The comparison as one HTML page that needs no other file.

    Parameters
    ----------
    comparison : of `run`
    run : as `solver.run.folder.read_run` reads it
    wide : its figures where they are drawn already, see `figures_of`
    """
    template = Template(files("solver.criticism.comparison").joinpath("template.html").read_text(encoding="utf-8"))
    figures = "".join(
        f"<div><dt>{escape(label)}</dt><dd>{escape(value)}</dd><dd>{escape(note)}</dd></div>"
        for label, value, note in key_figures(comparison)
    )
    wide, narrow = wide or figures_of(comparison, run, WIDE), figures_of(comparison, run, NARROW)
    drawn = {
        name: f'<div class="wide">{svg(wide[name])}</div><div class="narrow">{svg(narrow[name])}</div>' for name in wide
    }
    return template.substitute(
        maps(comparison, run),
        **drawn,
        style=resource("style.css"),
        name=escape(run.facts["name"]),
        when=f"recorded {str(run.start)[:16].replace('T', ' ')} UTC",
        effects=escape(", ".join(map(title_of, run.effects)) or "no effect beyond the base"),
        headline=escape(words.headline(comparison, run)),
        grade=run.facts["trust"]["grade"],
        trust=with_commands(run.trust),
        verdict=escape(words.verdict(comparison, run)),
        key_figures=figures,
        next=next_section(NEXT),
        regions=region_table(comparison, run),
        split_text=escape(split_text(comparison)),
        version=escape(run.facts["versions"]["roadfiber"]),
        terms=glossary(),
        created=escape(run.facts["created"]),
    )
