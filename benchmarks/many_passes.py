"""Many vehicles on a street of 100 m: CPU, memory and errors of `locate`, by the number of passes, side by side.

    python benchmarks/many_passes.py --passes 8 20 80

The surveys come from the simulator, which shares no code with the signal path. Each is read from files and located in a
process of its own, whose CPU and peak memory are told. What to quote are the ratios to the first within one run.
"""

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from roadfiber.widening import FIT, FULL, with_corridor
from solver.run.locate import locate
from solver.simulator import simulate, write_survey
from solver.simulator.scenario import read_scenario
from solver.survey.memory import reuse_freed_memory
from solver.survey.survey import Survey


def measured(site: Path, out: Path, all_passes: bool, corridor: str) -> None:
    """Locate in this process, as the command does, and print what it took as one line of JSON."""
    reuse_freed_memory()
    begun = time.perf_counter()
    survey = Survey.read(site)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    located = with_corridor(locate(survey, all_passes=all_passes), corridor)
    seconds, cpu = time.perf_counter() - begun, time.process_time()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    result = located.result
    np.savez(out, channel=result.channel, route=result.route, sigma=result.sigma)
    facts: dict[str, Any] = {"seconds": seconds, "cpu seconds": cpu, "GB": peak / 1e6, "GB once read": before / 1e6}
    facts |= {"chi2/dof": result.chi2_per_dof, "held out": located.facts["held_out_chi2_per_dof"]}
    facts |= {"converged": result.converged, "iterations": result.iterations, "fitted": len(located.problem.passes)}
    print(json.dumps(facts | {f"{name} s": value for name, value in located.facts["timings"].items()}))


def row_of(passes: int, options: argparse.Namespace) -> dict[str, object]:
    """Make, locate and compare one survey."""
    survey = simulate(read_scenario(options.scenario, seed=options.seed, passes=passes, laid="winding"))
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        site, truth, active = write_survey(survey, folder / "survey"), survey.route, survey.active
        del survey
        command = [sys.executable, __file__, "--locate", str(site), "--out", str(folder / "route.npz")]
        command += ["--corridor", options.corridor, *(["--all-passes"] if options.all_passes else [])]
        ended = subprocess.run(command, check=True, capture_output=True, text=True)
        facts = json.loads(ended.stdout.splitlines()[-1])
        with np.load(folder / "route.npz") as found:
            here = np.isin(found["channel"], np.arange(active[0], active[1] + 1))
            error = found["route"][here] - truth[found["channel"][here]]
            in_sigmas = float(np.sqrt(((error / found["sigma"][here]) ** 2).mean()))
    distance = np.linalg.norm(error, axis=1)
    return {
        "passes": passes,
        "mean error": float(distance.mean()),
        "largest error": float(distance.max()),
        "rms error / sigma": in_sigmas,
        **facts,
    }


def main() -> None:
    """Locate with every number of passes and print a table; with `--locate`, one survey only."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--passes", nargs="+", type=int, default=[8, 20, 80])
    parser.add_argument("--scenario", default="street-blind", help="built-in name or TOML file")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--locate", type=Path, help="a site.toml: locate it and say what that took")
    parser.add_argument("--all-passes", action="store_true", help="fit all, and not those that tell most")
    parser.add_argument("--corridor", choices=(FULL, FIT), default=FULL, help="as of `roadfiber locate`")
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    if options.locate:
        measured(options.locate, options.out, options.all_passes, options.corridor)
        return
    rows: list[dict[str, object]] = []
    for passes in options.passes:
        rows.append(row_of(passes, options))
        table = pd.DataFrame(rows)
        table["CPU ratio"] = table["cpu seconds"] / table["cpu seconds"][0]
        print(table.set_index("passes").T.round(3).to_string(), flush=True)


if __name__ == "__main__":
    main()
