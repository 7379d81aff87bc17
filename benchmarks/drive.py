"""Drives of one GPS car along fiber that an operator's map shows roughly: simulated, located, compared with the truth.

    python benchmarks/drive.py --first 1000 --drives 20 --rate 12.5
    python benchmarks/drive.py --drives 1 --length 25000 --spacing 10 --rate 50    # cost at real size

Each drive has its own map error (5 to 10 m, length off by 1 %), loops of slack at manholes, stops, a U-turn, GPS noise
of 1 to 3 m with outliers, traffic, SNR of -5 to 15 dB at 50 Hz, channels of 4 to 16 m, clock offset up to a minute and
polarity. At another sampling rate noise of the same density is drawn, so that 12.5 Hz, which is simulated four times
faster, tells the same. Each line ends with the checks that failed. Beside it stands what can be had without a model:
every channel where the GPS had the car when the channel was loudest, with the one clock shift that fits best. CPU time
and peak memory are of reading and locating; the drive is simulated in a process of its own.
"""

import argparse
import json
import multiprocessing
import resource
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import roadfiber as rf
from solver.drive.drive import Drive
from solver.drive.drive_run import DriveRun

Array = NDArray[np.float64]

#: Hz, at which SNR is drawn.
RATE = 50.0


def drawn(seed: int, **fixed: Any) -> dict[str, Any]:
    """Settings of a drive, drawn by its seed."""
    rng = np.random.default_rng([seed, 29])
    spacing = float(rng.choice([4.0, 5.0, 8.0, 10.0, 16.0]))
    rate = float(fixed.get("sampling_rate") or RATE)
    settings = {
        "seed": seed,
        "length": float(rng.uniform(2000, 3500)),
        "snr_db": float(rng.uniform(-5, 15) + 10 * np.log10(RATE / rate)),
        "channel_spacing": spacing,
        "gauge_length": float(rng.choice([8.0, 10.0, 16.0])),
        "loops_per_km": float(rng.uniform(1, 3)),
        "stops_per_km": float(rng.uniform(1, 2)),
        "traffic": float(rng.uniform(30, 120)),
        "detours": int(rng.integers(0, 2)),
        "u_turns": int(rng.integers(0, 2)) if seed % 4 == 0 else 1,
    }
    return settings | {name: value for name, value in fixed.items() if value is not None}


@dataclass(frozen=True)
class Outcome:
    """One drive against its truth: m, s, shares, counts.

    `rms` and `worst` are of channels that hear the car; `inside` is the share of all located channels, of loops too,
    within their 95 % band. NaN where no channel is located.
    """

    rms: float
    inside: float
    worst: float
    located: float
    clock: float
    loops: int
    found: int
    false: int
    nearest: float
    lateral_inside: float


def along_error(place: Array, truth: Array) -> Array:
    """Error [channel] of places [channel, 2] along the true path [channel, 2]."""
    tangent = np.gradient(truth, axis=0)
    size = np.linalg.norm(tangent, axis=1)
    good = np.flatnonzero(size > 1e-6)
    after = np.clip(np.searchsorted(good, np.arange(len(truth))), 1, len(good) - 1)
    nearer = np.arange(len(truth)) - good[after - 1] <= good[after] - np.arange(len(truth))
    tangent = tangent[np.where(nearer, good[after - 1], good[after])]
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    return np.asarray(((place - truth) * tangent).sum(1))


def judged(run: DriveRun, truth: dict[str, Any], gauge: float, nearest: Array) -> Outcome:
    """Compare a run with what was hidden."""
    route = run.route
    real = np.array(truth["route_xyz"])[:, :2]
    place = route[["x", "y"]].to_numpy()
    error = along_error(place, real)
    inside = route["constrained"].to_numpy()
    hears = inside & route["heard"].to_numpy()
    off = np.abs(error[inside]) / route["sigma_along"].to_numpy()[inside]
    heard = hears & np.isfinite(nearest[:, 0])
    plain = along_error(nearest, real)[heard]
    first, last = run.facts["active_channels"] or (0, -1)
    there = [one for one in truth["loops"] if one["length"] > gauge and first < one["first_channel"] < last]
    there = [one for one in there if driven(one, inside)]
    reported = [(one["first_channel"], one["last_channel"], one["length"]) for one in run.facts["loops"]]
    found = sum(
        any(a - 2 < one["last_channel"] and b + 2 > one["first_channel"] for a, b, _ in reported) for one in there
    )
    every = truth["loops"]
    false = sum(
        not any(a - 2 < one["last_channel"] and b + 2 > one["first_channel"] for one in every) for a, b, _ in reported
    )
    across = np.linalg.norm(place - real, axis=1)[inside] ** 2 - error[inside] ** 2
    total = route[["sigma_x", "sigma_y"]].to_numpy()[inside] ** 2
    wide = np.sqrt(np.maximum(total.sum(1) - route["sigma_along"].to_numpy()[inside] ** 2, 1e-6))
    return Outcome(
        rms=float(np.sqrt(mean(error[hears] ** 2))),
        inside=mean(off < 1.96),
        worst=float(np.abs(error[hears]).max()) if hears.any() else float("nan"),
        located=float(inside.mean()),
        clock=run.clock_offset - truth["clock_offset"],
        loops=len(there),
        found=found,
        false=false,
        nearest=float(np.sqrt((plain**2).mean())) if len(plain) else np.nan,
        lateral_inside=mean(np.sqrt(np.maximum(across, 0)) < 1.96 * wide),
    )


def mean(values: NDArray[Any]) -> float:
    """Mean of values; NaN where there are none."""
    return float(np.mean(values)) if len(values) else float("nan")


