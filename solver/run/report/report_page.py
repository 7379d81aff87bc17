"""One page that shows a run: it opens offline, on a phone, in the dark, and prints."""

import json
import math
from collections import defaultdict
from html import escape
from pathlib import PurePath
from string import Template
from typing import Any

import numpy as np
import torch
from matplotlib.colors import AsinhNorm
from matplotlib.figure import Figure

from solver.fit.result import Parameter
from solver.run.geojson import Z95, half_width
from solver.run.report import report_words as words
from solver.run.report.misfit import Misfit, misfit_of
from solver.run.report.misfit_figure import (
    Pictures,
    failure_figure,
    pass_label,
    pictures_of,
    scale_figure,
    wave_figure,
    worst,
)
from solver.run.report.parts import resource, with_commands
from solver.run.report.route_figure import along_x, route_figure
from solver.run.report.street_view import street_section
from solver.run.run import Run
from solver.run.strict_json import strict
from solver.trajectory.vehicle_pass import Pass
from vision.contract.drawing import coarse, color_map, color_scale
from vision.contract.figures import data_uri, png_bytes, svg

WIDE, NARROW, PANEL = 1060, 350, 340  # px
MOST_PASSES = 16  # that the page shows in full
MOST_CELLS, THUMBNAIL = 300, 60  # rows or columns of a picture
PIXELS = 1_000_000  # of all pictures together, which keeps the page below 4 MB


def json_text(value: Any) -> str:
    """JSON that can stand in HTML."""
    return (
        json.dumps(strict(value), allow_nan=False, separators=(",", ":"))
        .replace("<", "\\u003c")
        .replace("'", "\\u0027")
    )


def terms(pairs: list[tuple[str, str]]) -> str:
    """Rows of a description list; the texts are escaped."""
    return "".join(f"<dt>{escape(name)}</dt><dd>{escape(text)}</dd>" for name, text in pairs)


# ---- the map ---------------------------------------------------------------------------------------------------------


def panels_of(figure: Figure, run: Run) -> list[dict[str, Any]]:
    """Where each panel of the map is, as fractions of the figure from the upper left, and what it shows."""
    straight = along_x(run.result.route)
    main, side = ("x", "y") if straight else ("distance", "offset")
    shown = {"plan": ("x", "y"), "lateral": (main, side), "depth": (main, "z")}
    panels = []
    for axes in figure.axes:
        name, box = str(axes.get_label()), axes.get_position()
        across, down = shown[name]
        panels.append(
            {"name": name, "across": across, "down": down, "left": box.x0, "top": 1 - box.y1}
            | {"width": box.width, "height": box.height, "x": axes.get_xlim(), "y": axes.get_ylim()}
        )
    return panels


def route_json(run: Run) -> str:
    """What the pointer reads out: the route with 95 % half-widths."""
    result = run.result
    x, y, z = result.route.T
    latitude, longitude = run.frame.to_geographic(x, y)
    columns = {"x": x, "y": y, "z": z, "distance": result.distance, "vertical": Z95 * result.sigma[:, 2]}
    columns |= {"lateral": half_width(result.route, result.covariance), "offset": np.zeros_like(x)}
    degrees = {"latitude": np.round(latitude, 7), "longitude": np.round(longitude, 7)}
    whole = {"channel": result.channel, "constrained": result.constrained}
    return json_text({name: np.round(column, 3) for name, column in columns.items()} | degrees | whole)


def legend(run: Run) -> str:
    """Swatches of the map."""
    wind = [words.wind(run.frame.x_azimuth + turn) for turn in (0, 180)]
    counts = [sum(p.speed > 0 for p in run.passes), sum(p.speed <= 0 for p in run.passes)]
    items = ['<i style="border-color: var(--route)"></i>fiber', '<i class="band"></i>95 % corridor']
    result = run.result
    if not result.constrained.all() or (result.data_share[:, 2] < 0.5).any():
        items.append('<i style="border-color: var(--route); border-top-style: dashed"></i>assumed, not measured')
    for name, way, count in zip(("forward", "backward"), wind, counts, strict=True):
        if count:
            items.append(f'<i style="border-color: var(--{name})"></i>{words.counted(count, "vehicle")} to the {way}')
    if not all(p.in_view.all() for p in run.passes):
        items.append('<i style="border-color: var(--backward); border-top-style: dotted"></i>extrapolated, not seen')
    if run.anchors:
        items.append('<i class="box"></i>anchor, with its 95 % bar')
    return "".join(f"<span>{item}</span>" for item in items)


# ---- measured, model, residual ---------------------------------------------------------------------------------------


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
    figures = [
        f"<figure><figcaption>{name.capitalize()}</figcaption>"
        f"{svg(wave_figure(run, run.passes[number], picture, scale, PANEL))}</figure>"
        for name, picture in vars(pictures).items()
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
        "scale": svg(scale_figure(scale, NARROW)),
        "explained": explained(len(shown), len(run.passes), misfit.discounted),
    }


