"""Planned sigmas beside those of the fits of simulated surveys.

    python benchmarks/plan.py --surveys 50 --noise white --snr 15

The plan is told what a planner knows: how many vehicles of each class each lane has, the range of their speeds, SNR,
anchors, and where the fiber is (its mean offset and depth), or with `--unseen` the middle of where it may be. The
surveys come from the simulator, which shares no code with the signal path. A fit widens its sigmas where its own misfit
or its anchors' is above what noise leaves, by chance too; a plan cannot know that, so both figures are printed.
"""

import argparse
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from solver.criticism.planning.plan import plan_survey
from solver.fit.chain import Chain
from solver.fit.map_fit import MapFit
from solver.fit.posterior import Posterior
from solver.run.locate import locate
from solver.run.run import Run
from solver.simulator import Scenario, Survey, simulate, write_survey
from solver.survey.survey import Survey as Read

CLOSE = 0.15  # share by which a planned sigma may be off


def site_of(survey: Survey, *, unseen: bool = False) -> dict[str, Any]:
    """What a planner would write of a simulated survey."""
    scenario, view = survey.scenario, survey.route[survey.active[0] : survey.active[1] + 1]
    lanes = []
    for direction, y in zip((1, -1), scenario.lanes, strict=True):
        counts = Counter(one.vehicle_class for one in survey.vehicles if one.direction == direction)
        lanes.append({"y": y, "toward": "+x" if direction > 0 else "-x", "vehicles": dict(counts)})
    offset, depth = float(view[:, 1].mean()), float(view[:, 2].mean())
    if unseen:
        right = offset > max(scenario.lanes)
        beside = sum(scenario.lateral) / 2
        offset, depth = (max(scenario.lanes) + beside) if right else (min(scenario.lanes) - beside), 0.9
    first, last = scenario.view
    plan = {
        "length": last - first,
        "offset": offset,
        "snr_db": float(np.mean(scenario.snr_db)),
        "speeds": list(scenario.speeds),
        "sampling_rate": scenario.sampling_rate,
        "fix_sigma": scenario.fix_sigma,
        "frame_rate": scenario.frame_rate,
        "anchor_sigma": scenario.anchor_sigma,
        "lanes": lanes,
        "anchors": [(last - first) / 8, 7 * (last - first) / 8],
    }
    das = {"gauge_length": scenario.gauge_length, "channel_spacing": scenario.channel_spacing}
    return {"name": f"seed {scenario.seed}", "das": das, "plan": plan, "ground": {"depth": [depth, 0.3]}}


def widened(run: Run) -> float:
    """By how much a fit widened its sigmas for its own misfit and its anchors'."""
    fit = MapFit(run.problem)
    chain = Chain.of(run.problem)
    state = fit.state_of(fit.mean.new_tensor(run.result.vector))
    return float(Posterior(chain, chain.visit(state)).scale ** 0.5)


def compared(survey: Survey, *, unseen: bool = False) -> dict[str, float]:
    """Root mean square over the view of planned and fitted sigmas, across and in depth, m, and the fit's widening."""
    with tempfile.TemporaryDirectory() as folder:
        run = locate(Read.read(write_survey(survey, Path(folder) / "survey")))
    view = np.arange(survey.active[0], survey.active[1] + 1)
    fitted = run.result.sigma[np.isin(run.result.channel, view)]
    table = plan_survey(site_of(survey, unseen=unseen), effects=[]).table
    found = {"seed": float(survey.scenario.seed), "widened": widened(run)}
    for axis, name in ((1, "across"), (2, "depth")):
        found[f"{name} fitted"] = float(np.sqrt((fitted[:, axis] ** 2).mean()))
        found[f"{name} planned"] = float(np.sqrt((table[f"sigma_{'xyz'[axis]}"] ** 2).mean()))
    return found


def summary(table: pd.DataFrame) -> pd.DataFrame:
    """Planned over fitted sigma: mean over surveys, its median, extremes, share of surveys that are close."""
    rows = {}
    for name in ("across", "depth"):
        ratio = table[f"{name} planned"] / table[f"{name} fitted"]
        for label, values in ((name, ratio), (f"{name}, not widened", ratio * table["widened"])):
            rows[label] = {
                "mean": values.mean(),
                "median": values.median(),
                "lowest": values.min(),
                "highest": values.max(),
                f"within {CLOSE:.0%}": (np.abs(values - 1) < CLOSE).mean(),
            }
    return pd.DataFrame(rows).T


def main(arguments: Sequence[str] | None = None) -> None:
    """Simulate, locate, plan, and print a line per survey and the summary."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--surveys", type=int, default=50)
    parser.add_argument("--first", type=int, default=0, help="seed of the first")
    parser.add_argument("--noise", choices=("white", "colored", "street"), default="white")
    parser.add_argument("--snr", type=float, default=15.0, help="dB")
    parser.add_argument("--unseen", action="store_true", help="the planner does not know where the fiber is")
    options = parser.parse_args(arguments)
    rows = []
    for seed in range(options.first, options.first + options.surveys):
        survey = simulate(Scenario(seed=seed, noise=options.noise, snr_db=options.snr))
        rows.append(compared(survey, unseen=options.unseen))
        print({name: round(value, 4) for name, value in rows[-1].items()}, flush=True)
    print(summary(pd.DataFrame(rows)).round(3).to_string())


if __name__ == "__main__":
    main()
