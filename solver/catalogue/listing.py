"""The catalogue of effects for readers and for machines: `roadfiber effects`."""

import math
import shutil
from collections.abc import Collection, Mapping, Sequence
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from solver.catalogue.catalogue import FAULTS, FaultKind, family, find
from solver.effect import STAGES, Effect, Parameter

WIDEST = 100
SCOPE_WORDS = {
    "one": "",
    "pass": "one per pass",
    "fiber": "smooth along the fiber",
    "road": "smooth along the road",
    "track": "smooth along each pass",
    "time": "smooth in time",
}

Row = dict[str, Any]


def finite(value: float) -> float | None:
    """A bound as JSON has it: None where there is none."""
    return value if math.isfinite(value) else None


def parameter_row(p: Parameter) -> Row:
    """One parameter for machines; its null is None where it has none of its own."""
    return {
        "name": p.name,
        "unit": p.unit,
        "plausible": p.plausible,
        "null": None if p.is_shape else p.null,
        "lower": finite(p.lower),
        "upper": finite(p.upper),
        "scope": p.scope,
        "grid": list(p.grid),
    }


def effect_row(one: Effect, effects: Collection[Effect]) -> Row:
    """One of some effects for machines."""
    families = () if one.generic else one.families
    return {
        "name": one.name,
        "title": one.title,
        "stage": one.stage,
        "kind": "generic" if one.generic else "physical",
        "parameters": [parameter_row(p) for p in one.parameters],
        "physics": one.physics,
        "law": (one.change.__doc__ or "").strip().split("\n")[0],
        "source": one.source,
        "confounders": one.confounders,
        "families": {kind: [other for other in family(kind, effects) if other != one.name] for kind in families},
    }


def fault_row(fault: FaultKind) -> Row:
    """One fault for machines; it has no parameters, its size is found."""
    return {
        "name": fault.name,
        "title": fault.title,
        "stage": fault.stage,
        "kind": "fault",
        "parameters": [],
        "physics": fault.physics,
        "law": f"usual size {fault.plausible[0]:g} to {fault.plausible[1]:g}{unit_words(fault.unit)}",
        "source": fault.source,
        "confounders": "",
        "families": {},
    }


def listed(catalogue: Mapping[str, Effect]) -> list[Row]:
    """All effects and faults in the order of the stages; generic ones and faults last in theirs.

    >>> from solver.catalogue.catalogue import built_in
    >>> rows = listed(built_in())
    >>> rows[0]["name"], rows[0]["parameters"][0]["unit"], rows[-1]["stage"]
    ('clock_offset', 's', 'processing')
    """
    effects = catalogue.values()
    rows = [effect_row(one, effects) for one in effects] + [fault_row(fault) for fault in FAULTS.values()]
    kinds = ("physical", "generic", "fault")
    return sorted(rows, key=lambda row: (list(STAGES).index(row["stage"]), kinds.index(row["kind"])))


def one_of(rows: Sequence[Row], name: str) -> Row:
    """The row of one effect.

    Raises
    ------
    InputError
        If there is none of that name.
    """
    return find(name, {row["name"]: row for row in rows})


def unit_words(unit: str) -> str:
    """A unit after a number; nothing for a pure number.

    >>> unit_words("m"), unit_words("1")
    (' m', '')
    """
    return "" if unit == "1" else f" {unit}"


def bounds_words(p: Row) -> str:
    """Bounds of a parameter, in words.

    >>> bounds_words({"lower": 0, "upper": None}), bounds_words({"lower": -1, "upper": 1})
    ('at least 0', '-1 to 1')
    """
    lower, upper = p["lower"], p["upper"]
    if lower is None and upper is None:
        return "unbounded"
    if lower is None:
        return f"at most {upper:g}"
    return f"at least {lower:g}" if upper is None else f"{lower:g} to {upper:g}"


def parameter_words(p: Row) -> str:
    """One parameter in a line.

    >>> parameter_words(parameter_row(Parameter("offset", "s", 0.2, lower=-5, upper=5)))
    'offset: plausible 0.2 s, null 0, -5 to 5'
    """
    null = "searched on a grid" if p["null"] is None else f"null {p['null']:g}"
    parts = [f"plausible {p['plausible']:g}{unit_words(p['unit'])}", null, bounds_words(p), SCOPE_WORDS[p["scope"]]]
    return f"{p['name']}: {', '.join(part for part in parts if part)}"


def confounded_words(row: Row) -> str:
    """What an effect is hard to tell from, in words; "" where that is nothing."""
    families = " and ".join(row["families"])
    parts = [row["confounders"], f"family {families}" if families else ""]
    return "; ".join(part for part in parts if part)


def entry(row: Row) -> Text:
    """What the list says of an effect."""
    text = Text() if row["title"] == row["name"] else Text(f"{row['title']}. ", "bold")
    text.append(row["physics"])
    for p in row["parameters"]:
        text.append(f"\n{parameter_words(p)}", "green")
    if not row["parameters"]:
        text.append(f"\n{row['law']}", "green")
    confounded = confounded_words(row)
    if confounded:
        text.append(f"\nconfounded with: {confounded}", "yellow")
    text.append(f"\n{row['source']}", "dim")
    return text


def console() -> Console:
    """A console no wider than what reads well."""
    return Console(width=min(WIDEST, shutil.get_terminal_size((WIDEST, 24)).columns), highlight=False)


def name_of(row: Row) -> Text:
    """Name of an effect, marked where it is not a physical one."""
    text = Text(row["name"], "bold")
    if row["kind"] != "physical":
        text.append(f"\n({row['kind']})", "italic not bold")
    return text


def print_list(rows: Sequence[Row]) -> None:
    """Print all effects, stage by stage."""
    out = console()
    for stage in STAGES:
        table = Table(title=stage, title_justify="left", show_header=False, width=out.width, leading=1)
        table.add_column(width=21, overflow="fold")
        table.add_column(ratio=1)
        for row in rows:
            if row["stage"] == stage:
                table.add_row(name_of(row), entry(row))
        out.print(table)


def print_details(row: Row, rows: Sequence[Row]) -> None:
    """Print one effect, and the physics of those that it is confounded with."""
    out = console()
    title = "" if row["title"] == row["name"] else f", {row['title'].lower()}"
    out.print(Text(f"{row['name']}{title}: {row['kind']} effect on the {row['stage']} stage", "bold"))
    out.print(Text(f"{row['physics']}\n{row['law']}\nSource: {row['source']}"))
    for p in row["parameters"]:
        out.print(Text(parameter_words(p), "green"))
        if p["grid"]:
            out.print(Text(f"  tried: {', '.join(f'{value:g}' for value in p['grid'])}"))
    if row["confounders"]:
        out.print(Text(f"Confounded with: {row['confounders']}", "yellow"))
    physics = {other["name"]: other["physics"] for other in rows}
    for kind, members in row["families"].items():
        out.print(Text(f"Family {kind}: not named without these unless the survey separates them", "yellow"))
        for other in members:
            out.print(Text(f"  {other}: {physics[other]}"))
