"""The numbers of a run as the tables and lists of its page: parameters, settings, checks, chosen passes, files."""

import math
from collections import defaultdict
from html import escape
from pathlib import PurePath

import numpy as np
import torch

from solver.catalogue.catalogue import title_of
from solver.fit.result import Parameter
from solver.run.report import report_words as words
from solver.run.run import Run
from vision.contract.rounding import with_sigma


def terms(pairs: list[tuple[str, str]]) -> str:
    """Rows of a description list; the texts are escaped."""
    return "".join(f"<dt>{escape(name)}</dt><dd>{escape(text)}</dd>" for name, text in pairs)


def cell(parameter: Parameter | None) -> str:
    """Value and standard deviation of a parameter, to two digits of the latter."""
    if parameter is None:
        return "<td></td>"
    value, sigma = parameter.value, parameter.sigma
    if not parameter.free:
        return f"<td>{value:.4g} <small>fixed</small></td>"
    if not math.isfinite(sigma):
        return f"<td>{value:.4g}</td>"
    if sigma < 1e-3:
        return f"<td>{value:.3g} <small>± {sigma:.1g}</small></td>"
    number, _, spread = with_sigma(value, sigma).partition(" ± ")
    return f"<td>{number} <small>± {spread}</small></td>"


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
    seconds = ", ".join(f"{name.replace('_', ' ')} {value:.1f} s" for name, value in facts["timings"].items())
    samples = int(np.isfinite(result.measured).sum())
    ended = "converged" if result.converged else "not converged"
    depth, spacing, ratio = settings["depth"], settings["channel_spacing"], run.problem.prior.poisson_ratio
    instrument = f"gauge length {gauge_words(run)}, channel spacing {spacing:g} m"
    noise = f"{settings['sampling_rate']:g} Hz, median noise {np.nanmedian(result.noise):.2g} 1/s"
    return [
        ("Method", f"{result.method}, {result.iterations} iterations, {ended}"),
        ("Effects in the model", ", ".join(map(title_of, facts["effects"])) or "no effect beyond the base"),
        ("Fitted", f"channels {first} to {last}, {len(run.passes)} passes, {samples:,} samples"),
        ("On passes left out", "not tried" if held_out is None else f"chi²/dof {held_out:.3f}"),
        ("Interrogator", f"{instrument}, {noise}"),
        ("Assumed", f"depth {depth[0]:g} ± {depth[1]:g} m, Poisson's ratio {ratio[0]:g} ± {ratio[1]:g}"),
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
