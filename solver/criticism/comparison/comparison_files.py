"""compare.json, compare.html and the pictures, written beside the run."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from solver.criticism.comparison.comparison import Comparison
from solver.criticism.comparison.comparison_page import WIDE, render
from solver.criticism.comparison.comparison_words import region_words, verdict
from solver.criticism.comparison.figures import figures_of
from solver.criticism.comparison.map_figure import map_figure
from solver.criticism.comparison.power import Powers
from solver.criticism.comparison.split import SOURCES
from solver.run.report.joined import join
from solver.run.run import Run
from solver.run.strict_json import strict
from vision.contract import progress, writing_into

FORMAT = "roadfiber comparison 1"
UNITS = {
    "chi2_per_dof": "1, squared noise sigmas",
    "noise": "1, squared noise sigmas",
    "regions": {
        "x": "m",
        "time": "ISO 8601 UTC",
        "ahead": "m ahead of the vehicle",
        "amount": "as `unit` says; gain 1 = 100 %",
        "sigma": "likewise",
        "meters": "m",
        "speed": "m/s up the channels",
        "chi2": "1",
        "z": "standard deviations",
    },
    "split": "chi2, and shares of it",
    "stack": {"ahead": "m", "measured, model, residual, symmetric, antisymmetric, sigma": "stacked model's peak"},
    "power": {"chi2, sigma": "1, per sample", "frequency": "Hz", "wavenumber": "1/m", "power": "that of the noise"},
}


def powers_facts(powers: Powers) -> list[dict[str, Any]]:
    """One row per value of a property."""
    columns = (powers.labels, powers.chi2, powers.sigma, powers.samples)
    return [dict(zip(("label", "chi2", "sigma", "samples"), row, strict=True)) for row in zip(*columns, strict=True)]


def facts_of(comparison: Comparison, run: Run) -> dict[str, Any]:
    """The content of compare.json: strict JSON, with the units of everything."""
    split, power = comparison.split, comparison.power

    def moment(seconds: float) -> str:
        return f"{run.start + round(seconds * 1e9)}"[:23] + "Z"

    regions = [
        asdict(region)
        | {"words": region_words(region, run), "unit": region.unit}
        | {"time": None if region.time is None else [moment(seconds) for seconds in region.time]}
        for region in comparison.regions
    ]
    shares = {name: split.share(name) for name in SOURCES}
    properties = ("channel", "one_pass", "speed", "vehicle_class", "lane", "gap")
    facts = {
        "format": FORMAT,
        "name": run.facts["name"],
        "created": run.facts["created"],
        "effects": run.facts["effects"],
        "verdict": verdict(comparison, run),
        "trust": run.trust,
        "units": UNITS,
        "chi2_per_dof": comparison.chi2_per_dof,
        "noise_floor": comparison.noise_floor,
        "samples": split.samples,
        "regions": regions,
        "split": {
            "chi2": split.chi2,
            "explained": split.explained,
            "freedom": split.freedom,
            "noise": split.noise,
            "unexplained": split.unexplained,
            "shares": shares
            | {"channels": split.share(*SOURCES[:2]), "passes": split.share(*SOURCES[2:4])}
            | {"noise": split.noise / split.chi2, "unexplained": split.unexplained / split.chi2},
        },
        "stack": asdict(comparison.stack),
        "power": {name: powers_facts(getattr(power, name)) for name in properties}
        | {"by_pass_and_channel": power.by_pass_and_channel, "spectrum": asdict(power.spectrum)},
        "noise": dict(zip(map(str, run.result.fitted_channel), comparison.noise, strict=True)),
    }
    checked: dict[str, Any] = strict(facts)
    return checked


def write_comparison(folder: Path, comparison: Comparison, run: Run) -> None:
    """Write compare.html, compare.json and the pictures into a folder, all or none.

    Parameters
    ----------
    folder : where to; made where it does not exist
    comparison, run : what to write
    """
    with progress("drawing", 2) as advance, writing_into(folder) as scratch:
        figures = figures_of(comparison, run, WIDE)
        facts = json.dumps(facts_of(comparison, run), allow_nan=False, indent=1)
        (scratch / "compare.html").write_text(render(comparison, run, figures), encoding="utf-8")
        (scratch / "compare.json").write_text(facts, encoding="utf-8")
        advance(1)
        for name, figure in (figures | {"maps": map_figure(comparison, run, WIDE)}).items():
            figure.savefig(scratch / f"compare_{name}.png", dpi=144, facecolor="white")
        advance(1)
    if (folder / "fit.json").is_file():
        join(folder)