# ---- numbers ---------------------------------------------------------------------------------------------------------


def cell(parameter: Parameter | None) -> str:
    """Value and standard deviation of a parameter, to two digits of the latter."""
    if parameter is None:
        return "<td></td>"
    value, sigma = parameter.value, parameter.sigma
    if not parameter.free:
        return f"<td>{value:.4g} <small>fixed</small></td>"
    if not math.isfinite(sigma):
        return f"<td>{value:.4g}</td>"
    if not 1e-3 <= sigma < 1e3:
        return f"<td>{value:.3g} <small>± {sigma:.1g}</small></td>"
    digits = max(0, 1 - math.floor(math.log10(sigma)))
    return f"<td>{value:.{digits}f} <small>± {sigma:.{digits}f}</small></td>"


def heading(name: str, unit: str) -> str:
    """Name of a parameter with its unit.

    >>> heading("amplitude", "m^2"), heading("poisson_ratio", "1")
    ('amplitude, m²', 'poisson_ratio')
    """
    return escape(name if unit in ("", "1") else f"{name}, {unit.replace('^2', '²')}")


def parameter_tables(parameters: dict[str, Parameter]) -> str:
    """One table of single parameters, one with a row per pass for those named `name[pass]`."""
    single: dict[str, Parameter] = {}
    of_pass: defaultdict[str, dict[str, Parameter]] = defaultdict(dict)
    for name, parameter in parameters.items():
        base, bracket, track = name.partition("[")
        if bracket:
            of_pass[track.rstrip("]")][base] = parameter
        else:
            single[name] = parameter
    rows = "".join(f"<tr><td>{heading(n, p.unit)}</td>{cell(p)}</tr>" for n, p in single.items())
    units = {name: p.unit for columns in of_pass.values() for name, p in columns.items()}
    head = "".join(f"<th>{heading(name, unit)}</th>" for name, unit in units.items())
    body = "".join(
        f"<tr><td>{escape(track)}</td>{''.join(cell(columns.get(name)) for name in units)}</tr>"
        for track, columns in of_pass.items()
    )
    passes = f"<table><tr><th>pass</th>{head}</tr>{body}</table>" if of_pass else ""
    return f"<table>{rows}</table>{passes}"


def fit_facts(run: Run) -> list[tuple[str, str]]:
    """How the route was found."""
    facts, settings, result = run.facts, run.facts["settings"], run.result
    held_out, (first, last) = facts["held_out_chi2_per_dof"], facts["active_channels"]
    seconds = ", ".join(f"{name} {value:.1f} s" for name, value in facts["timings"].items())
    samples = int(np.isfinite(result.measured).sum())
    ended = "converged" if result.converged else "not converged"
    depth, spacing = settings["depth"], settings["channel_spacing"]
    instrument = f"gauge length {gauge_words(run)}, channel spacing {spacing:g} m"
    noise = f"{settings['sampling_rate']:g} Hz, median noise {np.nanmedian(result.noise):.2g} 1/s"
    return [
        ("Method", f"{result.method}, {result.iterations} iterations, {ended}"),
        ("Effects in the model", ", ".join(facts["effects"]) or "base model"),
        ("Fitted", f"channels {first} to {last}, {len(run.passes)} passes, {samples:,} samples"),
        ("On passes left out", "not tried" if held_out is None else f"chi²/dof {held_out:.3f}"),
        ("Interrogator", f"{instrument}, {noise}"),
        ("Assumed", f"depth {depth[0]:g} ± {depth[1]:g} m, Poisson ratio about {settings['poisson_ratio']:g}"),
        ("Computing time", seconds or "not taken"),
    ]


def gauge_words(run: Run) -> str:
    """Gauge length as the model has it, and as the files say where an effect changes it."""
    said, effects = run.problem.gauge_length, [one for one in run.problem.effects if one.stage == "interrogator"]
    extension = run.problem.extension(effects)
    numbers = extension.numbers()
    for slot in extension.slots:
        name, count = f"{slot.effect.name}.{slot.parameter.name}", slot.where.stop - slot.where.start
        fitted = [run.result.parameters.get(name if count == 1 else f"{name}[{i}]") for i in range(count)]
        numbers[slot.where] = torch.tensor(
            [slot.parameter.null if one is None else one.value for one in fitted]
        ).double()
    length = torch.as_tensor(extension.described(extension.local(numbers), said).interrogator.gauge_length)
    low, high = float(length.min()), float(length.max())
    if max(abs(low - said), abs(high - said)) < 1e-9 * said:
        return f"{said:g} m"
    return f"{words.lengths(low, high)} m as fitted ({said:g} m by the files)"


def inputs(run: Run) -> list[tuple[str, str]]:
    """Files with checksums, and versions."""
    sources = [(f["role"], f"{PurePath(f['path']).name}, SHA-256 {f['sha256']}") for f in run.facts["inputs"]]
    versions = ", ".join(f"{name} {number}" for name, number in run.facts["versions"].items())
    return [*sources, ("versions", versions)]


