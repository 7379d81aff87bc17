"""Noise as on real streets, kind by kind: is the record refused, and does the route lie as well as it claims?

    python benchmarks/street_noise.py --seeds 1 2 3 --kinds steady drifting heavy --camera

Every survey is a street of `--passes` vehicles at `--snr` dB. Errors are those across the fiber and in depth, of the
channels in view; `in sigmas` is the rms error in the route's own standard deviations, 1 where these are right, and
`inside` the share of places in the 95 % interval. `--camera` adds a camera's errors: correlated fixes, and tracks that
wander by 0.1 m. `--widened` judges besides what `roadfiber locate` gives: the corridor with what the model may lack.
The same seed is the same street and the same tracks for kinds of one geometry.
"""

import argparse
import dataclasses
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from solver.criticism.quick_corridor import widened
from solver.run.locate import locate
from solver.simulator import Scenario, simulate, write_survey
from solver.simulator.simulated_survey import Survey as Simulated
from solver.survey.survey import Survey
from vision.contract import InputError

#: What each kind changes of a plain street.
KINDS: dict[str, dict[str, Any]] = {
    "steady": {},
    "drifting": {"noise_drift": 0.5},
    "heavy": {"noise_freedom": 3.0},
    "common": {"effects": {"laser_noise": 1.0}},
    "side": {"side_street": 4.0},
    "highpass": {"effects": {"highpass": 0.15, "highpass_order": 2.0}},
    "fk": {"effects": {"fk_filter": 1.0}},
    "coarse": {"channel_spacing": 5.1, "gauge_length": 10.2, "channels": 60, "sampling_rate": 10.0},
    "gauge16": {"channel_spacing": 4.0, "gauge_length": 16.0, "channels": 75},
    "gauge50": {"channel_spacing": 1.0, "gauge_length": 50.0, "channels": 260},
    "rounded": {"rounding": 2.0},
    "real": {
        **{"channel_spacing": 5.1, "gauge_length": 10.2, "channels": 60, "sampling_rate": 10.0, "rounding": 1.0},
        **{"noise_drift": 0.3, "noise_freedom": 5.0, "side_street": 2.0},
    },
}
CAMERA: dict[str, Any] = {"track_noise": "camera", "track_wander": 0.1}
#: Names of the two directions, and what is told of each.
SIDES = ("across", "depth")


def scenario_of(kind: str, seed: int, passes: int, snr: float, camera: bool) -> Scenario:
    """The street of a kind."""
    plain = Scenario(seed=seed, passes=passes, snr_db=snr, noise="street")
    return dataclasses.replace(plain, **KINDS[kind], **(CAMERA if camera else {}))


def errors(made: Simulated, result: Any) -> dict[str, float]:
    """Rms error, m and in sigmas, and share inside the 95 % interval, across the fiber and in depth."""
    here = result.constrained & np.isin(result.channel, np.arange(made.active[0], made.active[1] + 1))
    error, covariance = result.route[here] - made.route[result.channel[here]], result.covariance[here]
    tangent = np.gradient(made.route, axis=0)[result.channel[here]]
    across = np.stack([-tangent[:, 1], tangent[:, 0], 0 * tangent[:, 0]], 1)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    found: dict[str, float] = {}
    for name, way in zip(SIDES, (across, np.broadcast_to([0.0, 0.0, 1.0], across.shape)), strict=True):
        off, sigma = (error * way).sum(1), np.sqrt(np.einsum("ca,cab,cb->c", way, covariance, way))
        found[f"{name} rms"] = float(np.sqrt((off**2).mean()))
        found[f"{name} in sigmas"] = float(np.sqrt(((off / sigma) ** 2).mean()))
        found[f"{name} inside"] = float((np.abs(off) < 1.96 * sigma).mean())
    return found


def row_of(kind: str, seed: int, options: argparse.Namespace) -> dict[str, Any]:
    """Simulate, locate and compare one survey; what is told where it is refused."""
    made = simulate(scenario_of(kind, seed, options.passes, options.snr, options.camera))
    row: dict[str, Any] = {"kind": kind, "seed": seed}
    begun = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        site = write_survey(made, Path(folder) / "survey")
        try:
            run = locate(Survey.read(site))
        except InputError as error:
            return row | {"refused": str(error)}
    row |= {"cpu s": time.process_time() - begun, "chi2/dof": run.result.chi2_per_dof, "says": run.headline}
    row |= errors(made, run.result)
    if not options.widened:
        return row
    return row | {
        f"{name}, widened": value for name, value in errors(made, widened(run).place).items() if "rms" not in name
    }


def main() -> None:
    """Judge every kind and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--seeds", nargs="+", type=int, default=[1])
    parser.add_argument("--passes", type=int, default=8)
    parser.add_argument("--snr", type=float, default=15.0, help="dB")
    parser.add_argument("--camera", action="store_true")
    parser.add_argument("--widened", action="store_true", help="judge the corridor of what the model may lack, too")
    options = parser.parse_args()
    rows = []
    for seed in options.seeds:
        for kind in options.kinds:
            rows.append(row_of(kind, seed, options))
            print({k: round(v, 3) if isinstance(v, float) else v for k, v in rows[-1].items()}, flush=True)
    table = pd.DataFrame(rows)
    print(table.groupby("kind", sort=False).mean(numeric_only=True).drop(columns="seed").round(3).to_string())


if __name__ == "__main__":
    main()
