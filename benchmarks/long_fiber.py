"""A fiber of kilometers along a gently curving road: seconds, memory and errors of one global fit, by length.

    python benchmarks/long_fiber.py --lengths 1 2.5 5 10 --passes 50
    python benchmarks/long_fiber.py --lengths 0.5 1 --passes 12 --trials 8 --seed 100

Along the road, across it and in depth, `in sigmas` is the rms error in the route's own standard deviations and `inside`
the share of channels in the 95 % interval; `--trials` judges so many surveys of each length, of seeds from `--seed` on.
The surveys are made stretch by stretch by the simulator's elastic half-space, which shares no code with the signal
path. Each length is read from files and located in a process of its own, whose seconds and peak memory are told.
"""

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from solver.run.locate import locate
from solver.simulator.buried_route import Route
from solver.simulator.elastic import extension, gauge_nodes, gauge_weights
from solver.simulator.vehicle import GRAVITY, Vehicle, draw_vehicle
from solver.survey.anchors import Anchor
from solver.survey.das import DASRecord
from solver.survey.survey import Survey
from vision.contract import progress

Array = NDArray[Any]
SPACING, GAUGE, RATE = 1.021, 10.0, 5.0
AMPLITUDE, WAVELENGTH = 30.0, 2000.0  # m, of the road's bends: radii of 3 km and more
POISSON, MODULUS = 0.25, 6e7
STRETCH, REACH = 100, 45.0  # channels made at once; m beyond which a vehicle is not sensed
STENCIL = 0.01  # s
Z95 = 1.96


@dataclass(frozen=True)
class LongSurvey:
    """A made survey: record, trajectory table, anchors, and the true route of all channels [channel, 3], m."""

    record: DASRecord
    trajectories: pd.DataFrame
    anchors: list[Anchor]
    truth: Array


def road(x: Array) -> Array:
    """y of the road's middle, m."""
    return AMPLITUDE * np.sin(2 * np.pi * x / WAVELENGTH)


def laid(length: float, rng: np.random.Generator) -> Route:
    """A fiber some 4.5 m beside the road, gently undulating."""
    x = np.arange(-20.0, length + 20.0, 0.25)
    phase = rng.uniform(0, 2 * np.pi, 2)
    y = road(x) + 4.5 + 0.4 * np.sin(2 * np.pi * x / 170.0 + phase[0])
    z = 0.9 + 0.1 * np.sin(2 * np.pi * x / 230.0 + phase[1])
    return Route.through(np.column_stack([x, y, z]))


def driven(length: float, passes: int, rng: np.random.Generator) -> list[Vehicle]:
    """Vehicles that follow the road from end to end, both ways."""
    found, time_at = [], 8.0
    for number in range(passes):
        direction = 1 if number % 2 else -1
        vehicle = draw_vehicle(
            rng,
            str(number),
            rng.choice(["car", "van", "truck", "bus"], p=[0.5, 0.25, 0.15, 0.1]),
            direction=direction,
            lane=0.0 if direction > 0 else -3.5,
            time_at=time_at,
            x_at=-REACH if direction > 0 else length + REACH,
            speed=rng.uniform(40, 70) / 3.6,
        )
        bends = (AMPLITUDE, 2 * np.pi / WAVELENGTH, 0.0)
        found.append(replace(vehicle, weave=(*vehicle.weave, bends)))
        time_at += rng.uniform(12, 25)
    return found


def way_of(vehicle: Vehicle, length: float) -> tuple[Array, Array]:
    """Time, s, and x, m, of a vehicle, every tenth of a second from end to end."""
    time = np.arange(vehicle.time_at, vehicle.time_at + 1.3 * (length + 2 * REACH) / vehicle.speed, 0.1)
    x = vehicle.position(time)[:, 0]
    keep = (x > -REACH) & (x < length + REACH)
    return time[keep], x[keep]


