"""Blind trials: surveys with nothing, one, two, unknown or unfindable effects hidden, by a generator of their own.

    python benchmarks/blind.py --trials 40                    # locate each; errors and chi2 by kind
    python benchmarks/blind.py --trials 40 --write blind      # write the surveys with truth.json, and no more
    python benchmarks/blind.py --trials 40 --diagnose         # diagnose each too, and judge
    python benchmarks/blind.py --trials 40 --kind one --add   # put the hidden effect in: errors before and after
    python benchmarks/blind.py --score blind                  # once each has its run/diagnosis.json

Trial n is the same survey everywhere. The generator shares no code with the signal path or the catalogue.
"""

import argparse
import json
import tempfile
import time
import zlib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch

from solver.run.locate import locate
from solver.run.run import Run
from solver.simulator import EFFECTS, Scenario, Survey, read_scenario, simulate, write_survey
from solver.simulator.effects import hidden
from solver.survey.survey import Survey as Read

KINDS = {"null": 0.25, "one": 0.4, "two": 0.1, "unknown": 0.15, "geometry": 0.1}
#: Effects that a survey of eight to ten passes can show at a plausible size.
FAIR = (
    "wheel_layout", "long_vehicle", "dynamic_load", "road_bump", "braking", "grade_drag", "unseen_vehicle",
    "poisson_gradient", "stiffness_contrast", "layered_ground", "gibson_soil", "viscoelastic_lag", "channel_coupling",
    "shear_lag", "conduit_slip", "slack_spool", "channel_wander", "gauge_length", "pulse_width",
    "time_averaging", "highpass", "lowpass", "saturation", "cycle_skips", "common_mode", "fk_filter", "median_filter",
    "clock_offset", "track_bias", "track_bend", "track_jitter",
)  # fmt: skip
#: Effects that no fit can tell from the route, the depth or the loads' size.
GEOMETRY = (
    "camber", "poisson_ratio", "unknown_anisotropy", "track_offset", "track_rotation", "track_scale", "channel_stretch",
)  # fmt: skip
#: Effects of the catalogue that are one effect here with a setting.
ALIASES = {
    "kelvin_voigt_lag": ("viscoelastic_lag",),
    "maxwell_flow": ("viscoelastic_lag",),
    "lowpass_zero_phase": ("lowpass",),
}
#: Outside the catalogue, and not absorbed by what is free in every fit (the load of a pass).
UNKNOWN = tuple(
    name for name in EFFECTS if name.startswith("unknown_") and name not in {*GEOMETRY, "unknown_speed_load"}
)


def draw_trial(seed: int, kind: str | None = None) -> Scenario:
    """Draw a survey, `street-blind`, with effects hidden as chance, or `kind` (out of `KINDS`), has it."""
    rng = np.random.default_rng([seed, zlib.crc32(b"blind trial")])
    drawn = str(rng.choice(list(KINDS), p=list(KINDS.values())))
    kind = kind or drawn
    pool = {"null": (), "unknown": UNKNOWN, "geometry": GEOMETRY}.get(kind, FAIR)
    names = [str(name) for name in rng.choice(pool, size=1 + (kind == "two"), replace=False)] if pool else []
    while kind == "two" and EFFECTS[names[0]].stage == EFFECTS[names[1]].stage:
        names[1] = str(rng.choice(pool))
    effects = {name: amount(name, rng) for name in names}
    return read_scenario("street-blind", seed=seed, name=f"{kind}-{seed}", effects=effects)


def amount(name: str, rng: np.random.Generator) -> float:
    """A plausible amount, of either sign where both are."""
    size = float(rng.uniform(*EFFECTS[name].plausible))
    return size * float(rng.choice([-1, 1])) if EFFECTS[name].signed else size


def kind_of(name: str) -> str:
    """Kind of a drawn trial, by its scenario's name."""
    return name.split("-")[0]


