"""Both fits on the same simulated surveys: largest error along the view, honesty of the sigmas, seconds.

    python benchmarks/fits.py --scenario street-blind --surveys 30 --methods spline

The surveys come from the simulator, which shares no code with the signal path. Ratios within one run are what to quote.
"""

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np
import pandas as pd

from solver.fit.result import FitResult
from solver.run.locate import locate
from solver.run.methods import METHODS
from solver.simulator import Survey, simulate, write_survey
from solver.simulator.scenario import read_scenario
from solver.survey.survey import Survey as Read


def scored(survey: Survey, result: FitResult, seconds: float) -> dict[str, float]:
    """Errors (m) along the view, errors in sigmas (rms; 1 is honest), shares within 1.96 sigma (0.95), seconds."""
    view = np.arange(survey.active[0], survey.active[1] + 1)
    here = np.isin(result.channel, view)
    error = result.route[here] - survey.route[result.channel[here]]
    in_sigmas = np.sqrt(((error / result.sigma[here]) ** 2).mean(0))
    covered = (np.abs(error) < 1.96 * result.sigma[here]).mean(0)
    names = ("rms x / sigma", "rms y / sigma", "rms z / sigma")
    distance = np.linalg.norm(error, axis=1)
    return {
        "located share": here.sum() / len(view),
        "largest error": distance.max(),
        "mean error": distance.mean(),
        **dict(zip(names, in_sigmas, strict=True)),
        **{f"{axis} within": share for axis, share in zip("xyz", covered, strict=True)},
        "fit seconds": result.seconds,
        "all seconds": seconds,
    }


def main() -> None:
    """Run the comparison and print means over surveys."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--surveys", type=int, default=10)
    parser.add_argument("--scenario", default="street", help="built-in name or TOML file")
    parser.add_argument("--passes", type=int, help="the scenario's where not given")
    parser.add_argument("--snr", type=float, help="dB over the map of a pass; the scenario's where not given")
    parser.add_argument("--methods", nargs="+", default=list(METHODS))
    options = parser.parse_args()
    rows = []
    for seed in range(options.surveys):
        survey = simulate(
            read_scenario(options.scenario, seed=seed, passes=options.passes, snr_db=options.snr, laid="winding")
        )
        with tempfile.TemporaryDirectory() as folder:
            site = Read.read(write_survey(survey, Path(folder) / "survey"))
            for method in options.methods:
                begun = time.perf_counter()
                located = locate(site, method=method)
                rows.append({"method": method, **scored(survey, located.result, time.perf_counter() - begun)})
                print(seed, method, f"{rows[-1]['largest error']:.3f} m", flush=True)
    table = pd.DataFrame(rows).groupby("method")
    print(table.mean().round(3).T.to_string())
    print("\nlargest error, 95 % of surveys below:", table["largest error"].quantile(0.95).round(3).to_dict())


if __name__ == "__main__":
    main()
