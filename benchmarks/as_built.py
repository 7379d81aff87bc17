"""Whether fibers are located as they are laid: in straight ducts that cross the road, jog, step, dip, turn off or rise.

    python -m benchmarks.as_built --first 1 --streets 60 --diagnose --workers 2 --out as_built.jsonl
    python -m benchmarks.as_built --table as_built.jsonl                  # the summary against what is wanted, no more
    python -m benchmarks.as_built --first 1 --streets 6 --pictures pictures

Each seed draws a street, one of six with a fiber that winds, half with nothing hidden and half with one effect, nine
passes at 15 dB and two anchors known to 5 cm. `--vary` draws passes, SNR and noise as `benchmarks/reliability.py` does,
and besides gauge, spacing, rate, lanes, directions and classes. Where a diagnosis names one effect it is put into the
model and the route is judged again. Several runs may fill one file; they leave out the
seeds that it has.
"""

import argparse
import json
import tempfile
import time
import zlib
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

import roadfiber as rf
from benchmarks.blind import FAIR
from benchmarks.corridor import off_and_half
from benchmarks.judged_probabilities import judged
from benchmarks.reliability import added, drawn_survey, known_to, laid
from benchmarks.route_limit import limit
from solver.simulator import Scenario, Survey, simulate, survey_files, write_survey

Array = NDArray[np.float64]
#: Share of streets with nothing hidden.
NOTHING = 1 / 2
#: Degrees from which on a corner counts; m within which of the true one it is found, and placed; and m within which of
#: one places are judged besides.
TURN, FOUND, PLACED, NEAR = 30.0, 3.0, 1.0, 6.0
#: m that a place may be off without a word.
SILENT = 0.5
#: Least height of a picture's map, m.
LEAST_SHOWN = 3.0


def draw(seed: int, vary: bool = False) -> Scenario:
    """A street as it is built, or one of a few that winds, with nothing or one effect hidden."""
    rng = np.random.default_rng([seed, zlib.crc32(b"as built")])
    names = [] if rng.uniform() < NOTHING else [str(rng.choice(FAIR))]
    scenario = laid(drawn_survey(seed, "one" if names else "null", names, rng), rng)
    scenario = replace(scenario, view=(0.0, float(rng.uniform(50, 90))))
    return varied(scenario, rng) if vary else replace(scenario, passes=9, snr_db=15.0, noise="white")


def varied(scenario: Scenario, rng: np.random.Generator) -> Scenario:
    """The same recorded otherwise, on another road with other traffic."""
    spacing, lane = float(np.exp(rng.uniform(*np.log([0.5, 5.0])))), float(rng.uniform(2.75, 3.75))
    heavy = float(rng.uniform(0.05, 0.5))
    return replace(
        scenario,
        gauge_length=max(float(rng.uniform(2, 20)), spacing),
        channel_spacing=spacing,
        channels=int(245 / spacing),
        sampling_rate=float(rng.uniform(5, 20)),
        lanes=(0.0, -lane),
        ahead=float(rng.uniform(0, 1)),
        classes={"car": 0.7 * (1 - heavy), "van": 0.3 * (1 - heavy), "truck": heavy / 2, "bus": heavy / 2},
    )


@contextmanager
def located(scenario: Scenario) -> Iterator[tuple[Survey, rf.Run, float]]:
    """Simulate a street, and locate its fiber as a user would; with the CPU, s, that this took."""
    survey = simulate(scenario)
    with tempfile.TemporaryDirectory() as folder:
        read = rf.read(write_survey(survey, Path(folder) / "survey"))
        begun = time.process_time()
        yield survey, rf.locate(read), time.process_time() - begun


