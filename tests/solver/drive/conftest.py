"""A short drive, simulated and located once."""

import json
from pathlib import Path
from typing import Any

import pytest

import roadfiber as rf

#: 1.5 km of road, a U-turn, loops, traffic; at a low rate, which is all that the fit takes.
SHORT = {"length": 1500.0, "sampling_rate": 10.0, "snr_db": 12.0, "traffic": 40.0, "loops_per_km": 2.0, "seed": 3}


@pytest.fixture(scope="session")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = rf.simulate(tmp_path_factory.mktemp("drives") / "short", "drive", **SHORT).site
    with (path.parent / "gps.csv").open("a") as table:  # of a receiver without a fix
        table.write("2025-08-11T05:00:00Z,gps,car,0,0,2.14\n")
    return path


@pytest.fixture(scope="session")
def truth(site: Path) -> dict[str, Any]:
    return json.loads((site.parent / "truth.json").read_text())


@pytest.fixture(scope="session")
def drive(site: Path) -> rf.Drive:
    return rf.read(site)


@pytest.fixture(scope="session")
def run(drive: rf.Drive) -> rf.DriveRun:
    return rf.locate(drive)
