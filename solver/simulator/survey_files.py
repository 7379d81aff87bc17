"""Write a survey as a user would bring it, and the truth beside it."""

import dataclasses
import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solver.simulator.effects import EFFECTS, hidden
from solver.simulator.fiber_motion import arc_of, coiled
from solver.simulator.recorded_noise import color
from solver.simulator.scenario import Scenario
from solver.simulator.simulated_survey import Survey
from solver.survey.das.prodml import write_prodml
from vision.contract import InputError, require_writable, write_trajectories, writing

TRUTH = "truth.json"
FILE_LENGTH = 60.0  # s of record per DAS file

SITE = """\
# x along the road, y to the right of +x, z down; meters, UTC
name = {name}

[frame]
origin = [{latitude}, {longitude}]   # latitude, longitude of (0, 0)
x_azimuth = {x_azimuth}   # degrees clockwise from north

[das]
files = ["das/*.h5"]
gauge_length = {gauge_length}   # m
channel_spacing = {channel_spacing}   # m
quantity = "strain_rate"

{observed}

{anchors}[ground]
poisson_ratio = 0.25
depth = [0.9, 0.3]   # mean, sd; m
"""
ANCHORS = '[anchors]\nfile = "anchors.csv"\n\n'
CAMERA = """\
# what the camera sees; `roadfiber track` makes trajectories.csv of it (without [trajectories], `locate` does)
[camera]
video = "street.mp4"
calibration = "calibration.json"
start = {start}Z
detector = "street"  # made for renderings; leave this line out on a real street

[trajectories]
files = ["trajectories.csv"]"""
TRAJECTORIES = '[trajectories]\nfiles = ["trajectories.csv"]'


def write_survey(survey: Survey, folder: str | Path) -> Path:
    """Write `site.toml`, `das/*.h5` (PRODML), `trajectories.csv`, `anchors.csv` and `truth.json` into a new folder.

    Parameters
    ----------
    survey : what `simulate` returned
    folder : free, empty, or holding an earlier simulated survey, which is replaced

    Returns
    -------
    path of `site.toml`

    Raises
    ------
    InputError
        If there is something else at `folder`.
    """
    folder = Path(folder)
    require_free(folder)
    with writing(folder) as temporary:
        temporary.mkdir()
        write_recording(survey, temporary)
        text = site_text(survey.scenario, TRAJECTORIES, anchored=not survey.anchors.empty)
        (temporary / "site.toml").write_text(text, encoding="utf-8")
        _write_trajectories(survey, temporary / "trajectories.csv")
    return folder / "site.toml"


def write_recording(survey: Survey, folder: Path) -> None:
    """Write what does not depend on how the vehicles were observed: `das/*.h5`, `anchors.csv`, `truth.json`."""
    _write_das(survey, folder / "das")
    survey.anchors.round(4).to_csv(folder / "anchors.csv", index=False)
    (folder / TRUTH).write_text(json.dumps(truth(survey), indent=1) + "\n", encoding="utf-8")


def site_text(scenario: Scenario, observed: str, *, anchored: bool = True) -> str:
    """Compose `site.toml`; `observed` is `TRAJECTORIES` or `CAMERA`, how the vehicles were observed.

    `anchored` says whether there are anchors.

    >>> print(site_text(Scenario(), TRAJECTORIES).splitlines()[4])
    origin = [32.113, 34.804]   # latitude, longitude of (0, 0)
    """
    return SITE.format(
        name=json.dumps(scenario.name, ensure_ascii=False),
        latitude=scenario.origin[0],
        longitude=scenario.origin[1],
        x_azimuth=float(scenario.x_azimuth),
        gauge_length=float(scenario.gauge_length),
        channel_spacing=float(scenario.channel_spacing),
        observed=observed.format(start=scenario.start),
        anchors=ANCHORS if anchored else "",
    )


def require_free(folder: Path) -> None:
    """Raise InputError unless a folder can be written here: nothing, an empty folder or a simulated survey."""
    mine = folder.is_dir() and ((folder / TRUTH).is_file() or not any(folder.iterdir()))
    if folder.exists() and not mine:
        raise InputError(f"{folder}: is there already and no simulated survey; give another folder for --out")
    require_writable(folder)


