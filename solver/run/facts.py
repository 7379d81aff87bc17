"""What fit.json says: results in numbers, and where they come from."""

import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from importlib.metadata import version
from typing import Any

from solver.fit.held_out import HeldOut
from solver.fit.problem import Problem
from solver.fit.result import FitResult
from solver.run.floor import noise_floor
from solver.run.gates import trust_of
from solver.run.problem_arrays import problem_facts
from solver.run.run_corridor import corridor_facts
from solver.run.stored import FORMAT
from solver.run.strict_json import strict
from solver.survey.anchors import Anchor
from solver.survey.das.record import DASRecord
from solver.survey.site_sections import GroundSection
from solver.survey.survey import Survey

PACKAGES = ("roadfiber", "torch", "numpy", "scipy", "dascore", "pandas", "pyproj", "matplotlib")


def versions() -> dict[str, str]:
    """Return the versions of Python, roadfiber and what it computes with.

    >>> sorted(versions())[-2:]
    ['scipy', 'torch']
    """
    return {"python": platform.python_version(), **{name: version(name) for name in PACKAGES}}


def settings_of(ground: GroundSection, record: DASRecord) -> dict[str, Any]:
    """Return the numbers that the fit was given, m, Hz, s."""
    return {
        "gauge_length": record.gauge_length,
        "channel_spacing": record.channel_spacing,
        "sampling_rate": record.sampling_rate,
        "gaps": record.gaps,
        "poisson_ratio": ground.poisson_ratio,
        "depth": ground.depth,
    }


def fitted_facts(
    result: FitResult, problem: Problem, held_out: HeldOut | None, disputed: Sequence[str]
) -> dict[str, Any]:
    """Return what fit.json says of a fit: its numbers and whether they may be relied on; arguments as of `trust_of`."""
    floor = noise_floor(problem)
    return {
        "converged": result.converged,
        "iterations": result.iterations,
        "seconds": result.seconds,
        "parameters": {name: asdict(parameter) for name, parameter in result.parameters.items()},
        "chi2": result.chi2,
        "chi2_per_dof": result.chi2_per_dof,
        "cost": result.cost,
        "noise_floor": floor and floor.value,
        "held_out_chi2_per_dof": held_out and held_out.chi2_per_dof,
        "shared": result.shared,
        "corners": [asdict(one) for one in result.corners],
        "ambiguous_side": result.ambiguous_side,
        "disputed_anchors": disputed,
        "trust": asdict(trust_of(result, problem, floor, held_out, disputed)),
        "corridor": corridor_facts(result),
        "problem": problem_facts(problem),
    }


def facts_of(
    result: FitResult,
    survey: Survey,
    anchors: Sequence[Anchor],
    problem: Problem,
    timings: Mapping[str, float],
    held_out: HeldOut | None,
    effects: Sequence[str],
    warnings: Sequence[str] = (),
    disputed: Sequence[str] = (),
) -> dict[str, Any]:
    """Return the content of fit.json, strict JSON; the arguments are those of `solver.run.run.run_of`."""
    frame, record = survey.frame, survey.record
    facts = {
        "format": FORMAT,
        "name": survey.name,
        "method": result.method,
        "effects": effects,
        **fitted_facts(result, problem, held_out, disputed),
        "active_channels": [result.fitted_channel[0], result.fitted_channel[-1]],
        "notes": warnings,
        "frame": {"origin": frame.origin, "x_azimuth": frame.x_azimuth},
        "start": f"{record.start}Z",
        "anchors": [asdict(anchor) for anchor in anchors],
        "settings": settings_of(survey.ground, record),
        "plugins": [],
        "record": {name: value for name, value in record.provenance.items() if name not in ("files", "sha256")},
        "statements": [one.to_dict() for one in (*record.statements, *survey.statements)],
        "inputs": [asdict(source) for source in survey.sources],
        "timings": timings,
        "versions": versions(),
        "created": datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z"),
    }
    checked: dict[str, Any] = strict(facts)
    return checked