def sides(run: Run) -> str:
    """How to read the map."""
    return (
        f"The survey line is x, along the road toward {words.wind(run.frame.x_azimuth)}; right and left are as seen "
        "looking that way. If the model holds, the true route lies inside the corridor at 95 of 100 places."
    )


def caution_section(run: Run) -> str:
    """What to know before relying on the route."""
    lines = run.facts["warnings"]
    if not lines:
        return ""
    items = "".join(f"<li>{escape(line[:1].upper() + line[1:])}</li>" for line in lines)
    return f"<section><h2>What to know before relying on it</h2><ul>{items}</ul></section>"


def check_section(run: Run) -> str:
    """Every check of the fit, and how much of what it looks for the fit would have taken up."""
    rows = "".join(
        f"<tr><td>{escape(gate['name'])}</td><td>{words.VERDICTS[gate['verdict']]}</td>"
        f'<td class="names">{escape(gate["words"])}</td><td>{share_words(gate["taken_up"])}</td></tr>'
        for gate in run.facts["trust"]["gates"]
    )
    head = "<tr><th>check</th><th>verdict</th><th>what was found</th><th>taken up by the fit</th></tr>"
    return (
        "<section><h2>What was checked</h2><p>A check says little where the fit itself takes up most of what is wrong "
        "before it shows. For passes held out that share is not known: each still fits its own strength, shift and "
        "wheels, and what bends the route bends it for them too.</p>"
        f'<div class="wide-table"><table class="checks">{head}{rows}</table></div></section>'
    )


def choice_section(run: Run) -> str:
    """Which of many passes were fitted, what each was expected to add, and what kind is missing."""
    choice = run.facts.get("choice")
    if not choice or not choice["taken"]:
        return ""
    names = list(choice["taken"][0]["narrower"])

    def row(words: list[str], narrower: dict[str, float]) -> str:
        cells = [f"<td>{escape(word)}</td>" for word in words]
        return f"<tr>{''.join(cells)}{''.join(f'<td>{100 * narrower[name]:.1f} %</td>' for name in names)}</tr>"

    taken = "".join(
        row(
            [one["track_id"], one["vehicle_class"], f"{3.6 * one['speed']:+.0f}", f"{one['lane']:.1f}"], one["narrower"]
        )
        for one in choice["taken"]
    )
    missing = "".join(row([f"a pass {one['kind']}", "", "", ""], one["narrower"]) for one in choice["missing"])
    head = "".join(f"<th>{escape(name)}</th>" for name in names)
    return (
        f"<details><summary>Passes fitted: {len(choice['taken'])} of {choice['of']}</summary><p>Each was taken since "
        "it was expected to narrow the sigmas most, with those above it known; by how much, the columns say. The last "
        "rows are what a pass of a kind that was not recorded would add.</p>"
        f'<div class="wide-table"><table><tr><th>pass</th><th>class</th><th>km/h</th><th>y, m</th>{head}</tr>'
        f"{taken}{missing}</table></div></details>"
    )


def share_words(share: float | None) -> str:
    """A share as a page shows it."""
    return "-" if share is None else f"{100 * share:.0f} %"


def render(run: Run) -> str:
    """The report as one HTML page that needs no other file.

    Parameters
    ----------
    run : as `write_run` builds or `read_run` reads it

    Returns
    -------
    html : the page
    """
    template = Template(resource("template.html"))
    trust = run.facts["trust"]
    misfit = misfit_of(run.result, run.passes)
    wide, narrow = (route_figure(run, width) for width in (WIDE, NARROW))
    key_figures = "".join(
        f"<div><dt>{escape(label)}</dt><dd>{escape(value)}</dd><dd>{escape(note)}</dd></div>"
        for label, value, note in words.key_figures(run)
    )
    return template.substitute(
        waves(run, misfit),
        style=resource("style.css"),
        name=escape(run.facts["name"]),
        when=f"recorded {str(run.start)[:16].replace('T', ' ')} UTC",
        headline=escape(run.facts["headline"]),
        grade=trust["grade"],
        verdict=with_commands(trust["sentence"]),
        checks=check_section(run),
        key_figures=key_figures,
        cautions=caution_section(run),
        sides=escape(sides(run)),
        street=street_section(run),
        legend=legend(run),
        panels_wide=json_text(panels_of(wide, run)),
        panels_narrow=json_text(panels_of(narrow, run)),
        map_wide=svg(wide),
        map_narrow=svg(narrow),
        failure_wide=svg(failure_figure(run, misfit, WIDE)),
        failure_narrow=svg(failure_figure(run, misfit, NARROW)),
        facts=terms(fit_facts(run)),
        choice=choice_section(run),
        parameters=parameter_tables(run.result.parameters),
        inputs=terms(inputs(run)),
        version=escape(run.facts["versions"]["roadfiber"]),
        created=escape(run.facts["created"]),
        route=route_json(run),
    )
