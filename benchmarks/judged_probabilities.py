"""What `benchmarks/reliability.py` counts as right, and how often it was: tables and the reliability diagram."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.blind import ALIASES
from solver.simulator import EFFECTS

#: Chi2 that a hidden effect adds to the misfit of a fit without it, in variances that the noise counts as, from which
#: on it shows: 5 sigma, as a diagnosis has it; and from which on it may.
SHOWS, MAY_SHOW = 25.0, 9.0
EDGES = (0.01, 0.05, 0.2, 0.5, 0.8, 0.95, 1.0)


def said(names: Iterable[str]) -> set[str]:
    """Names of the catalogue as the simulator has them."""
    return {known for name in names for known in ALIASES.get(name, (name,))}


def claims(row: Mapping[str, Any]) -> list[tuple[float, bool]]:
    """Probability of each explanation, the unknown as one, and whether it is so.

    What is hidden and does not show counts as nothing, and to name it is left out; of what may show, from 3 to 5 sigma,
    nothing is left out, too. What the diagnosis says that it may have overlooked is what it does not tell as nothing.
    """
    hidden, shows = set(row["hidden"]), row["misfit"] >= SHOWS
    open_to_doubt = bool(hidden) and not shows and row["misfit"] >= MAY_SHOW
    told: list[tuple[float, bool]] = []
    unknown = sum(one["probability"] for one in row["explanations"] if one["kind"] == "unknown")
    if shows or row["kind"] != "unknown":
        told.append((unknown, row["kind"] == "unknown"))
    for one in row["explanations"]:
        if one["kind"] == "nothing" and not open_to_doubt:
            told.append((one["probability"], not shows))
        elif one["kind"] in ("effect", "two", "fault"):
            known = set(ALIASES.get(one["effects"][0], (one["effects"][0],)))
            so = bool(hidden & known) and row["kind"] != "unknown"
            if shows or not so:
                told.append((one["probability"], so))
    return told


def judged(row: Mapping[str, Any]) -> dict[str, float]:
    """Shares that count: NaN where a survey says nothing of one.

    - claimed: something missing, known or unknown, where nothing is hidden
    - named: a hidden effect that shows well is, or is among those named together
    - wrong: what is named is not hidden, nor told to be inseparable from what is
    - open: where what is hidden does not show, nothing else is claimed
    - blamed: on a known effect, what is not in the catalogue
    - placed: something unknown that is called so, at its stage
    - both: of two effects, one after the other; the second where it shows well, too, once the first is in the model
    """
    hidden, names = set(row["hidden"]), said(row["named"])
    claimed, right = bool(row["named"]), bool(hidden & names)
    kind, rest = row["kind"], hidden - names
    shares = dict.fromkeys(("claimed", "named", "wrong", "open", "blamed", "placed", "both"), np.nan)
    silent = row["verdict"] in ("adequate", "inconclusive")
    if kind == "null":
        return shares | {"claimed": float(not silent)}
    if kind == "unknown":
        stages = {EFFECTS[name].stage for name in hidden}
        placed = float(row["stage"] in stages) if row["verdict"] == "unknown-effect" else np.nan
        return shares | {"blamed": float(claimed), "placed": placed}
    shares["wrong"] = float(claimed and not right)
    if row["misfit"] < SHOWS:
        return shares | {"open": float(silent or right)}
    if row["misfit"] >= 4 * SHOWS:
        shares["named"] = float(right)
        second = row.get("misfit of the second")
        if kind == "two" and (second is None or second >= 4 * SHOWS):
            shares["both"] = float(right and (not rest or bool(rest & said(row["then"]))))
    return shares


def binned(rows: Sequence[Mapping[str, Any]]) -> tuple[pd.DataFrame, float]:
    """How often explanations were right, by how probable they were called, and the expected calibration error."""
    told = [one for row in rows for one in claims(row) if one[0] > EDGES[0]]
    table = pd.DataFrame(told, columns=["said", "right"])
    table["bin"] = pd.cut(table["said"], EDGES)
    grouped = table.groupby("bin", observed=True).agg(
        said=("said", "mean"), right=("right", "mean"), count=("said", "size")
    )
    error = float((grouped["count"] * (grouped["said"] - grouped["right"]).abs()).sum() / grouped["count"].sum())
    return grouped, error


def draw_plot(table: pd.DataFrame, path: Path) -> None:
    """The reliability diagram: how often right against how probable, with binomial 95 % intervals (Wilson)."""
    from matplotlib.figure import Figure

    z, n, p = 1.96, table["count"].to_numpy(), table["right"].to_numpy()
    middle = (p + z**2 / (2 * n)) / (1 + z**2 / n)
    half = z * np.sqrt(p * (1 - p) / n + z**2 / (4 * n**2)) / (1 + z**2 / n)
    figure = Figure(figsize=(5, 4.6), dpi=140, layout="constrained")
    axes = figure.subplots()
    axes.plot([0, 1], [0, 1], color="#8a929a", linewidth=1)
    axes.vlines(table["said"], middle - half, middle + half, color="#0072b2", linewidth=2)
    axes.plot(table["said"], p, "o", color="#0072b2")
    for x, y, count in zip(table["said"], middle + half, n, strict=True):
        axes.annotate(f"{count}", (x, y), textcoords="offset points", xytext=(0, 3), ha="center", fontsize=8)
    axes.set(
        xlim=(-0.04, 1.06),
        ylim=(-0.04, 1.08),
        xlabel="probability that the diagnosis gives",
        ylabel="share that was so",
    )
    figure.savefig(path)


def report(rows: Sequence[Mapping[str, Any]], plot: Path | None) -> None:
    """Print tables of all rows, and draw the diagram."""
    table, error = binned(rows)
    print(f"{len(rows)} surveys; expected calibration error {error:.3f}")
    print(table.round(3).to_string())
    frame = pd.DataFrame([{**row, **judged(row)} for row in rows])
    shares = ["claimed", "named", "wrong", "open", "blamed", "placed", "both"]
    print(pd.DataFrame({"share": frame[shares].mean(), "surveys": frame[shares].count()}).round(3).to_string())
    figures = ["inside plain", "half plain", "inside considered", "half considered", "cpu seconds"]
    kinds = frame.groupby("kind")
    print(kinds[figures].mean().join(kinds.size().rename("surveys")).round(3).to_string())
    if plot is not None:
        draw_plot(table, plot)