def judged(truth: Mapping[str, Any], diagnosis: Mapping[str, Any]) -> dict[str, bool]:
    """Whether a diagnosis (the content of diagnosis.json) says of a survey (that of truth.json) what it should.

    - null: `right`, adequate; `wrong`, an effect is claimed
    - one, two: `right`, a hidden effect, or one declared inseparable from it, is first; `wrong`, another is claimed
    - unknown: `right`, an unknown effect or inconclusive; `wrong`, a known one is claimed; `stage`, the first
      candidate's is that of the hidden one
    - geometry: `right`, nothing is claimed, or nothing alone; `wrong`, something is named alone
    """
    names = set(truth["hidden_effect"].split()) - {"none"}
    stages = {EFFECTS[name].stage for name in names}
    first = next(iter(diagnosis["candidates"]), None)
    claimed = diagnosis["verdict"] == "missing-effect"
    said = {first["effect"], *first["confounded_with"]} if first else set()
    if not names:
        return {"right": diagnosis["verdict"] == "adequate", "wrong": claimed}
    if names <= set(UNKNOWN):
        right = diagnosis["verdict"] in ("unknown-effect", "inconclusive")
        return {"right": right, "wrong": claimed, "stage": bool(first) and first["stage"] in stages}
    if names <= set(GEOMETRY):
        alone = claimed and len(said) == 1
        return {"right": not alone, "wrong": alone}
    found = bool(names & {known for one in said for known in ALIASES.get(one, (one,))})
    return {"right": claimed and found, "wrong": claimed and not found}


def judge_all(folder: Path) -> pd.DataFrame:
    """Judge every trial-* of a folder that has a run/diagnosis.json."""
    rows = []
    for trial in sorted(folder.glob("trial-*")):
        diagnosis = trial / "run" / "diagnosis.json"
        if diagnosis.is_file():
            truth = json.loads((trial / "truth.json").read_text(encoding="utf-8"))
            found = json.loads(diagnosis.read_text(encoding="utf-8"))
            first = next(iter(found["candidates"]), {"effect": "none"})
            facts = {"trial": trial.name, "kind": kind_of(truth["scenario"]), "hidden": truth["hidden_effect"]}
            rows.append(facts | {"verdict": found["verdict"], "first": first["effect"]} | judged(truth, found))
    return pd.DataFrame(rows)


def scored(survey: Survey, located: Run, seconds: float) -> dict[str, object]:
    """What a trial's fit came to, before any diagnosis."""
    result = located.result
    view = np.arange(survey.active[0], survey.active[1] + 1)
    here = np.isin(result.channel, view)
    error = np.linalg.norm(result.route[here] - survey.route[result.channel[here]], axis=1)
    scenario = survey.scenario
    switches = hidden(scenario.effects, scenario.seed)
    return {
        "seed": scenario.seed,
        "kind": kind_of(scenario.name),
        "hidden": " ".join(f"{name}={value:.3g}" for name, value in switches.items() if name in EFFECTS) or "none",
        "snr_db": scenario.snr_db,
        "passes": scenario.passes,
        "located share": here.sum() / len(view),
        "largest error": error.max(),
        "chi2_per_dof": result.chi2_per_dof,
        "seconds": seconds,
    }


def surveyed(scenario: Scenario) -> tuple[Survey, Run, float]:
    """Simulate, write, read and locate a survey; with the seconds that locating took."""
    survey = simulate(scenario)
    with tempfile.TemporaryDirectory() as folder:
        site = write_survey(survey, Path(folder) / "survey")
        begun = time.perf_counter()
        located = locate(Read.read(site))
    return survey, located, time.perf_counter() - begun


def tried(seed: int, kind: str | None) -> dict[str, object]:
    """Simulate, write, read and locate one trial."""
    return scored(*surveyed(draw_trial(seed, kind)))


