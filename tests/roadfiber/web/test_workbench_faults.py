"""What goes wrong on a bench loses nothing: the server is killed, two benches on one run, a run that is gone."""

import json
import shutil
import subprocess
import sys
import time

import pytest

import roadfiber as rf
from roadfiber.web import bench as module
from roadfiber.web.bench import Bench
from tests.roadfiber.web.told import Told

ROW = {"effect": "gauge_length", "told": {"title": "Gauge length"}, "evidence": 9.0, "delta_chi2": 30.0}
PATIENCE = 240.0

#: Adds an effect, and says so once the fit is under way; it never ends by itself.
ADDING = """
import sys, time
import roadfiber as rf
from roadfiber.web.bench import Bench

if __name__ == "__main__":
    bench = Bench(rf.open(sys.argv[1]))
    bench.add("gauge_length", "Gauge length")
    while not bench.job.fits:
        time.sleep(0.02)
    print("fitting", flush=True)
    time.sleep(3600)
"""


@pytest.fixture
def run(hidden, tmp_path):
    """A run folder with a diagnosis, so that nothing is scored."""
    folder = tmp_path / "runs" / "run"
    shutil.copytree(hidden, folder)
    (folder / "diagnosis.json").write_text(json.dumps({"candidates": [ROW]}))
    return folder


def names(folder):
    return sorted(path.name for path in folder.parent.iterdir())


def until(holds):
    """Wait until something holds."""
    end = time.monotonic() + PATIENCE
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.05)


def test_a_server_that_is_killed_while_it_adds_leaves_the_run_as_it_was(run, tmp_path):
    before = {path.name: path.read_bytes() for path in run.iterdir()}
    script = tmp_path / "adding.py"
    script.write_text(ADDING)
    with subprocess.Popen([sys.executable, script, run], stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout.readline() == "fitting\n"
        assert names(run) == ["run", "run-2"], "a folder is reserved"
        server.kill()
    until(lambda: names(run) == ["run"])
    assert {path.name: path.read_bytes() for path in run.iterdir()} == before


def test_two_benches_on_one_run_add_into_folders_of_their_own(run, monkeypatch):
    monkeypatch.setattr(module, "Worker", Told)
    one, other = Bench(rf.open(run)), Bench(rf.open(run))
    for bench in (one, other):
        bench.add("gauge_length", "Gauge length")
    assert [bench.adder.asked[0].given[3].name for bench in (one, other)] == ["run-2", "run-3"]
    one.adder.asked[0].failed("stopped")
    assert other.busy and "canceled; nothing was written" in one.messages[-1] and other.messages == []


def test_a_run_that_is_gone_is_said_and_the_rung_stays(run, monkeypatch):
    monkeypatch.setattr(module, "Worker", Told)
    bench = Bench(rf.open(run))
    shutil.rmtree(run.parent)
    bench.add("gauge_length", "Gauge length")
    assert bench.messages[-1].startswith("adding gauge length: not begun; ") and not bench.busy
    bench.looker.asked[-1].failed(f"{run}: no run folder")
    assert bench.messages[-1].endswith("no run folder") and bench.run.folder == run