def signal_of(route: Route, distance: Array, vehicles: list[Vehicle], length: float, rows: int) -> Array:
    """Strain rate [time, channel], 1/s, without noise."""
    out = np.zeros((rows, len(distance)), np.float32)
    ways = [way_of(vehicle, length) for vehicle in vehicles]
    lag = STENCIL * np.array([-1.0, 1.0])
    with progress("simulating", len(distance)) as advance:
        for first in range(0, len(distance), STRETCH):
            here = distance[first : first + STRETCH]
            ends = float(here[0] - GAUGE / 2 - 1), float(here[-1] + GAUGE / 2 + 1)
            nodes = gauge_nodes(*ends, 1.0, 3)
            points, tangents = route.position(nodes).T, route.tangent(nodes).T
            average = gauge_weights(here, GAUGE, *ends, 1.0, 3).T / (4 * np.pi * MODULUS)
            low, high = points[0].min() - REACH, points[0].max() + REACH
            for vehicle, (when, x) in zip(vehicles, ways, strict=True):
                near = when[(x > low) & (x < high)]
                samples = np.arange(np.ceil(near[0] * RATE), np.floor(near[-1] * RATE) + 1).astype(int)
                samples = samples[samples < rows]
                place, share = vehicle.wheels((samples[:, None] / RATE + lag).ravel())
                strain = np.zeros((len(place), len(nodes)))
                for wheel, part in enumerate(share):
                    offset = points[0] - place[:, wheel, :1], points[1] - place[:, wheel, 1:], points[2]
                    strain += vehicle.mass * GRAVITY * part * extension(offset, tangents, POISSON)
                ends_of = (strain @ average).reshape(len(samples), 2, -1)
                out[samples, first : first + STRETCH] += (ends_of[:, 1] - ends_of[:, 0]) / (2 * STENCIL)
            advance(len(here))
    return out