def driven(loop: dict[str, Any], inside: NDArray[np.bool_]) -> bool:
    """Whether channels just before and after a loop are located."""
    before, after = int(loop["first_channel"]) - 3, int(loop["last_channel"]) + 4
    return bool(inside[max(0, before - 3) : before + 1].any() and inside[after : after + 4].any())


def nearest_fix(drive: Drive) -> Array:
    """Places [channel, 2] without a model: where the GPS had the car when a channel was loudest, after one shift.

    The shift is the one with which the loudest moments lie best on the map at equal steps of the channel spacing.
    """
    quiet = drive.quiet()
    fixes = drive.tracks
    start = np.datetime64(quiet.start, "ns")
    time = (fixes["time"].dt.tz_convert(None).to_numpy("datetime64[ns]") - start) / np.timedelta64(1, "s")
    xy = fixes[["x", "y"]].to_numpy()
    step = max(1, round(quiet.rate))
    count = quiet.values.shape[1] // step
    energy = (quiet.values[:, : count * step] ** 2).reshape(len(quiet.values), count, step).mean(2)
    loudest = (energy.argmax(1) + 0.5) * step / quiet.rate
    best, kept = np.inf, np.full((len(quiet.values), 2), np.nan)
    from solver.drive.path import path_of

    path = path_of(drive.vertices)
    for shift in np.arange(-120.0, 120.5, 0.5):
        index = np.clip(np.searchsorted(time, loudest - shift), 0, len(time) - 1)
        place = xy[index]
        cell, _ = path.nearest(place)
        line = quiet.distance - np.median(quiet.distance - (cell - path.first))
        score = float(np.median(np.abs(cell - path.first - line)))
        if score < best:
            best, kept = score, place
    return kept


def one_drive(settings: dict[str, Any], keep: Path | None) -> Outcome:
    """Simulate and locate one drive."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "drive"
        with multiprocessing.get_context("spawn").Pool(1) as pool:
            made = pool.apply(rf.simulate, (folder, "drive"), settings)
        begun, wall = time.process_time(), time.perf_counter()
        survey = rf.read(made.site)
        assert isinstance(survey, Drive)
        run = rf.locate(survey)
        taken, passed = time.process_time() - begun, time.perf_counter() - wall
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
        truth = json.loads(made.truth.read_text())
        outcome = judged(run, truth, settings["gauge_length"], nearest_fix(survey))
        if keep is not None:
            run.save(keep / f"{settings['seed']}")
        size = f"{len(run.route)} channels, {settings['length'] / 1e3:.1f} km, {made.seconds:.0f} s"
        failed = [one["name"] for one in run.facts["trust"]["gates"] if one["verdict"] == "failed"]
        print(
            f"{settings['seed']:5d} {settings['snr_db']:5.1f} dB {settings['channel_spacing']:3.0f} m / "
            f"{settings['gauge_length']:3.0f} m | {outcome.rms:5.2f} m rms, worst {outcome.worst:5.1f}, "
            f"{100 * outcome.inside:3.0f} % inside, {100 * outcome.located:3.0f} % located | nearest fix "
            f"{outcome.nearest:6.1f} m | clock {outcome.clock:+.3f} s | loops {outcome.found}/{outcome.loops}, "
            f"{outcome.false} false | across {100 * outcome.lateral_inside:3.0f} % | {size} | "
            f"{taken:.0f} CPU s, {passed:.0f} s, {peak:.2f} GB | {', '.join(failed) or 'no check failed'}",
            flush=True,
        )
        return outcome


def main() -> None:
    """Run the drives and say what they show together."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=1000, help="first seed")
    parser.add_argument("--drives", type=int, default=20)
    parser.add_argument("--length", type=float, help="m of road")
    parser.add_argument("--spacing", type=float, help="m between channels")
    parser.add_argument("--rate", type=float, help="samples per second")
    parser.add_argument("--traffic", type=float, help="other vehicles per hour and direction")
    parser.add_argument("--snr", type=float, help="dB")
    parser.add_argument("--keep", type=Path, help="folder for the runs")
    asked = parser.parse_args()
    fixed = {"length": asked.length, "channel_spacing": asked.spacing, "sampling_rate": asked.rate}
    fixed |= {"traffic": asked.traffic, "snr_db": asked.snr}
    outcomes, refused = [], 0
    for seed in range(asked.first, asked.first + asked.drives):
        try:
            outcomes.append(one_drive(drawn(seed, **fixed), asked.keep))
        except rf.InputError as error:
            refused += 1
            print(f"{seed:5d} refused: {error}", flush=True)
    if not outcomes:
        return
    rms = np.array([one.rms for one in outcomes])
    clock = np.abs([one.clock for one in outcomes])
    some = rms[np.isfinite(rms)]
    loops, found, false = (sum(getattr(one, name) for one in outcomes) for name in ("loops", "found", "false"))
    print(
        f"{len(outcomes)} drives, {refused} refused, {len(rms) - len(some)} without a place: rms along the path "
        f"{np.sqrt(mean(some**2)):.2f} m (worst drive {some.max(initial=0.0):.2f}; nearest fix "
        f"{np.nanmedian([one.nearest for one in outcomes]):.1f} m); 95 % bands hold "
        f"{100 * np.nanmean([one.inside for one in outcomes]):.1f} %, across "
        f"{100 * np.nanmean([one.lateral_inside for one in outcomes]):.1f} %; "
        f"clock {np.sqrt((clock**2).mean()):.3f} s rms, worst {clock.max():.3f}; loops "
        f"{found} of {loops}, {false} false"
    )


if __name__ == "__main__":
    main()
