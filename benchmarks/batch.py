"""Throughput of every stage of a batch, and what a day, a week and a city would take: core hours and storage.

    python benchmarks/batch.py --minutes 1 4

Makes two records of so many one-minute files (2,000 channels at 500 Hz, see `reading.py`) and a rendered video, and
takes the steps of `roadfiber batch` on them, each in a process of its own. CPU is user and system time, imports
included; what a longer record takes follows from the difference of the two: part of cost and store does not grow.

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
job = Job(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[4], ("ingest", "track", "locate", "diagnose"))
print(json.dumps(asdict(take(job, sys.argv[3], ()))))
"""
#: Bytes a second and frames a day of one interrogator and its camera; stretches of its fiber; interrogators of a city.
BYTES, FRAMES, STRETCHES, CITY = 2000 * 500 * 4, 25 * 3600, 20, 500
DAY = 86400


def step(site: Path, out: Path, name: str) -> dict[str, Any]:
    """Take a step in a process of its own: its outcome, CPU seconds and peak memory."""
    environment = os.environ | {"OMP_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
    words = [sys.executable, "-c", STEP, str(site), str(out), name, site.parent.name]
    with tempfile.TemporaryFile("w+") as said:
        child = subprocess.Popen(words, stdout=said, env=environment)
        _, status, used = os.wait4(child.pid, 0)
        said.seek(0)
        outcome: dict[str, Any] = json.loads(said.read().splitlines()[-1])
    if status or outcome["status"] != "done":
        sys.exit(f"{name}: {outcome}")
    return outcome | {"cpu_s": used.ru_utime + used.ru_stime, "peak_gb": used.ru_maxrss * 1024 / 1e9}


def film(folder: Path) -> None:
    """Write the demo's street with its rendered video, calibrated, without trajectories."""
    from roadfiber.cameras import calibrate
    from roadfiber.command import write_demo
    from solver.simulator import read_scenario

    write_demo(folder, read_scenario("street-filmed", seed=4, passes=3))
    view = calibrate(folder / "control_points.csv", video=folder / "street.mp4")
    view.save(folder / "calibration.json")
    site = folder / "site.toml"
    site.write_text(re.sub(r"\[trajectories\]\n[^\[]*\[[^\n]*\n", "", site.read_text()))


def recorded(folder: Path, minutes: int) -> Path:
    """A record of so many one-minute files, and the street in the middle of it as it was simulated; its site.toml."""
    apart("reading.py", "--write", str(minutes), str(folder))
    return folder / "site.toml"


def apart(script: str, *words: str) -> None:
    """Run a benchmark in a process of its own: peak memory is handed down to those that a process begins."""
    command = [sys.executable, str(ROOT / "benchmarks" / script), *words]
    subprocess.run(command, check=True, env=os.environ | {"PYTHONPATH": str(ROOT)})


def main() -> None:
    """Run and tell."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=int, nargs=2, default=(1, 4), help="of two records to ingest")
    parser.add_argument("--folder", type=Path, help="where to make the files; a temporary folder by default")
    parser.add_argument("--film", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.film:
        film(given.film)
        return
    found: dict[str, dict[str, Any]] = {}
    with tempfile.TemporaryDirectory(dir=given.folder) as temporary:
        folder = Path(temporary)
        street = folder / "long" / "street" / "site.toml"
        apart("batch.py", "--film", str(folder / "filmed"))
        for name, step_name, site in (
            ("ingest, short", "ingest", recorded(folder / "short", given.minutes[0])),
            ("ingest", "ingest", recorded(folder / "long", given.minutes[1])),
            ("track", "track", folder / "filmed" / "site.toml"),
            ("locate", "locate", street),
            ("diagnose", "diagnose", street),
        ):
            found[name] = step(site, folder / "runs", step_name)
            print(f"{name}: {found[name]}", file=sys.stderr, flush=True)
    tell(found)


def more(found: dict[str, dict[str, Any]]) -> tuple[float, float]:
    """CPU seconds and bytes of the store that each byte more of a record takes, by the two that were ingested."""
    long, short = found["ingest"], found["ingest, short"]
    raw = long["facts"]["raw_bytes"] - short["facts"]["raw_bytes"]
    kept = long["facts"]["bytes"] - short["facts"]["bytes"]
    return (long["cpu_s"] - short["cpu_s"]) / raw, kept / raw


def tell(found: dict[str, dict[str, Any]]) -> None:
    """Print throughput per stage, and what is multiplied up from it."""
    ingest, kept = more(found)
    frames = found["track"]["facts"]["frames"]
    cpu = {name: one["cpu_s"] for name, one in found.items()}
    for name, one in found.items():
        print(f"{name:13} {one['cpu_s']:7.1f} s of one core, {one['peak_gb']:5.2f} GB")
    print(f"ingest {1e-6 / ingest:.0f} MB/s, to 1/{1 / kept:.0f}; track {frames / cpu['track']:.1f} frames/s")
    hours = {
        "ingest": BYTES * DAY * ingest / 3600,
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
        print(f"{name}: core hours {words}; raw {size:.2f} TB, store {size * kept:.3f} TB")


if __name__ == "__main__":
    main()