def made(kilometers: float, passes: int, snr_db: float, seed: int) -> LongSurvey:
    """A survey of such a length; SNR over the samples with a vehicle within 50 m, white noise."""
    rng = np.random.default_rng(seed)
    length = 1000.0 * kilometers
    route, vehicles = laid(length, rng), driven(length, passes, rng)
    first = int(np.ceil(20.0 / SPACING))
    channel = np.arange(int(length / SPACING))
    distance = SPACING * (channel + first)
    truth = route.position(distance)
    rows = int(max(way_of(vehicle, length)[0][-1] for vehicle in vehicles) * RATE) + 60
    signal = signal_of(route, distance, vehicles, length, rows)
    near = 100.0 / np.mean([vehicle.speed for vehicle in vehicles]) * RATE * passes * len(channel)
    noise = float(np.sqrt((signal.astype(float) ** 2).sum() / near / 10 ** (snr_db / 10)))
    strain_rate = signal + np.float32(noise) * rng.standard_normal(signal.shape, dtype=np.float32)
    tables = []
    start = np.datetime64("2025-08-11T06:00:00", "ns")
    for vehicle in vehicles:
        when, _ = way_of(vehicle, length)
        fixes = when[::2]
        place = vehicle.position(fixes) + 0.06 * rng.normal(size=(len(fixes), 2))
        table = {"time": start + (fixes * 1e9).astype("timedelta64[ns]"), "track_id": vehicle.track_id}
        table |= {"class": vehicle.vehicle_class, "x": place[:, 0], "y": place[:, 1], "sigma_x": 0.06, "sigma_y": 0.06}
        tables.append(pd.DataFrame(table))
    trajectories = pd.concat(tables, ignore_index=True)
    trajectories["time"] = trajectories["time"].dt.tz_localize("UTC")
    at = channel[200::1000] if len(channel) > 200 else channel[len(channel) // 2 :][:1]
    places = (truth[at] + 0.05 * rng.normal(size=(len(at), 3))).tolist()
    anchors = [Anchor(f"pit {c}", float(c), x, y, z, 0.05, 0.05) for c, (x, y, z) in zip(at, places, strict=True)]
    record = DASRecord(
        strain_rate=strain_rate.astype(float),
        time=np.arange(rows) / RATE,
        start=start,
        distance=np.asarray(SPACING * channel),
        channel=channel,
        gauge_length=GAUGE,
        channel_spacing=SPACING,
        sampling_rate=RATE,
        gaps=(),
        provenance={"files": [], "sha256": []},
    )
    return LongSurvey(record, trajectories, anchors, truth)


def written(survey: LongSurvey, folder: Path) -> Path:
    """The survey as a user would bring it: numpy record with its side file, tables, site.toml; returns the latter."""
    folder.mkdir()
    record = survey.record
    np.save(folder / "das.npy", record.strain_rate.astype(np.float32))
    side = f"start = {record.start}Z\nsampling_rate = {RATE}\nchannel_spacing = {SPACING}\ngauge_length = {GAUGE}\n"
    (folder / "das.toml").write_text(side + 'unit = "1/s"\n')
    survey.trajectories.to_parquet(folder / "trajectories.parquet")
    pd.DataFrame([asdict(anchor) for anchor in survey.anchors]).to_csv(folder / "anchors.csv", index=False)
    site = folder / "site.toml"
    site.write_text(
        '[frame]\norigin = [32.113, 34.804]\nx_azimuth = 78.0\n[das]\nfiles = ["das.npy"]\nquantity = "strain_rate"\n'
        '[trajectories]\nfiles = ["trajectories.parquet"]\n[anchors]\nfile = "anchors.csv"\n'
    )
    return site


def measured(site: Path, out: Path) -> None:
    """Locate in this process and print what it took as one line of JSON."""
    begun = time.perf_counter()
    located = locate(Survey.read(site))
    seconds, peak = time.perf_counter() - begun, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    cpu = time.process_time()
    result = located.result
    np.savez(out, channel=result.channel, route=result.route, sigma=result.sigma)
    facts: dict[str, Any] = {"seconds": seconds, "cpu seconds": cpu, "GB": peak / 1e6, "chi2/dof": result.chi2_per_dof}
    facts |= {
        "converged": result.converged,
        "held out": located.facts["held_out_chi2_per_dof"],
        "warnings": located.warnings,
    }
    print(json.dumps(facts | {f"{name} s": value for name, value in located.facts["timings"].items()}))


def row_of(kilometers: float, seed: int, options: argparse.Namespace) -> dict[str, Any]:
    """Make, locate and compare one survey."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        survey = made(kilometers, options.passes, options.snr, seed)
        site, truth = written(survey, folder / "survey"), survey.truth
        shape = survey.record.strain_rate.shape
        del survey
        command = [sys.executable, __file__, "--locate", str(site), "--out", str(folder / "route.npz")]
        ended = subprocess.run(command, check=True, capture_output=True, text=True)
        facts = json.loads(ended.stdout.splitlines()[-1])
        with np.load(folder / "route.npz") as found:
            here = np.isin(found["channel"], np.arange(len(truth)))
            error = found["route"][here] - truth[found["channel"][here]]
            z = error / found["sigma"][here]
    distance = np.linalg.norm(error, axis=1)
    row: dict[str, Any] = {"km": kilometers, "seed": seed, "samples": shape[0], "channels": shape[1]}
    row |= {"located": float(here.sum() / len(truth)), "mean error": float(distance.mean())}
    row |= {"largest error": float(distance.max()), "covered": float((np.abs(z) < Z95).mean())}
    for axis, name in enumerate(("along", "across", "depth")):
        row[f"{name} in sigmas"] = float(np.sqrt((z[:, axis] ** 2).mean()))
        row[f"{name} inside"] = float((np.abs(z[:, axis]) < Z95).mean())
    return row | facts


def main() -> None:
    """Locate every survey and print it, then the means of each length; with `--locate`, one survey only."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--lengths", nargs="+", type=float, default=[1.0, 2.5, 5.0, 10.0], help="km")
    parser.add_argument("--passes", type=int, default=50)
    parser.add_argument("--snr", type=float, default=15.0, help="dB")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--trials", type=int, default=1, help="surveys of each length")
    parser.add_argument("--locate", type=Path, help="a site.toml: locate it and say what that took")
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    if options.locate:
        measured(options.locate, options.out)
        return
    rows = []
    for kilometers in options.lengths:
        for seed in range(options.seed, options.seed + options.trials):
            rows.append(row_of(kilometers, seed, options))
            print(pd.DataFrame(rows[-1:]).drop(columns="warnings").round(3).T.to_string(header=False), flush=True)
    table = pd.DataFrame(rows).groupby("km")
    print(table.mean(numeric_only=True).drop(columns="seed").round(3).T.to_string())


if __name__ == "__main__":
    main()
