"""Whether the 95 % corridor of `locate` holds the fiber, also where the model lacks something; and after `add`.

    python -m benchmarks.corridor --first 7000 --trials 20 --out corridor.jsonl          # locate, a line each
    python -m benchmarks.corridor --first 7000 --trials 20 --out corridor.jsonl --add    # put in what was hidden, too
    python -m benchmarks.corridor --table corridor.jsonl

Each seed draws a survey as `benchmarks/reliability.py` does, its street as it is built or one of six that winds (in the
figures of the documentation all wind: their seeds were other streets), with nothing hidden or one effect. One file may
be filled by several runs; seeds that are in it already are left out. `--add` hides an effect by another law: its signal
is that of the simulator times one plus `LAW_OFF` of a smooth random field, along the fiber and in time.
"""

import argparse
import json
import tempfile
import time
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

import roadfiber as rf
from benchmarks.blind import FAIR
from benchmarks.reliability import drawn_survey, laid
from roadfiber.widening import with_corridor
from solver.run.geojson import Z95, half_width, normals
from solver.simulator import Scenario, Survey, simulate, write_survey

#: Share of surveys with nothing hidden.
NOTHING = 1 / 3
#: Rms share of its own signal by which an effect's law is off, and over how many samples and channels that is alike.
LAW_OFF, ALIKE = 0.05, (10.0, 8.0)


def draw(seed: int) -> Scenario:
    """A survey with nothing or one effect hidden, of plausible size or of less than half of that."""
    rng = np.random.default_rng([seed, zlib.crc32(b"corridor")])
    names = [] if rng.uniform() < NOTHING else [str(rng.choice(FAIR))]
    return laid(drawn_survey(seed, "one" if names else "null", names, rng), rng)


def off_its_law(survey: Survey) -> Survey:
    """The survey with what its hidden effect changes in the signal off by a smooth random share."""
    without = simulate(replace(survey.scenario, effects={})).signal
    field = gaussian_filter(np.random.default_rng(survey.scenario.seed).normal(size=survey.signal.shape), ALIKE)
    # A clock that runs differently may end a record a sample earlier or later.
    late = len(survey.signal) - len(without)
    without = np.pad(without, ((0, max(late, 0)), (0, 0)), mode="edge")[: len(survey.signal)]
    # Of how heavy vehicles are nothing is known, so that a signal larger as a whole is none of its law.
    without = without * (without * survey.signal).sum() / (without**2).sum()
    more = LAW_OFF * field / field.std() * (survey.signal - without)
    return replace(survey, strain_rate=survey.strain_rate + more)


def off_and_half(place: Any, true: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """How far a route is from the true one [channel, 3], and half its corridor: across and in depth, [2, channel].

    All in m.
    """
    off = place.route - true
    across = np.abs((off[:, :2] * normals(place.route)).sum(1))
    deep = Z95 * np.sqrt(place.covariance[:, 2, 2])
    return np.stack([across, np.abs(off[:, 2])]), np.stack([half_width(place.route, place.covariance), deep])


def held(survey: Survey, run: rf.Run, when: str) -> dict[str, float]:
    """Share of points that lie in either corridor across and in depth, and its median half-width across, m.

    Nothing where no place is decided by data, as where the fit has not converged.
    """
    place, known = run.place, run.result.constrained
    if not known.any():
        return {}
    true, facts = survey.route[place.channel], dict[str, float]()
    for name, one in (("fit", replace(place, covariance=run.result.covariance)), ("full", place)):
        (across, down), (half, deep) = (both[:, known] for both in off_and_half(one, true))
        flat = np.linalg.norm((place.route - true)[known, :2], axis=1)
        shares: dict[str, NDArray[np.bool_]] = {"across": across <= half, "deep": down <= deep, "flat": flat <= half}
        facts |= {f"{way} {name} {when}": float(inside.mean()) for way, inside in shares.items()}
        facts[f"half {name} {when}"] = float(np.median(half))
    return facts | {f"error {when}": float(across.max())}


def tried(seed: int, add: bool) -> dict[str, Any]:
    """Locate one survey; with what was hidden in the model, too, where that is asked for."""
    scenario = draw(seed)
    survey = simulate(scenario)
    if add and scenario.effects:
        survey = off_its_law(survey)
    with tempfile.TemporaryDirectory() as folder:
        read = rf.read(write_survey(survey, Path(folder) / "survey"))
        begun = time.process_time()
        run = rf.locate(read, corridor="fit")
        fitted = time.process_time()
        run = with_corridor(run, "full")
        seconds = {"cpu locate": fitted - begun, "cpu corridor": time.process_time() - fitted}
    facts = {"seed": seed, "hidden": dict(scenario.effects), "snr_db": scenario.snr_db, "passes": scenario.passes}
    told = {name: run.facts["corridor"][name] for name in ("full", "why", "widest")}
    best = next(iter(run.facts["corridor"]["explanations"]), None)
    facts |= told | {"best": best and [best["title"], best["probability"]]} | held(survey, run, "located") | seconds
    name = next(iter(scenario.effects), "")
    if add and name in run.known:
        try:
            facts |= held(survey, rf.add(run, name, force=True), "added")
        except rf.InputError as error:
            facts["refused"] = str(error)
    return facts


def report(rows: Sequence[Mapping[str, Any]]) -> None:
    """Print shares of points inside, and widths, of surveys with nothing and with one effect hidden."""
    frame = pd.DataFrame(rows)
    kind = frame["hidden"].map(lambda hidden: "one" if hidden else "none")
    for when in ("located", "added"):
        if f"half full {when}" not in frame:
            continue
        shares = frame[[f"{way} {name} {when}" for way in ("across", "deep", "flat") for name in ("fit", "full")]]
        table = shares.groupby(kind).mean()
        ratio = frame[f"half full {when}"] / frame[f"half fit {when}"]
        table["full over fit"] = ratio.groupby(kind).median()
        table["surveys"] = ratio.groupby(kind).count()
        print(f"{when}:\n{table.round(3).T.to_string()}")
    print(frame[["cpu locate", "cpu corridor"]].groupby(kind).mean().round(1).to_string())


def main() -> None:
    """Run trials, or read them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--trials", type=int, default=20)
    parser.add_argument("--add", action="store_true", help="add what was hidden, whose law is a little off")
    parser.add_argument("--out", type=Path, default=Path("corridor.jsonl"))
    parser.add_argument("--table", type=Path, help="print what such a file holds, and no more")
    options = parser.parse_args()
    path = options.table or options.out
    known = [json.loads(line) for line in path.read_text().splitlines()] if path.is_file() else []
    if options.table:
        report(known)
        return
    done = {row["seed"] for row in known}
    for seed in range(options.first, options.first + options.trials):
        if seed in done:
            continue
        row = tried(seed, options.add)
        with options.out.open("a") as file:
            file.write(json.dumps(row) + "\n")
        print({key: round(value, 2) if isinstance(value, float) else value for key, value in row.items()}, flush=True)


if __name__ == "__main__":
    main()
