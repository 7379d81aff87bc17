"""Surveys whose answer is known."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from solver.simulator import Survey as Street
from solver.simulator import read_scenario, write_survey
from solver.simulator import simulate as simulate_street
from solver.simulator.drive_files import write_drive
from solver.simulator.drive_record import DriveRecord
from solver.simulator.drive_scenario import DriveScenario, read_drive
from solver.simulator.survey_files import CAMERA, require_free, site_text, write_recording
from vision.contract import InputError, writing


@dataclass(frozen=True)
class Simulated:
    """A simulated survey on disk.

    Parameters
    ----------
    site : its site.toml, to be read or located
    passes, channels : how many
    seconds : that the record lasts
    active_channels : first and last channel in view
    """

    site: Path
    passes: int
    channels: int
    seconds: float
    active_channels: tuple[int, int]

    @property
    def truth(self) -> Path:
        """truth.json, with all that the files hide."""
        return self.site.with_name("truth.json")

    def to_dict(self) -> dict[str, Any]:
        """What `roadfiber simulate --json` prints."""
        return asdict(self) | {"site": str(self.site), "active_channels": list(self.active_channels)}


def simulate(
    out: Path | str,
    scenario: Path | str = "street",
    *,
    effects: Mapping[str, float] | None = None,
    film: bool = False,
    **changes: Any,
) -> Simulated:
    """Simulate a survey: DAS files, trajectories, anchors, site.toml, and truth.json with all that they hide.

    Parameters
    ----------
    out : folder to write; an earlier simulated survey there is replaced
    scenario : a TOML file, or the name of a built-in one: `street`, or `street-` with `short`, `gps`, `paper` (point
        loads), `filtered`, `blind`, `filmed`; or `drive`, one car with GPS along kilometers of fiber and its map
    effects : to hide, by name, with their amounts (`solver.simulator.EFFECTS` lists them); in a drive
        `clock_drift`, `channel_stretch` and `gauge_length`
    film : render the street's camera in place of trajectories: `street.mp4` and the control points to calibrate it by;
        of `street-filmed`, whose vehicles drive where it looks
    **changes : further fields of `solver.simulator.Scenario`, such as seed, passes, snr_db, laid ("as-built" where the
        file does not say; "winding"); of a drive those of
        `solver.simulator.drive_scenario.DriveScenario`, such as seed, length, snr_db

    Raises
    ------
    InputError
        If the folder holds something else, or a field or effect is unknown or out of range.

    Examples
    --------
    >>> made = rf.simulate(folder / "street", passes=2, seed=3, effects={"gauge_length": 0.1})
    >>> made.passes, made.truth.name
    (2, 'truth.json')
    """
    drive = read_drive(scenario, effects=None if effects is None else dict(effects), **changes)
    if drive is not None:
        if film:
            raise InputError(f"{scenario}: a drive has no camera; its settings are {', '.join(vars(drive))}")
        return simulated_drive(drive, Path(out))
    wanted = read_scenario(scenario, effects=None if effects is None else dict(effects), **changes)
    folder = Path(out)
    require_free(folder)
    survey = simulate_street(wanted)
    site = write_filmed(survey, folder) if film else write_survey(survey, folder)
    first, last = survey.active
    seconds = round(float(survey.time[-1]), 1)
    return Simulated(site, len(survey.vehicles), len(survey.distance), seconds, (int(first), int(last)))


def write_filmed(survey: Street, folder: Path) -> Path:
    """Write a survey with a camera: `street.mp4`, `control_points.csv`, `das/*.h5`, `anchors.csv`, `site.toml`.

    Parameters
    ----------
    survey : what `solver.simulator.simulate` returned
    folder : free, empty, or holding an earlier simulated survey, which is replaced

    Returns
    -------
    path of `site.toml`
    """
    from vision.scene.film import Driver, film, street_scene

    require_free(folder)
    drivers = [Driver(v.vehicle_class, v.length, v.width, v.position, v.velocity) for v in survey.vehicles]
    seed = survey.scenario.seed
    with writing(folder) as temporary:
        temporary.mkdir()
        write_recording(survey, temporary)
        film(street_scene(drivers, seed), temporary, float(survey.time[-1]), seed)
        (temporary / "site.toml").write_text(site_text(survey.scenario, CAMERA), encoding="utf-8")
    return folder / "site.toml"


def simulated_drive(drive: DriveScenario, folder: Path) -> Simulated:
    """Simulate a drive into a folder."""
    shape, active = list[tuple[int, ...]](), list[int]()

    def note(record: DriveRecord) -> None:
        cable, distance = record.ground.cable, record.ground.distance
        inside = np.flatnonzero((distance > cable.cable[0]) & (distance < cable.cable[-1]))
        shape.append(record.rate.shape)
        active.extend((int(inside[0]), int(inside[-1])))

    site = write_drive(drive, folder, note)
    rows, channels = shape[0]
    return Simulated(site, 1, channels, round(rows / drive.sampling_rate, 1), (active[0], active[1]))
