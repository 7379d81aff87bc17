"""A run whose gauges are longer than told, with names that are markup."""

import shutil
from pathlib import Path
from typing import Any

import pytest

import roadfiber as rf
from tests.roadfiber.web.told import Told

#: A name that would show if it were not escaped.
MARKUP = "<i id='injected'>9</i>"


@pytest.fixture(scope="session")
def hidden(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The run folder."""
    folder = tmp_path_factory.mktemp("hidden")
    small = {"view": (0.0, 40.0), "channels": 121, "passes": 4, "seed": 3, "laid": "winding"}
    site = rf.simulate(folder / "survey", "street", effects={"gauge_length": 0.15}, **small).site
    text = site.read_text().replace('name = "street"', f'name = "Elm {MARKUP}"')
    assert MARKUP in text
    site.write_text(text)
    tracks = folder / "survey" / "trajectories.csv"
    header, *rows = tracks.read_text().splitlines()
    first = rows[0].split(",")[1]
    renamed = [",".join([a, MARKUP if b == first else b, *more]) for a, b, *more in (row.split(",") for row in rows)]
    tracks.write_text("\n".join([header, *renamed]) + "\n")
    rf.locate(site, corridor="fit").save(folder / "run")
    return folder / "run"


@pytest.fixture
def bench(hidden: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """A bench on a run folder of its own, with workers that answer as they are told."""
    from roadfiber.web import bench as module

    monkeypatch.setattr(module, "Worker", Told)
    shutil.copytree(hidden, tmp_path / "run")
    return module.Bench(rf.open(tmp_path / "run"))
