"""What a drive in one direction allows its clock, and what the fit makes of it.

    python -m benchmarks.drive_clock --first 6120 --drives 10

Drives are those of `benchmarks/drive.py` at 12.5 Hz without a U-turn. Beside the clock's error and its standard
deviation stand two limits: that of these picks, with the GPS's errors as they are simulated, and that of a fiber that
were a perfect odometer: picks to 0.1 m, cable laid as the map says but for the map's slow errors.
"""

import argparse
import json
import tempfile
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import numpy as np
from scipy.stats import norm

import roadfiber as rf
from benchmarks.drive import drawn
from solver.drive import odometer
from solver.drive.along import QUARTZ, steps_of
from solver.drive.channel_fit import Fit, fit_drive
from solver.drive.drive import Drive
from solver.drive.loops import flags_of
from solver.drive.odometer import Drove, clock_of_fixes
from solver.drive.response import Clock

#: Share of a fix's sigma that is slow in the simulator; m, of perfect picks; share of the variance of a step.
SLOW, PERFECT, LAID = 0.3**0.5, 0.1, 1 / 9
#: s, asked of a clock.
ASKED = 0.1


def limits(drive: Drive, fit: Fit) -> tuple[float, float]:
    """Standard deviations of the clock, s: of these picks, and of a perfect odometer."""
    flags = flags_of(fit.loops, len(fit.cell))
    spacing, (factor, factor_sigma) = fit.quiet.channel_spacing, drive.length_factor
    steps = steps_of(fit.path, fit.along.cell, flags, fit.channels.in_loop, spacing, factor, drive.sigma)
    clock = Clock(fit.clock.offset - fit.along.clock)
    weight = np.where(fit.picks.audible, 1.0, 0.0)
    picked = Drove(fit.picks, fit.legs, weight, steps, factor_sigma, spacing, QUARTZ, fit.car, fit.path, clock)
    sharp = replace(fit.picks, sigma=np.full(fit.picks.sigma.shape, PERFECT))
    laid = replace(steps, variance=steps.variance * LAID)
    # White noise counts once: the simulator's has no memory.
    car = replace(fit.car, model=(fit.car.model[0], np.full_like(fit.car.model[1], 1e-3)))
    one, perfect = replace(picked, car=car), replace(picked, picks=sharp, steps=laid, car=car)
    with patch.multiple(odometer, SLOW=SLOW, PULL=0.0):
        return clock_of_fixes(one)[1], clock_of_fixes(perfect)[1]


def main() -> None:
    """Run the drives and say what they show together."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=6120, help="first seed; those that draw a U-turn are left out")
    parser.add_argument("--drives", type=int, default=10)
    asked = parser.parse_args()
    rows = list[tuple[float, float, float, float]]()
    seed = asked.first
    while len(rows) < asked.drives:
        settings, seed = drawn(seed, sampling_rate=12.5), seed + 1
        if settings["u_turns"]:
            continue
        with tempfile.TemporaryDirectory() as scratch:
            made = rf.simulate(Path(scratch) / "drive", "drive", **settings)
            drive = rf.read(made.site)
            assert isinstance(drive, Drive)
            try:
                fit = fit_drive(drive)
            except rf.InputError as error:
                print(f"{settings['seed']} refused: {error}", flush=True)
                continue
            off = fit.clock.offset - json.loads(made.truth.read_text())["clock_offset"]
        rows.append((off, fit.clock_sigma, *limits(drive, fit)))
        words = "{:+.3f} ± {:.3f} s; limits {:.3f} of these picks, {:.3f} of a perfect odometer".format(*rows[-1])
        print(f"{settings['seed']} GPS of {fit.car.sigma:.1f} m: clock off by {words}", flush=True)
    off, *sigmas = np.array(rows).T
    within = [float((2 * norm.cdf(ASKED / one) - 1).sum()) for one in sigmas]
    print(
        f"{len(off)} drives: off by {np.sqrt((off**2).mean()):.3f} s rms, "
        f"{np.sqrt(((off / sigmas[0]) ** 2).mean()):.2f} sigmas; medians of sigma and limits "
        f"{', '.join(f'{np.median(one):.3f}' for one in sigmas)} s; within {ASKED} s {(np.abs(off) <= ASKED).sum()}, "
        f"expected {', '.join(f'{one:.1f}' for one in within)}"
    )


if __name__ == "__main__":
    main()
