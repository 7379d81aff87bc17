"""Every size that docs/limits.md claims, end to end: that each runs, its time, CPU and peak memory. Before a release.

    python benchmarks/sizes.py            # hours, and 44 GB of disk for three hours of a record
    python benchmarks/sizes.py --quick    # the same ways at the least size: half an hour

What a size gives is told by the benchmark that it stands in; here it ends without an error, or is named at the end.
"""

import argparse
import os
import shlex
import subprocess
import sys
import tempfile
import time
from pathlib import Path

#: What docs/limits.md claims: the sizes, the least of them, and what runs a benchmark with them.
CLAIMS = {
    "passes on 100 m": (
        "many_passes.py --passes 8 80 500",
        "many_passes.py --passes 8",
    ),
    "the same, all fitted": (
        "many_passes.py --all-passes --corridor fit --passes 8 80 500",
        "many_passes.py --all-passes --corridor fit --passes 8",
    ),
    "kilometers of fiber": (
        "long_fiber.py --lengths 1 10 --passes 50",
        "long_fiber.py --lengths 0.5 --passes 12",
    ),
    "minutes of 2,000 channels at 500 Hz": (
        "reading.py --minutes 4 10 30 180",
        "reading.py --minutes 4",
    ),
    "kilometers of a drive": (
        "drive.py --drives 1 --length 25000 --spacing 5 --rate 50",
        "drive.py --drives 1 --length 2000 --rate 12.5",
    ),
}
#: What a user does with a survey, from end to end; RUN and the rest are folders. Long runs are looked at by stretches.
COMMANDS = (
    "simulate SCENARIO --out SURVEY",
    "ingest SURVEY",
    "locate SURVEY --out RUN",
    "compare RUN",
    "diagnose RUN",
    "plan PLANNED --out PLAN",
    "export RUN --to route.geojson",
)
#: A long street, and the least; and the example of `roadfiber plan --help`.
SCENARIO = 'base = "street"\nview = [0, {view}]\nchannels = {channels}\npasses = 6\nsnr_db = 18\nseed = 3\n'
LONG, LEAST = {"view": 450, "channels": 620}, {"view": 40, "channels": 121}
PLANNED = """
das = { gauge_length = 10.0 }
plan.length = 100
plan.offset = 4.5
plan.snr_db = 15
plan.anchors = [12]
plan.lanes = [
    { y = 0.0, toward = "+x", vehicles = { car = 4, truck = 1 } },
    { y = -3.5, toward = "-x", vehicles = { car = 3, bus = 1 } },
]
"""


def ended(words: list[str], folder: Path) -> bool:
    """Run Python; whether it ended well, with its time, CPU and peak memory on standard error."""
    begun = time.perf_counter()
    child = subprocess.Popen([sys.executable, *words], cwd=folder)
    _, status, used = os.wait4(child.pid, 0)
    took = (
        f"{time.perf_counter() - begun:.0f} s, {used.ru_utime + used.ru_stime:.0f} s CPU, {used.ru_maxrss / 1e6:.2f} GB"
    )
    print(f"-- {shlex.join(words)}: {took}{'' if status == 0 else f', STATUS {status}'}", file=sys.stderr, flush=True)
    return status == 0


def main() -> int:
    """Run all; how many did not end well."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="the least sizes")
    parser.add_argument("--only", choices=[*CLAIMS, "commands"], help="one claim")
    given, here = parser.parse_args(), Path(__file__).resolve().parent
    failed = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for claim, sizes in CLAIMS.items():
            script, *words = sizes[given.quick].split()
            if given.only in (None, claim) and not ended([str(here / script), *words], folder):
                failed.append(claim)
        (folder / "SCENARIO.toml").write_text(SCENARIO.format(**(LEAST if given.quick else LONG)))
        (folder / "PLANNED").mkdir()
        (folder / "PLANNED" / "site.toml").write_text(PLANNED)
        for command in COMMANDS if given.only in (None, "commands") else ():
            words = command.replace("SCENARIO", "SCENARIO.toml").split()
            if not ended(["-m", "roadfiber", "-q", *words], folder):
                failed.append(command)
    print("\n".join(f"FAILED: {one}" for one in failed) or "every size ran to its end")
    return len(failed)


if __name__ == "__main__":
    sys.exit(main())