def diagnosed(seed: int, kind: str | None) -> dict[str, object]:
    """Simulate, locate and diagnose one trial, and judge what the diagnosis says."""
    from dataclasses import asdict

    from solver.catalogue.catalogue import built_in
    from solver.criticism.diagnosis import diagnose
    from solver.fit.map_fit import MapFit

    scenario = draw_trial(seed, kind)
    survey = simulate(scenario)
    with tempfile.TemporaryDirectory() as folder:
        site = write_survey(survey, Path(folder) / "survey")
        truth = json.loads((site.parent / "truth.json").read_text(encoding="utf-8"))
        located = locate(Read.read(site))
        begun = time.process_time()
        state = MapFit(located.problem).state_of(torch.from_numpy(located.result.vector))
        found = diagnose(located.problem, state, effects=list(built_in().values()))
    first = found.candidates[0].effect if found.candidates else "none"
    said = {"verdict": found.verdict, "first": first, "cpu seconds": round(time.process_time() - begun, 1)}
    facts = {"seed": seed, "kind": kind_of(scenario.name), "hidden": truth["hidden_effect"]}
    errors = {"largest error": round(float(scored(survey, located, 0.0)["largest error"]), 3)}  # type: ignore[arg-type]
    return facts | errors | said | judged(truth, asdict(found))


def added(seed: int, kind: str | None) -> dict[str, object]:
    """Put the first hidden effect of a trial into the model, as `roadfiber add` does, and compare with none hidden."""
    from solver.catalogue.catalogue import built_in
    from solver.criticism.growth import grow, held_out_before
    from solver.fit.map_fit import MapFit

    scenario = draw_trial(seed, kind)
    name = next(iter(scenario.effects))
    without, plain, _ = surveyed(replace(scenario, effects={}))
    survey, located, _ = surveyed(scenario)
    fit = MapFit(located.problem)
    state = fit.state_of(torch.from_numpy(located.result.vector))
    step = grow(fit, state, name, built_in(), held_out_before(located, fit, state))
    after = replace(located, result=step.result(0.0))
    cases = {"without": (without, plain), "before": (survey, located), "after": (survey, after)}
    rows = {case: scored(*of, 0.0) for case, of in cases.items()}
    figures = {
        f"{key} {case}": round(float(row[key]), 3)
        for case, row in rows.items()
        for key in ("largest error", "chi2_per_dof")
    }  # type: ignore[arg-type]
    return {"seed": seed, "hidden": name, "kept": step.better, "held out": (step.before, step.after)} | figures


def main() -> None:
    """Run trials, or write them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="seed of the first trial")
    parser.add_argument("--kind", choices=list(KINDS), help="all trials of one kind")
    parser.add_argument("--write", type=Path, metavar="DIR", help="write the surveys there, numbered, and no more")
    parser.add_argument("--score", type=Path, metavar="DIR", help="judge the diagnoses of written trials, and no more")
    parser.add_argument("--diagnose", action="store_true", help="diagnose each too, and judge what is said")
    parser.add_argument("--add", action="store_true", help="put each trial's first hidden effect into the model")
    options = parser.parse_args()
    if options.score:
        table = judge_all(options.score)
        if table.empty:
            parser.error(f"{options.score}: no trial-*/run/diagnosis.json")
        print(table.to_string(index=False))
        figures = table.drop(columns=["trial", "kind", "hidden", "verdict", "first"]).astype(float)
        print(figures.groupby(table["kind"]).mean().round(3).to_string())
        return
    seeds = range(options.first, options.first + options.trials)
    if options.write:
        options.write.mkdir(parents=True, exist_ok=True)
        for seed in seeds:
            print(
                write_survey(simulate(draw_trial(seed, options.kind)), options.write / f"trial-{seed:04}"), flush=True
            )
        return
    rows = []
    if options.add:
        for seed in (seed for seed in seeds if draw_trial(seed, options.kind).effects):
            rows.append(added(seed, options.kind))
            print(rows[-1], flush=True)
        return
    if options.diagnose:
        for seed in seeds:
            rows.append(diagnosed(seed, options.kind))
            print(rows[-1], flush=True)
        table = pd.DataFrame(rows)
        print(table.groupby("kind")[[c for c in ("right", "wrong", "stage") if c in table]].mean().round(3).to_string())
        return
    for seed in seeds:
        rows.append(tried(seed, options.kind))
        print(
            {key: round(value, 3) if isinstance(value, float) else value for key, value in rows[-1].items()}, flush=True
        )
    table = pd.DataFrame(rows)
    figures = table.groupby("kind")[["largest error", "chi2_per_dof", "seconds"]]
    print(figures.agg(["mean", "median", "max"]).round(3).to_string())


if __name__ == "__main__":
    main()