def truth(survey: Survey) -> dict[str, Any]:
    """Everything the files hide, JSON-ready: the route, the noise, the vehicles, the hidden effects."""
    switches = hidden(survey.scenario.effects, survey.scenario.seed)
    return {
        "scenario": survey.scenario.name,
        "hidden_effect": " ".join(name for name in switches if name in EFFECTS) or "none",
        "switches": switches,
        "seed": survey.scenario.seed,
        "snr_db": survey.scenario.snr_db,
        "noise_sd": survey.noise_sd,
        "noise": color(survey.scenario)._asdict(),
        "passes": survey.scenario.passes,
        "poisson_ratio": survey.scenario.poisson_ratio,
        "shear_modulus": survey.scenario.shear_modulus,
        "view": list(survey.scenario.view),
        "active_channels": list(survey.active),
        "route_xyz": survey.route.round(4).tolist(),
        "laid": laid(survey),
        "vehicles": [dataclasses.asdict(vehicle) for vehicle in survey.vehicles],
    }


def laid(survey: Survey) -> dict[str, Any]:
    """How the fiber lies, JSON-ready: its shape, corners, steps in depth, riser, chambers and coil.

    `distance` is m along the fiber as the channels count it, `turn` degrees to the right as the fiber goes.
    """
    scenario, fiber = survey.scenario, survey.fiber
    light = np.arange(survey.distance[0], survey.distance[-1], 0.01)
    arc = arc_of(scenario, light, survey.distance)
    coil = light[coiled(scenario, light, survey.distance)]

    def there(at: int) -> dict[str, float]:
        x, y, z = fiber.points[at].round(3).tolist()
        return {"x": x, "y": y, "z": z, "distance": round(float(np.interp(fiber.arc[at], arc, light)), 2)}

    bends = [(there(b.at) | {"turn": round(b.turn, 2), "radius": round(b.radius, 3)}, b.upright) for b in fiber.bends]
    upright = [bend for bend, is_upright in bends if is_upright]
    return {
        "shape": scenario.laid if scenario.route is None else "points",
        "corners": [bend for bend, is_upright in bends if not is_upright],
        # A step is two bends: out of the level before it and into the next.
        "depth_steps": [{"from": a, "to": b} for a, b in zip(upright[::2], upright[1::2], strict=False)],
        "riser": upright[-1] if len(upright) % 2 else None,
        "chambers": [there(at) for at in fiber.chambers],
        "coil": {"length": scenario.effect("slack_spool"), "distance": round(float(coil[0]), 2)} if len(coil) else None,
    }


def _write_trajectories(survey: Survey, path: Path) -> None:
    table = survey.trajectories
    if not survey.scenario.gps:
        write_trajectories(table.round({"x": 4, "y": 4}), path)
        return
    stamps = table["time"].dt.strftime("%Y-%m-%dT%H:%M:%S.%fZ")
    table.assign(time=stamps).round({"latitude": 8, "longitude": 8}).to_csv(path, index=False)


def _write_das(survey: Survey, folder: Path) -> None:
    rows = max(1, round(FILE_LENGTH * survey.scenario.sampling_rate))
    folder.mkdir()
    for number, (first, end) in enumerate(_unbroken(~np.isnan(survey.strain_rate[:, 0]), rows), 1):
        write_prodml(
            folder / f"das_{number:04}.h5",
            survey.strain_rate[first:end],
            start=survey.start + np.timedelta64(round(survey.time[first] * 1e9), "ns"),
            sampling_rate=survey.scenario.sampling_rate,
            gauge_length=survey.scenario.gauge_length,
            channel_spacing=survey.scenario.channel_spacing,
            vendor="roadfiber simulate",
        )


def _unbroken(recorded: NDArray[np.bool_], rows: int) -> list[tuple[int, int]]:
    """First and end of every stretch of rows that were recorded, cut into equal parts of about `rows`.

    A single row is left out: a file of one sample has no rate.

    >>> _unbroken(np.array([True, True, False, True, True, True, True, False, True]), 2)
    [(0, 2), (3, 5), (5, 7)]
    """
    steps = np.flatnonzero(np.diff(recorded)) + 1
    whole = itertools.pairwise([0, *steps.tolist(), len(recorded)])
    found: list[tuple[int, int]] = []
    for first, end in whole:
        if recorded[first] and end - first > 1:
            cuts = np.linspace(first, end, max(1, round((end - first) / rows)) + 1).round().astype(int).tolist()
            found += itertools.pairwise(cuts)
    return found
