"""One page that shows a run: it opens offline, on a phone, in the dark, and prints."""

from html import escape
from string import Template
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from solver.run.geojson import Z95, half_width
from solver.run.report import report_words as words
from solver.run.report.fit_tables import check_section, choice_section, fit_facts, inputs, parameter_tables, terms
from solver.run.report.glossary import glossary
from solver.run.report.misfit import misfit_of
from solver.run.report.misfit_figure import failure_figure
from solver.run.report.parts import EXPORT, json_text, next_section, resource, with_commands
from solver.run.report.pass_panes import waves
from solver.run.report.route_figure import along_x, route_figure
from solver.run.report.street_view import street_section
from solver.run.run import Run
from solver.run.run_corridor import probable
from vision.contract.figures import svg
from vision.contract.statements import Statements, table_html

WIDE, NARROW = 1060, 350  # px


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
    place = run.place
    x, y, z = place.route.T
    latitude, longitude = run.frame.to_geographic(x, y)
    columns = {"x": x, "y": y, "z": z, "distance": place.distance, "vertical": Z95 * place.sigma[:, 2]}
    columns |= {"lateral": half_width(place.route, place.covariance), "offset": np.zeros_like(x)}
    degrees = {"latitude": np.round(latitude, 7), "longitude": np.round(longitude, 7)}
    whole = {"channel": place.channel, "constrained": place.constrained}
    return json_text({name: np.round(column, 3) for name, column in columns.items()} | degrees | whole)


def legend(run: Run) -> str:
    """Swatches of the map."""
    wind = [words.wind(run.frame.x_azimuth + turn) for turn in (0, 180)]
    counts = [sum(p.speed > 0 for p in run.passes), sum(p.speed <= 0 for p in run.passes)]
    items = ['<i style="border-color: var(--route)"></i>fiber', '<i class="band"></i>95 % corridor']
    if run.added is not None:
        items.append('<i class="band inner"></i>if the model lacks nothing')
    result = run.result
    if not run.place.reliable.all() or (result.data_share[:, 2] < 0.5).any():
        dashed = "assumed, not measured" if words.trusted(run) else "not to be relied on"
        items.append(f'<i style="border-color: var(--route); border-top-style: dashed"></i>{dashed}')
    for name, way, count in zip(("forward", "backward"), wind, counts, strict=True):
        if count:
            items.append(f'<i style="border-color: var(--{name})"></i>{words.counted(count, "vehicle")} to the {way}')
    if not all(p.in_view.all() for p in run.passes):
        items.append('<i style="border-color: var(--backward); border-top-style: dotted"></i>extrapolated, not seen')
    if run.anchors:
        items.append('<i class="box"></i>anchor, with its 95 % bar')
    signs = {"corner": ("◇", "the fiber turns"), "step": ("▽", "it goes deeper, △ less deep")}
    for sign, told in (signs[kind] for kind in sorted({one.kind for one in result.corners})):
        items.append(f"<b>{sign}</b> {told}")
    return "".join(f"<span>{item}</span>" for item in items)


def sides(run: Run) -> str:
    """How to read the map."""
    return (
        f"The survey line is x, along the road toward {words.wind(run.frame.x_azimuth)}; right and left are as seen "
        f"looking that way. {words.held(run)}"
    )


def caution_section(run: Run) -> str:
    """What to know before relying on the route."""
    lines = run.facts["warnings"]
    if not lines:
        return ""
    items = "".join(f"<li>{escape(line[:1].upper() + line[1:])}</li>" for line in lines)
    return f"<section><h2>What to know before relying on it</h2><ul>{items}</ul></section>"


def sureness_section(run: Run) -> str:
    """How wide the corridor is with what the model may lack, and how probable each explanation is that widens it."""
    if not run.corridor:
        return ""
    rows = "".join(
        f'<tr><td class="names">{escape(one["title"])}</td><td>{100 * one["probability"]:.0f} %</td></tr>'
        for one in probable(run.facts["corridor"])
    )
    table = f"<table><tr><th>what the model may lack</th><th>probability</th></tr>{rows}</table>" if rows else ""
    told = with_commands(words.sure(run))
    return f"<section><h2>How sure the route is</h2><p>{with_commands(run.corridor)}</p><p>{told}</p>{table}</section>"


NEXT = (
    "`roadfiber compare RUN` shows where, when and how model and measurement differ, `roadfiber diagnose RUN` says "
    "which physical effect the model lacks, if any.",
    EXPORT,
)


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
        next=next_section(NEXT),
        sureness=sureness_section(run),
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
        statements=table_html([Statements.of(one) for one in run.facts.get("statements", ())]),
        version=escape(run.facts["versions"]["roadfiber"]),
        terms=glossary(),
        created=escape(run.facts["created"]),
        route=route_json(run),
    )
