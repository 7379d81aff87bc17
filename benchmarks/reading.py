"""A long record: CPU and resident memory of reading, ingesting and locating beside a plain h5py and SciPy decimation.

    python benchmarks/reading.py --minutes 3 10

Makes one-minute PRODML files of 2,000 channels at 500 Hz (240 MB each, not compressed): a simulated street in the
middle of noise, with vehicles at the begin and again in the middle of the record. Then, each in a process of its own:

- plain: every file read with h5py, decimated with SciPy's polyphase filter in single precision, and kept; of all
  channels, and of those that a survey reads
- ingest: `roadfiber ingest`, then `roadfiber locate` from the store
- read: what `locate` reads of the files where there is no store; and `roadfiber locate` so, without and with the
  corridor of what the model may lack

CPU is user and system time of the process, imports included; memory its peak resident size. What a length costs that
was not run is a straight line through those that were: `--tell 30 180`.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

CHANNELS, RATE, FIRST = 2000, 500.0, 900
#: Of the simulated street, Hz: a vehicle near the fiber changes strain faster than 10 Hz shows.
SIMULATED = 50.0
#: Share of white noise's variance that passes the filter before decimation to 20 Hz.
PASSED = 0.9 * 20 / RATE
PLAIN = """
import sys, numpy as np, h5py, scipy.signal as signal
from pathlib import Path
first, stop = int(sys.argv[2]), int(sys.argv[3])
taps, kept = signal.firwin(501, 0.9 / 25, window=("kaiser", 5.0)).astype(np.float32), []
for path in sorted(Path(sys.argv[1]).glob("das/*.h5")):
    with h5py.File(path) as file:
        kept.append(signal.resample_poly(file["Acquisition/Raw[0]/RawData"][:, first:stop], 1, 25, axis=0, window=taps))
