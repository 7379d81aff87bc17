"""Whether a diagnosis names a cause with confidence where a record is unlike any model: noise, gaps, vehicles, filters.

    python -m benchmarks.street_verdicts --first 1 --trials 100 --out verdicts.jsonl
    python -m benchmarks.street_verdicts --table verdicts.jsonl

Each seed draws a street of 4 to 8 passes with noise of one kind of `benchmarks/street_noise.py`, mostly seen by a
camera, with gaps, spikes, dead channels and now and then a vehicle that nobody listed. A name is wrong unless it is
that of what the kind does to the record; spikes and heavy tails are samples that jump, and vehicles on a side street
are ones that nobody listed. One file may be filled by several runs; seeds in it are left out.
"""

import argparse
import dataclasses
import json
import time
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch

from benchmarks.blind import surveyed
from benchmarks.judged_probabilities import said
from benchmarks.reliability import known_to
from benchmarks.street_noise import CAMERA, KINDS
from solver.simulator import Scenario
from vision.contract import InputError

#: Shares of surveys with a camera's errors, and with a vehicle that nobody listed.
FILMED, UNSEEN = 0.7, 0.25


def draw(seed: int) -> tuple[str, Scenario]:
    """Kind of noise and scenario of a seed."""
    rng = np.random.default_rng([seed, zlib.crc32(b"street verdicts")])
    kind = str(rng.choice(list(KINDS)))
    more: dict[str, Any] = dict(KINDS[kind])
    if rng.uniform() < FILMED:
        more |= CAMERA
    if rng.uniform() < UNSEEN:
        more["effects"] = {**more.get("effects", {}), "unseen_vehicle": float(rng.uniform(0.3, 2.0))}
    plain = Scenario(
        seed=seed,
        passes=int(rng.integers(4, 9)),
        snr_db=float(rng.uniform(8, 20)),
        noise="street",
        view=(0.0, float(rng.uniform(50, 80))),
        gaps=int(rng.integers(0, 3)),
        spikes=float(rng.choice([0.0, 1e-3])),
        bad_channels=int(rng.integers(0, 4)),
    )
    return kind, dataclasses.replace(plain, **more)


def tried(seed: int) -> dict[str, Any]:
    """What is said of one survey: verdict, names, probabilities; or that it was refused."""
    from solver.catalogue.catalogue import built_in
    from solver.criticism.diagnosis import diagnose
    from solver.criticism.quick_corridor import widened
    from solver.fit.map_fit import MapFit

    kind, scenario = draw(seed)
    also = {"cycle_skips": 1.0} if scenario.spikes or scenario.noise_freedom else {}
    also |= {"unseen_vehicle": 1.0} if scenario.side_street else {}
    row: dict[str, Any] = {
        "seed": seed,
        "kind": kind,
        "hidden": {**scenario.effects, **also},
        "filmed": scenario.track_wander,
    }
    begun = time.process_time()
    try:
        located = widened(surveyed(scenario)[1])
    except InputError as error:
        return row | {"verdict": "refused", "named": [], "says": str(error)}
    state = MapFit(located.problem).state_of(torch.from_numpy(located.result.vector))
    found = diagnose(located.problem, state, effects=list(built_in().values()))
    return row | {
        "verdict": found.verdict,
        "named": known_to(found),
        "says": found.words,
        "explanations": [vars(one) for one in found.explanations if one.probability > 0.01],
        "cpu seconds": time.process_time() - begun,
    }


def wrong(row: Mapping[str, Any]) -> bool:
    """Whether a cause is named that the survey does not have."""
    return bool(row["named"]) and not said(row["named"]) & set(row["hidden"])


def table(rows: list[dict[str, Any]]) -> pd.DataFrame:
    """How often each kind of noise ends in each verdict, and how often in a wrong name."""
    frame = pd.DataFrame(rows)
    counts = pd.crosstab(frame["kind"], frame["verdict"])
    return counts.assign(wrong=frame.assign(wrong=[wrong(row) for row in rows]).groupby("kind")["wrong"].sum())


def main() -> None:
    """Try seeds, or print the table of a file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--trials", type=int, default=20)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--table", type=Path)
    options = parser.parse_args()
    if options.table:
        rows = [json.loads(line) for line in options.table.read_text().splitlines()]
        print(table(rows).to_string())
        for row in filter(wrong, rows):
            print(row["seed"], row["kind"], row["hidden"], row["says"])
        return
    known = {json.loads(line)["seed"] for line in options.out.read_text().splitlines()} if options.out.exists() else {}
    for seed in range(options.first, options.first + options.trials):
        if seed not in known:
            row = tried(seed)
            with options.out.open("a") as file:
                file.write(json.dumps(row) + "\n")
            print(seed, row["kind"], row["verdict"], row["named"], row["says"][:90], flush=True)


if __name__ == "__main__":
    main()
