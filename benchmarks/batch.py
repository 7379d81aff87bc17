"""Throughput of every stage of a batch, and what a day, a week and a city would take: core hours and storage.

    python benchmarks/batch.py --minutes 3

Makes a survey of so many one-minute files (2,000 channels at 500 Hz, see `reading.py`) and a rendered video, and takes
the steps of `roadfiber batch` on them, each in a process of its own. CPU is user and system time, imports included.

A day is one interrogator's: 2,000 channels of 1 m at 500 Hz, single precision; one camera for an hour at 25 frames a
second; its 2 km of fiber located and diagnosed in stretches of 100 m, each from its own vehicles. A city is 1,000 km of
fiber, recorded for a day. What is told of them is multiplied up, not run.
"""

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
STEP = """
import json, sys
from dataclasses import asdict
from pathlib import Path
from roadfiber.batch_steps import Job, take
job = Job(Path(sys.argv[1]), Path(sys.argv[2]), "survey", ("ingest", "track", "locate", "diagnose"))
print(json.dumps(asdict(take(job, sys.argv[3], ()))))
"""
#: Bytes a second and frames a day of one interrogator and its camera; stretches of its fiber; interrogators of a city.
BYTES, FRAMES, STRETCHES, CITY = 2000 * 500 * 4, 25 * 3600, 20, 500
DAY = 86400


def step(site: Path, out: Path, name: str) -> dict[str, Any]:
    """Take a step in a process of its own: its outcome, CPU seconds and peak memory."""
    environment = os.environ | {"OMP_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
    words = [sys.executable, "-c", STEP, str(site), str(out), name]
    with tempfile.TemporaryFile("w+") as said:
        child = subprocess.Popen(words, stdout=said, env=environment)
        _, status, used = os.wait4(child.pid, 0)
        said.seek(0)
        outcome: dict[str, Any] = json.loads(said.read().splitlines()[-1])
    if status or outcome["status"] != "done":
        sys.exit(f"{name}: {outcome}")
    return outcome | {"cpu_s": used.ru_utime + used.ru_stime, "peak_gb": used.ru_maxrss * 1024 / 1e9}


def filmed(folder: Path) -> Path:
    """The demo's street with its rendered video, calibrated, without trajectories; its site.toml."""
    from roadfiber.cameras import calibrate
    from roadfiber.command import write_demo
    from solver.simulator import read_scenario

    write_demo(folder, read_scenario("street-filmed", seed=4))
    view = calibrate(folder / "control_points.csv", video=folder / "street.mp4")
    view.save(folder / "calibration.json")
    site = folder / "site.toml"
    site.write_text(re.sub(r"\[trajectories\]\n[^\[]*\[[^\n]*\n", "", site.read_text()))
    return site


def main() -> None:
    """Run and tell."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=int, default=3)
    parser.add_argument("--folder", type=Path, help="where to make the files; a temporary folder by default")
    given = parser.parse_args()
    found: dict[str, dict[str, Any]] = {}
    with tempfile.TemporaryDirectory(dir=given.folder) as name:
        folder = Path(name)
        survey = folder / "survey"
        subprocess.run(
            [sys.executable, str(ROOT / "benchmarks" / "reading.py"), "--write", str(given.minutes), str(survey)],
            check=True,
            env=os.environ | {"PYTHONPATH": str(ROOT)},
        )
        found["track"] = step(filmed(folder / "filmed"), folder / "filmed-runs", "track")
        # The street in the middle of the long record, as it was simulated.
        for name, site in (("ingest", survey), ("locate", survey / "street"), ("diagnose", survey / "street")):
            found[name] = step(site / "site.toml", folder / "runs", name)
            print(f"{name}: {found[name]}", file=sys.stderr, flush=True)
    tell(found)


def tell(found: dict[str, dict[str, Any]]) -> None:
    """Print throughput per stage, and what is multiplied up from it."""
    raw, kept = found["ingest"]["facts"]["raw_bytes"], found["ingest"]["facts"]["bytes"]
    frames = found["track"]["facts"]["frames"]
    cpu = {name: one["cpu_s"] for name, one in found.items()}
    for name, one in found.items():
        print(f"{name:9} {one['cpu_s']:7.1f} s of one core, {one['peak_gb']:5.2f} GB")
    print(
        f"ingest {raw / 1e6 / cpu['ingest']:.0f} MB/s, to 1/{raw / kept:.0f}; "
        f"track {frames / cpu['track']:.1f} frames/s"
    )
    hours = {
        "ingest": BYTES * DAY / raw * cpu["ingest"] / 3600,
        "track": FRAMES / frames * cpu["track"] / 3600,
        "locate": STRETCHES * cpu["locate"] / 3600,
        "diagnose": STRETCHES * cpu["diagnose"] / 3600,
    }
    rows = (("day", 1, 1), ("week", 7, 1), ("city", 1, CITY))
    for name, days, interrogators in rows:
        each = {
            one: value * interrogators * (days if one in ("ingest", "track") else 1) for one, value in hours.items()
        }
        size = BYTES * DAY * days * interrogators / 1e12
        words = ", ".join(f"{one} {value:.1f}" for one, value in each.items())
        print(f"{name}: core hours {words}; raw {size:.2f} TB, store {size * kept / raw:.3f} TB")


if __name__ == "__main__":
    main()
