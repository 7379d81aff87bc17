"""Whether a drive tells that files state its gauge length, channel spacing or clock wrongly, and the fit mends it.

    python -m benchmarks.drive_misstated --first 1000 --drives 20 --out misstated.jsonl
    python -m benchmarks.drive_misstated --table misstated.jsonl

Drives are those of `benchmarks/drive.py`. Each seed hides nothing, a gauge that is off by 8 to 30 %, a clock that
drifts by 0.1 to 0.5 %, or a spacing that is off by 1 to 4 % where the length factor is known to 0.5 %. What is named is
fitted, and the route, and how much of it lies in its 95 % band, are compared with the truth before and after. One file
may be filled by several runs; seeds in it are left out.
"""

import argparse
import json
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import roadfiber as rf
from benchmarks.drive import drawn, judged, nearest_fix
from solver.drive.drive import Drive
from solver.drive.drive_run import DriveRun
from solver.drive.misstated import NAMED

#: What is hidden, and how large, by the seed modulo four.
HIDDEN = ("", "gauge_length", "clock_drift", "channel_stretch")
AMOUNTS = {"gauge_length": (0.08, 0.3), "clock_drift": (0.001, 0.005), "channel_stretch": (0.01, 0.04)}
#: Length factor, its standard deviation, where a spacing is hidden; cable per meter of path is off by less.
KNOWN, LAID = (1.0, 0.005), 0.003


def settings_of(seed: int) -> dict[str, Any]:
    """Settings of a drive with something hidden."""
    rng = np.random.default_rng([seed, 31])
    name = HIDDEN[seed % 4]
    found: dict[str, Any] = drawn(seed, sampling_rate=12.5)
    if name:
        found["effects"] = {name: float(rng.choice([-1, 1]) * rng.uniform(*AMOUNTS[name]))}
    return found | ({"length_error": LAID} if name == "channel_stretch" else {})


def tried(seed: int) -> dict[str, Any]:
    """Simulate and locate one drive, and locate it again with what is named."""
    settings = settings_of(seed)
    hidden = settings.get("effects", {})
    row: dict[str, Any] = {"seed": seed, "hidden": next(iter(hidden), ""), "amount": next(iter(hidden.values()), 0.0)}
    with tempfile.TemporaryDirectory() as scratch:
        made = rf.simulate(Path(scratch) / "drive", "drive", **settings)
        drive, truth = rf.read(made.site), json.loads(made.truth.read_text())
        assert isinstance(drive, Drive)
        if row["hidden"] == "channel_stretch":
            drive = replace(drive, length_factor=KNOWN)
        nearest = nearest_fix(drive)

        def held(run: DriveRun, when: str) -> dict[str, float]:
            one = judged(run, truth, settings["gauge_length"], nearest)
            return {when: one.rms, f"inside {when}": one.inside}

        try:
            run = rf.locate(drive)
        except rf.InputError as error:
            return row | {"refused": str(error)}
        table = run.misstated
        named = table.loc[table["probability"] >= NAMED, "effect"].tolist()
        row |= {"named": named, "misstated": run.facts["misstated"]} | held(run, "before")
        return row | (held(rf.locate(drive, effects=named), "after") if named else {})


def judged_row(row: Mapping[str, Any]) -> dict[str, float]:
    """Named where large enough to show, anything named that is not hidden, and sigmas that the estimate is off."""
    found = {one["effect"]: one for one in row["misstated"]}
    wrong = float(bool(set(row["named"]) - {row["hidden"]}))
    if not row["hidden"]:
        return {"wrong": wrong}
    one = found[row["hidden"]]
    shows = abs(row["amount"]) >= one["shows"]
    return {
        "wrong": wrong,
        "named": float(row["hidden"] in row["named"]) if shows else np.nan,
        "named where small": np.nan if shows else float(row["hidden"] in row["named"]),
        "sigmas": (one["value"] - row["amount"]) / one["sigma"],
    }


def report(rows: Sequence[Mapping[str, Any]]) -> None:
    """Print what the drives show together."""
    there = [row for row in rows if "refused" not in row]
    print(f"{len(rows)} drives, {len(rows) - len(there)} refused")
    kept = ("hidden", "before", "after", "inside before", "inside after")
    table = pd.DataFrame([{name: row.get(name, np.nan) for name in kept} | judged_row(row) for row in there])
    shares = table.groupby("hidden")[["wrong", "named", "named where small"]]
    spread = table.groupby("hidden")["sigmas"].agg(lambda one: float(np.sqrt((one**2).mean())))
    route = table.groupby("hidden")[["before", "after"]].median()
    bands = table.groupby("hidden")[["inside before", "inside after"]].mean()
    drives = table.groupby("hidden").size().rename("drives")
    print(shares.mean().join([spread, route, bands, drives]).round(2).to_string())


def main() -> None:
    """Run drives, or read them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=1000)
    parser.add_argument("--drives", type=int, default=20)
    parser.add_argument("--out", type=Path, default=Path("misstated.jsonl"))
    parser.add_argument("--table", type=Path, help="print what such a file holds, and no more")
    options = parser.parse_args()
    path = options.table or options.out
    rows = [json.loads(line) for line in path.read_text().splitlines()] if path.is_file() else []
    done = {row["seed"] for row in rows}
    for seed in range(options.first, options.first + options.drives) if options.table is None else ():
        if seed not in done:
            rows.append(row := tried(seed))
            with options.out.open("a") as file:
                file.write(json.dumps(row) + "\n")
            print({name: row.get(name) for name in ("seed", "hidden", "amount", "named", "before", "after", "refused")})
    report(rows)


if __name__ == "__main__":
    main()
