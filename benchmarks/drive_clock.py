"""How well the clock of a drive can be told at all: the drives of `benchmarks/drive.py`, fitted, and with exact picks.

    python -m benchmarks.drive_clock --first 6420 --drives 20

For the second fit the loops are known, every channel that the car goes by is heard, and each is picked where the GPS
has the car when it truly passes. Map, length of cable and GPS are what they were. What this clock is off by, no better
reading of the record can mend.
"""

import argparse
import json
import multiprocessing
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import roadfiber as rf
from benchmarks.drive import drawn
from solver.drive.along import Along, smoothed_along, steps_of
from solver.drive.channel_fit import Fit, fit_drive
from solver.drive.drive import Drive
from solver.drive.path import STEP
from solver.drive.path import Path as MapPath
from solver.drive.picks import SHARPEST, Picks
from solver.drive.response import Clock, Legs, legs_of
from solver.simulator.drive_road import Ground
from solver.simulator.drive_scenario import DriveScenario
from solver.simulator.drive_traffic import car_motion

Array = NDArray[np.float64]

#: m to the side of the car, and cells ahead of it or behind, within which a channel is passed.
BESIDE, ABREAST = 25.0, 1.5
#: Hz; the noise has the density that is drawn at another rate.
RATE = 12.5


def cells_of(path: MapPath, place: Array) -> Array:
    """Places [place, 2] as cells along a path, in parts of a cell."""
    near, _ = path.nearest(place)
    return np.asarray(near + ((place - path.points[near]) * path.along[near]).sum(1) / STEP)


def exact_picks(legs: Legs, path: MapPath, driven: Array, route: Array, loop: NDArray[np.bool_]) -> Picks:
    """Picks without error but the GPS's.

    Parameters
    ----------
    driven : where the car is [time, 2]
    route, loop : where each channel lies [channel, 2], and whether in a loop [channel]
    """
    shape = (legs.count, len(route))
    cell, speed, row = np.full(shape, np.nan), np.ones(shape), np.zeros(shape, np.int64)
    seen, real, there = (cells_of(path, place) for place in (legs.driven.position, driven, route))
    for leg in range(legs.count):
        rows = np.flatnonzero(legs.near & (legs.leg == leg))
        row[leg] = rows[np.abs(real[rows, None] - there).argmin(0)]
        ahead = there - real[row[leg]]
        passed = (np.abs(ahead) < ABREAST) & (np.linalg.norm(driven[row[leg]] - route, axis=1) < BESIDE) & ~loop
        cell[leg, passed] = (seen[row[leg]] + ahead)[passed]
        speed[leg, passed] = legs.speed[row[leg, passed]]
    return Picks(cell, np.full(shape, SHARPEST), speed, row, np.ones(shape), np.ones(shape))


def at_best(drive: Drive, fit: Fit, scenario: DriveScenario, truth: dict[str, Any], clock: Clock) -> Along:
    """The smoother's places and clock with exact picks, from the true clock."""
    quiet, path = fit.quiet, fit.path
    legs = legs_of(quiet, path, fit.car, clock)
    driven, _ = car_motion(scenario, Ground(scenario).road).at(quiet.time)
    route, loop = np.array(truth["route_xyz"], float)[:, :2], np.array(truth["in_loop"], bool)
    picks = exact_picks(legs, path, driven, route, loop)
    slack, (factor, sigma) = np.zeros(len(route)), drive.length_factor
    steps = steps_of(path, cells_of(path, route), loop, slack, quiet.channel_spacing, factor, drive.sigma)
    return smoothed_along(picks, legs, steps, sigma, (fit.car.memory, fit.car.sigma), quiet.channel_spacing)


def one_drive(seed: int) -> tuple[float, float]:
    """Simulate and locate one drive: by how much its clock is off, s, and would be with exact picks."""
    settings = drawn(seed, sampling_rate=RATE)
    with tempfile.TemporaryDirectory() as scratch:
        with multiprocessing.get_context("spawn").Pool(1) as pool:
            made = pool.apply(rf.simulate, (Path(scratch) / "drive", "drive"), settings)
        drive = rf.read(made.site)
        assert isinstance(drive, Drive)
        truth = json.loads(made.truth.read_text())
        fit, real = fit_drive(drive), float(truth["clock_offset"])
        best = at_best(drive, fit, DriveScenario(**settings), truth, Clock(real))
    ways = "both ways" if fit.both_ways else "one way" if settings["u_turns"] == 0 else "hardly heard both ways"
    off, decibels = fit.clock.offset - real, settings["snr_db"] - 10 * np.log10(50 / RATE)
    print(
        f"{seed:5d} {decibels:5.1f} dB, GPS {fit.car.sigma:.1f} m, {ways:22s} | clock off by {off:+.3f} "
        f"± {fit.clock_sigma:.3f} s | with exact picks {best.clock:+.3f} ± {best.clock_sigma:.3f} s",
        flush=True,
    )
    return off, best.clock


def main() -> None:
    """Run the drives and say what they show together."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=6420, help="first seed")
    parser.add_argument("--drives", type=int, default=20)
    asked = parser.parse_args()
    off = []
    for seed in range(asked.first, asked.first + asked.drives):
        try:
            off.append(one_drive(seed))
        except rf.InputError as error:
            print(f"{seed:5d} refused: {error}", flush=True)
    if off:
        errors = np.abs(off)
        within, rms = (errors < 0.1).sum(0), np.sqrt((errors**2).mean(0))
        print(
            f"{len(off)} drives: within 0.1 s {within[0]}, {rms[0]:.3f} s rms; "
            f"with exact picks {within[1]}, {rms[1]:.3f} s rms"
        )


if __name__ == "__main__":
    main()