print(np.concatenate(kept).shape)
"""
READ = """
import sys
import roadfiber as rf
record = rf.read(sys.argv[1]).record
print(*record.strain_rate.shape, record.channel[0], record.channel[-1] + 1)
"""


def write(folder: Path, minutes: int, seed: int = 0) -> None:
    """Write a survey of so many minutes."""
    import numpy as np
    import pandas as pd
    from scipy.signal import resample

    from solver.simulator import simulate, write_survey
    from solver.simulator.scenario import read_scenario
    from solver.survey.das.prodml import write_prodml

    street, rng = simulate(read_scenario("street", seed=3, sampling_rate=SIMULATED)), np.random.default_rng(seed)
    write_survey(street, folder / "street")
    signal = np.asarray(resample(street.signal, round(len(street.signal) * RATE / SIMULATED)), np.float32)
    # The street's noise at 20 Hz, and the same at all times and channels: a fit takes it from quiet ones.
    level = street.noise_sd / PASSED**0.5
    shift = minutes * 30  # s; vehicles come again in the middle of the record
    begins = [0, int(shift * RATE)] if minutes >= 8 else [0]
    (folder / "das").mkdir()
    noise = rng.normal(0, level, (int(60 * RATE), CHANNELS)).astype(np.float32)
    for minute in range(minutes):
        values = np.roll(noise, rng.integers(len(noise)), 0)
        row = int(minute * 60 * RATE)
        for begin in begins:
            low, high = max(row, begin), min(row + len(values), begin + len(signal))
            if high > low:
                part = signal[low - begin : high - begin]
                values[low - row : high - row, FIRST : FIRST + part.shape[1]] += part
        start, scenario = street.start + np.timedelta64(60 * minute, "s"), street.scenario
        setting = {"gauge_length": scenario.gauge_length, "channel_spacing": scenario.channel_spacing}
        path = folder / "das" / f"{minute:04d}.h5"
        write_prodml(path, values, start=start, sampling_rate=RATE, packed=False, **setting)
    tracks = pd.read_csv(folder / "street" / "trajectories.csv")
    again = tracks.copy()
    again["track_id"] = "again " + again["track_id"].astype(str)
    again["time"] = (
        pd.to_datetime(again["time"], utc=True, format="ISO8601") + pd.Timedelta(seconds=shift)
    ).dt.strftime("%Y-%m-%dT%H:%M:%S.%fZ")
    pd.concat([tracks, again] if len(begins) > 1 else [tracks]).to_csv(folder / "trajectories.csv", index=False)
    anchors = pd.read_csv(folder / "street" / "anchors.csv")
    anchors["channel"] += FIRST
    anchors.to_csv(folder / "anchors.csv", index=False)
    (folder / "site.toml").write_text((folder / "street" / "site.toml").read_text())


def measured(*words: object) -> dict[str, Any]:
    """Run Python; CPU seconds, peak memory, and what was printed."""
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    with tempfile.TemporaryFile("w+") as said:
        child = subprocess.Popen([sys.executable, *map(str, words)], stdout=said, env=environment)
        _, status, used = os.wait4(child.pid, 0)
        said.seek(0)
        printed = said.read().strip()
    if status:
        sys.exit(f"{words}: status {status}")
    return {"cpu_s": used.ru_utime + used.ru_stime, "peak_gb": used.ru_maxrss * 1024 / 1e9, "printed": printed}


def compare(minutes: int, folder: Path) -> dict[str, dict[str, Any]]:
    """All ways to read one record of so many minutes."""
    # In a process of its own: peak memory is handed down to those that a process begins.
    measured(__file__, "--write", minutes, folder)
    roadfiber = ("-m", "roadfiber", "-q")
    locate = (*roadfiber, "locate", folder, "--corridor", "fit", "--out")
    found = {"read": measured("-c", READ, folder)}
    print(f"{minutes} min: read {found['read']}", file=sys.stderr, flush=True)
    first, stop = found["read"]["printed"].split()[-2:]
    for what, words in (
        ("plain of the same channels", ("-c", PLAIN, folder, first, stop)),
        ("plain of all channels", ("-c", PLAIN, folder, 0, CHANNELS)),
        ("ingest", (*roadfiber, "ingest", folder, "--out", folder / "store")),
        ("locate from files", (*locate, folder / "run")),
        ("the same, wider corridor", (*roadfiber, "locate", folder, "--out", folder / "run")),
    ):
        found[what] = measured(*words)
        print(f"{minutes} min: {what} {found[what]}", file=sys.stderr, flush=True)
    (folder / "store").rename(folder / "das-store")
    found["locate from the store"] = measured(*locate, folder / "run-store")
    return found


def line(points: list[tuple[int, float]], at: float) -> float:
    """Straight line through the first and the last point, told at a place."""
    (x, y), (far, there) = points[0], points[-1]
    return y + (there - y) * (at - x) / (far - x)


def main() -> None:
    """Run and tell."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=int, nargs="+", default=[3, 6])
    parser.add_argument("--tell", type=int, nargs="*", default=[30, 180], help="minutes to extrapolate to")
    parser.add_argument("--folder", type=Path, help="where to make the files; a temporary folder by default")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--write", nargs=2, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.write:
        write(Path(given.write[1]), int(given.write[0]))
        return
    results: dict[int, dict[str, dict[str, Any]]] = {}
    for minutes in given.minutes:
        with tempfile.TemporaryDirectory(dir=given.folder) as name:
            results[minutes] = compare(minutes, Path(name))
        if not given.json:
            print(f"\n{minutes} min, {minutes * 0.24:.1f} GB")
            for what, one in results[minutes].items():
                print(f"  {what:28} {one['cpu_s']:7.1f} s CPU {one['peak_gb']:6.2f} GB")
    if given.json:
        print(json.dumps(results, indent=1))
    elif len(results) > 1:
        for minutes in given.tell:
            print(f"\n{minutes} min, extrapolated by a straight line")
            for what in next(iter(results.values())):
                cpu, peak = (
                    line([(each, one[what][key]) for each, one in results.items()], minutes)
                    for key in ("cpu_s", "peak_gb")
                )
                print(f"  {what:28} {cpu:7.1f} s CPU {peak:6.2f} GB")


if __name__ == "__main__":
    main()