def in_view(survey: Survey, channel: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which channels [channel] are in view and under the ground."""
    first, last = survey.active
    inside = (channel >= first) & (channel <= last)
    inside[inside] &= survey.route[channel[inside], 2] > 0
    return inside


def corners_of(survey: Survey, least: float) -> Array:
    """Places [corner, 2], m, in view where the fiber turns by more than `least` degrees."""
    first, last = survey.distance[list(survey.active)]
    seen = [
        one
        for one in survey_files.laid(survey)["corners"]
        if first <= one["distance"] <= last and abs(one["turn"]) > least
    ]
    return np.array([[one["x"], one["y"]] for one in seen]).reshape(-1, 2)


def told_corners(run: rf.Run, survey: Survey, least: float = 0.0) -> Array:
    """Places [corner, 2], m, where a run says that the fiber turns in view, by more than `least` degrees."""
    told = [one for one in run.corners if one.kind == "corner" and abs(one.amount) > least]
    inside = in_view(survey, np.array([one.channel for one in told], dtype=np.int64))
    return np.array([[one.x, one.y] for one in told]).reshape(-1, 2)[inside]


def nearest(to: Array, places: Array) -> Array:
    """Distance [n] of the nearest of some places [place, 2] to each of others [n, 2], m."""
    if not len(places):
        return np.full(len(to), np.inf)
    return np.asarray(np.linalg.norm(to[:, None] - places, axis=2).min(1))


def paired(true: Array, told: Array) -> Array:
    """Distances [pair], m, of true corners [corner, 2] and those told, each of one alone: the least sum."""
    apart = np.linalg.norm(true[:, None] - told, axis=2)
    return np.asarray(apart[linear_sum_assignment(apart)])


def scored(survey: Survey, run: rf.Run) -> dict[str, Any]:
    """How far a route is off in view, what its corridor holds, what was said, and the corners."""
    place = run.place
    seen, known = in_view(survey, place.channel), run.result.constrained
    true = survey.route[np.minimum(place.channel, len(survey.route) - 1)]
    off, half = off_and_half(place, true)
    inside, far = off <= half, np.linalg.norm(place.route - true, axis=1)
    true_corners, told = corners_of(survey, TURN), told_corners(run, survey)
    near = seen & (nearest(true[:, :2], corners_of(survey, TURN)) <= NEAR)
    failed = [one["name"] for one in run.facts["trust"]["gates"] if one["verdict"] == "failed"]
    apart = paired(true_corners, told)
    facts = {
        "shape": survey.scenario.laid,
        "located": float(known[seen].sum() / in_view(survey, np.arange(len(survey.route))).sum()),
        "largest": float(far[seen].max()) if seen.any() else np.nan,
        "largest known": float(far[seen & known].max()) if (seen & known).any() else np.nan,
        "inside": float(inside[:, seen].mean()) if seen.any() else np.nan,
        "near": float(inside[:, near].mean()) if near.any() else np.nan,
        "failed": failed,
        "silent": bool(not failed and (seen & known & (far > SILENT) & ~inside.all(0)).any()),
        "corners": len(true_corners),
        "found": int((apart <= FOUND).sum()),
        "placed": int((apart <= PLACED).sum()),
        "made up": int((nearest(told_corners(run, survey, TURN), corners_of(survey, TURN / 2)) > FOUND).sum()),
    }
    if survey.scenario.effects:
        return facts
    channel, *least_of = limit(survey)
    both = np.isin(place.channel, channel) & seen
    of = np.searchsorted(channel, place.channel[both])
    least = np.sqrt(np.mean(least_of[0][of] ** 2 + least_of[1][of] ** 2))
    way = survey.fiber.tangent(np.clip(survey.distance[place.channel[both]], 0, survey.fiber.length))
    error = (place.route - true)[both]
    across = (error[:, :2] * np.stack([-way[:, 1], way[:, 0]], 1)).sum(1) / np.linalg.norm(way[:, :2], axis=1)
    rms = np.sqrt(np.mean(across**2 + error[:, 2] ** 2))
    return facts | {"rms": float(rms), "limit": float(least), "over limit": float(rms / least)}


def tried(seed: int, vary: bool, diagnose: bool, pictures: Path | None) -> dict[str, Any]:
    """One street, located and scored; diagnosed where that is asked for."""
    scenario = draw(seed, vary)
    facts: dict[str, Any] = {"seed": seed, "kind": "one" if scenario.effects else "null"}
    facts["hidden"] = dict(scenario.effects)
    try:
        with located(scenario) as (survey, run, cpu):
            facts |= scored(survey, run) | {"cpu locate": cpu}
            if pictures is not None:
                draw_street(survey, run, facts, pictures / f"street-{seed:04}.png")
            if diagnose:
                begun = time.process_time()
                finding = rf.diagnose(run).finding
                facts["cpu diagnose"] = time.process_time() - begun
                facts["misfit"] = added(scenario, run)
                stage = finding.candidates[0].stage if finding.candidates else ""
                named = known_to(finding)
                facts |= {"verdict": finding.verdict, "named": named, "then": [], "stage": stage}
                if len(named) == 1:
                    facts["after"] = scored(survey, rf.add(run, *named, force=True))
    except rf.InputError as error:
        # A street that is refused claims nothing.
        facts["refused"] = str(error)
    return facts


def draw_street(survey: Survey, run: rf.Run, facts: Mapping[str, Any], path: Path) -> None:
    """A picture of the truth, the route, its corridor and the corners, on the map and in depth, as `scored` has it."""
    from matplotlib.figure import Figure

    from solver.run.geojson import Z95, half_width, normals

    place, active = run.place, slice(survey.active[0], survey.active[1] + 1)
    seen = in_view(survey, place.channel)
    route, covariance, true = place.route[seen], place.covariance[seen], survey.route[active]
    figure = Figure(figsize=(7.6, 4.4), layout="constrained")
    plan, deep = figure.subplots(2, 1, height_ratios=[2, 1])
    aside = normals(route) * half_width(route, covariance)[:, None]
    edge = np.concatenate([route[:, :2] + aside, (route[:, :2] - aside)[::-1]])
    plan.fill(*edge.T, color="C0", alpha=0.25, lw=0, label="95 % corridor")
    plan.plot(*true[:, :2].T, "k-", lw=1, label="truth")
    plan.plot(*route[:, :2].T, "C0-", lw=1.2, label="route")
    plan.plot(*corners_of(survey, TURN).T, "kx", label="corners")
    plan.plot(*told_corners(run, survey).T, "o", mec="C3", mfc="none", label="corners found")
    plan.plot(survey.anchors["x"], survey.anchors["y"], "k^", ms=4, label="anchors")
    said = ", ".join(facts["failed"]) + " failed" if facts["failed"] else "no check failed"
    title = f"{survey.scenario.laid}, seed {survey.scenario.seed}: at most {facts['largest']:.2f} m off; {said}"
    plan.set(xlabel="x, m", ylabel="y, m")
    plan.set_title(title, fontsize="medium")
    figure.legend(loc="outside lower center", ncols=6, fontsize="small", frameon=False)
    along, sd = survey.distance[place.channel[seen]], Z95 * np.sqrt(covariance[:, 2, 2])
    deep.fill_between(along, route[:, 2] - sd, route[:, 2] + sd, color="C0", alpha=0.25, lw=0)
    deep.plot(survey.distance[active], true[:, 2], "k-", lw=1)
    deep.plot(along, route[:, 2], "C0-", lw=1.2)
    for axes, least in ((plan, LEAST_SHOWN), (deep, LEAST_SHOWN / 2)):
        low, high = axes.get_ylim()
        middle, half = (low + high) / 2, max(high - low, least) / 2
        axes.set_ylim(middle + half, middle - half)
    deep.set(xlabel="along the fiber, m", ylabel="depth, m")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=90)


def line(row: Mapping[str, Any]) -> str:
    """What a street came to, on one line."""
    if "refused" in row:
        return f"{row['seed']:>5} {row['kind']:<5} refused: {row['refused']}"
    said = ", ".join(row["failed"]) or "no check failed"
    hidden = " ".join(row["hidden"]) or "nothing"
    ratio = f"{row['over limit']:.2f} of the limit, " if "over limit" in row else ""
    verdict = f"; {row['verdict']} {' '.join(row['named'])}: {verdict_of(row)}" if "verdict" in row else ""
    if "after" in row:
        verdict += f", and in the model largest {row['after']['largest']:.2f} m, corners {row['after']['found']} found"
    return (
        f"{row['seed']:>5} {row['shape']:<12} hidden {hidden:<18} largest {row['largest']:.2f} m, {ratio}inside "
        f"{row['inside']:.2f}, near corners {row['near']:.2f}; {said}; corners {row['corners']}: {row['found']} found, "
        f"{row['placed']} placed, {row['made up']} made up{verdict}; {row['cpu locate']:.0f} s"
    )


def verdict_of(row: Mapping[str, Any]) -> str:
    """Whether a diagnosis is right, wrong or open, see `benchmarks.judged_probabilities.judged`."""
    shares = judged(row)
    if shares["claimed"] == 1 or shares["wrong"] == 1:
        return "wrong"
    silent = not row["hidden"] and row["verdict"] == "adequate"
    return "right" if silent or 1 in (shares["named"], shares["open"]) else "open"


def report(rows: Sequence[Mapping[str, Any]]) -> None:
    """Print what all streets came to, beside what is wanted."""
    frame = pd.DataFrame([row for row in rows if "refused" not in row])
    print(f"{len(rows)} streets, {len(rows) - len(frame)} refused")
    if frame.empty:
        return
    bare = frame[frame["kind"] == "null"]
    winding = bare["shape"] == "winding"
    built = bare[~winding]
    corners = frame["corners"].sum()
    lines = [
        ("nothing hidden: largest error at most 0.2 m", (built["largest"] <= 0.2).mean(), ">= 0.80"),
        ("nothing hidden: largest error at most 0.4 m", (built["largest"] <= 0.4).mean(), ">= 0.95"),
        ("nothing hidden: rms error over the limit, median", built.get("over limit", pd.Series()).median(), "<= 1.5"),
        ("winding: largest error, m, worst", bare.loc[winding, "largest"].max(), "<= 0.11"),
        ("places in the 95 % corridor", frame["inside"].mean(), "0.92 to 0.98"),
        (f"of those within {NEAR:g} m of a corner", frame["near"].mean(), ">= 0.90"),
        (f"no check failed, more than {SILENT:g} m off outside the corridor", frame["silent"].sum(), "0"),
        ("corners found", frame["found"].sum() / corners if corners else np.nan, ">= 0.90"),
        (f"corners placed within {PLACED:g} m", frame["placed"].sum() / corners if corners else np.nan, ">= 0.90"),
        ("corners made up where the fiber winds", frame.loc[frame["shape"] == "winding", "made up"].sum(), "0"),
        ("corners made up elsewhere", frame.loc[frame["shape"] != "winding", "made up"].sum(), "-"),
        ("CPU of locate, s, mean", frame["cpu locate"].mean(), "-"),
    ]
    if "verdict" in frame:
        shares = pd.DataFrame([judged(row) for row in rows if "verdict" in row]).mean()
        lines += [
            ("claimed where nothing is hidden", shares["claimed"], "<= 1/30"),
            ("named, where twice what shows", shares["named"], ">= 0.95"),
            ("named wrongly", shares["wrong"], "<= 0.02"),
            ("CPU of diagnose, s, mean", frame["cpu diagnose"].mean(), "-"),
        ]
    if "after" in frame:
        grown = frame[frame["after"].notna()]
        after = pd.DataFrame(grown["after"].tolist())
        corners = grown["corners"].sum()
        lines += [
            ("one effect named: largest error, m, median, as located", grown["largest"].median(), "-"),
            ("one effect named: largest error, m, median, with it", after["largest"].median(), "-"),
            ("one effect named: corners found, as located", grown["found"].sum() / max(corners, 1), "-"),
            ("one effect named: corners found, with it", after["found"].sum() / max(corners, 1), "-"),
        ]
    for what, found, wanted in lines:
        print(f"{what:<62} {found:>8.3g}   wanted {wanted}")
    table = frame.groupby("shape")[["largest", "inside", "near"]].median()
    print(table.assign(streets=frame.groupby("shape").size()).round(2).to_string())


def main() -> None:
    """Run streets, or read them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--streets", type=int, default=20)
    parser.add_argument("--vary", action="store_true", help="draw gauge, spacing, rate, traffic, noise and SNR, too")
    parser.add_argument("--diagnose", action="store_true", help="diagnose each, too")
    parser.add_argument("--workers", type=int, default=1, help="streets at once, each in a process")
    parser.add_argument("--pictures", type=Path, metavar="DIR", help="draw each street there")
    parser.add_argument("--out", type=Path, default=Path("as_built.jsonl"))
    parser.add_argument("--table", type=Path, help="print what such a file holds, and no more")
    options = parser.parse_args()
    path = options.table or options.out
    known = [json.loads(text) for text in path.read_text().splitlines()] if path.is_file() else []
    if not options.table:
        done = {row["seed"] for row in known}
        seeds = [seed for seed in range(options.first, options.first + options.streets) if seed not in done]
        one = partial(tried, vary=options.vary, diagnose=options.diagnose, pictures=options.pictures)
        with ProcessPoolExecutor(options.workers, mp_context=get_context("spawn")) as pool:
            for row in pool.map(one, seeds) if options.workers > 1 else map(one, seeds):
                with options.out.open("a") as file:
                    file.write(json.dumps(row) + "\n")
                print(line(row), flush=True)
                known.append(row)
    report(known)


if __name__ == "__main__":
    main()
