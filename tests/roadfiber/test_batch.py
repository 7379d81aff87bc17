"""Many surveys as tasks of one graph: on two worker processes of which one is killed, and step by step."""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import psutil
import pytest
from distributed import KilledWorker
from typer.testing import CliRunner

import roadfiber as rf
from roadfiber import batch_cluster, batch_steps, batching
from roadfiber.batch_steps import DONE, FAILED, KEPT, LEFT, NOTHING, Job, Outcome, take
from roadfiber.command import app
from solver.run.seen import Seen
from tests.offline_pages import EVIL, is_offline, tells

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def sites(tmp_path_factory) -> Path:
    """Two surveys, and one whose site.toml has a wrong key."""
    folder = tmp_path_factory.mktemp("sites")
    small = {"view": (0.0, 30.0), "channels": 101, "passes": 3, "laid": "winding"}
    for number, name in enumerate(("broken", "east", "west")):
        rf.simulate(folder / name, "street-paper", seed=number, **small)
    site = folder / "broken" / "site.toml"
    site.write_text(site.read_text().replace("origin", "orign"))
    return folder


@pytest.fixture(scope="module")
def killed(sites) -> tuple[Path, int, dict]:
    """Run folders, exit status and JSON of a batch on two workers, of which one was killed while it located."""
    out = sites.parent / "runs"
    words = ["batch", *sorted(map(str, sites.iterdir())), "--out", out, "--workers", 2, "--steps", "ingest,locate"]
    words += ["--corridor", "fit"]
    command = [sys.executable, "-m", "roadfiber", "--quiet", *map(str, words), "--json"]
    environment = os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    with subprocess.Popen(command, stdout=subprocess.PIPE, env=environment, cwd=ROOT) as process:
        while not list(out.glob(".batch/*/ingest.json")) and process.poll() is None:
            time.sleep(0.05)
        workers = [
            one for one in psutil.Process(process.pid).children(recursive=True) if "spawn_main" in str(one.cmdline())
        ]
        assert len(workers) == 2
        os.kill(workers[0].pid, signal.SIGKILL)
        told, _ = process.communicate()
    return out, process.returncode, json.loads(told)


def test_a_lost_worker_and_a_bad_site_leave_the_others_as_serial_ones(killed, sites):
    out, status, told = killed
    assert status == 1 and told["failed"] == ["broken"]
    assert told["headline"] == "3 sites: 2 done, 1 failed"
    steps = {(one["site"], one["step"]): one for one in told["steps"]}
    assert "unknown key orign in [frame]; did you mean origin?" in steps["broken", "ingest"]["words"]
    assert steps["broken", "locate"]["status"] == LEFT and not (out / "broken").exists()
    assert [steps[name, "locate"]["status"] for name in ("east", "west")] == [DONE, DONE]
    assert steps["west", "ingest"]["facts"]["raw_bytes"] > 0 and steps["west", "locate"]["facts"]["passes"] == 3
    serial = rf.locate(sites / "east", corridor="fit").result
    assert not rf.open(out / "east").facts["corridor"]["full"]
    np.testing.assert_allclose(rf.open(out / "east").result.route, serial.route, rtol=0, atol=1e-9)


def test_what_is_done_and_unchanged_is_not_done_again(killed, sites):
    """In this process: the tasks are those that workers run."""
    out, _, _ = killed
    (job,) = batching.jobs_of([sites / "west"], out, ["ingest", "locate"], "fit")
    written = (out / "west" / "fit.json").stat().st_mtime_ns
    kept = [take(job, name, ()) for name in job.steps]
    assert [one.status for one in kept] == [KEPT, KEPT] and "left of the survey line" in kept[1].words
    assert (out / "west" / "fit.json").stat().st_mtime_ns == written
    stamp = job.state / "locate.json"
    said = json.loads(stamp.read_text())
    anchors = sites / "west" / "anchors.csv"
    os.utime(anchors)
    site = job.read()
    assert batch_steps.STEPS["locate"].inputs(job, site) != said["inputs"]
    assert (
        batch_steps.STEPS["ingest"].inputs(job, site) == json.loads((job.state / "ingest.json").read_text())["inputs"]
    )
    assert batch_steps.STEPS["locate"].inputs(replace(job, corridor="full"), site) != batch_steps.STEPS[
        "locate"
    ].inputs(job, site)
    # A run folder that another command wrote since, or that is gone, is not kept either.
    step, fit = batch_steps.STEPS["locate"], out / "west" / "fit.json"
    assert batch_steps.is_kept(job, site, step, said, said["inputs"])
    os.utime(fit)
    assert not batch_steps.is_kept(job, site, step, said, said["inputs"])
    stamp.write_text("{")
    assert batch_steps.read_stamp(job, "locate") == {}


def test_a_run_is_diagnosed_once(killed, sites, monkeypatch):
    out, _, _ = killed
    found = SimpleNamespace(verdict="adequate", headline="Nothing is missing.", effect=None)
    found.save = lambda folder: (folder / "diagnosis.json").write_text("{}")
    monkeypatch.setattr("roadfiber.diagnosing.diagnose", lambda run: found)
    (job,) = batching.jobs_of([sites / "east"], out, ["diagnose"])
    assert take(job, "diagnose", ()).words == "adequate: Nothing is missing."
    assert take(job, "diagnose", ()).status == KEPT
    # A fiber too long to be diagnosed as one leaves another file.
    monkeypatch.setattr(Seen, "too_long", "too long")
    monkeypatch.setattr("roadfiber.stretching.diagnose_stretches", lambda run: found)
    found.save = lambda folder: (folder / "stretches.json").write_text("{}")
    (out / "east" / "diagnosis.json").unlink()
    assert [take(job, "diagnose", ()).status for _ in range(2)] == [DONE, KEPT]
    (job,) = batching.jobs_of([sites / "east"], out / "elsewhere", ["diagnose"])
    one = take(job, "diagnose", ())
    assert (one.status, one.words.partition(": ")[2]) == (FAILED, "no run to diagnose; name locate among the steps")


def test_a_video_is_tracked_once_and_the_route_made_from_its_tracks(sites, tmp_path, monkeypatch):
    """Tracks come back from their files as they were."""
    folder = tmp_path / "filmed"
    rf.simulate(folder, "street-paper", seed=4, view=(0.0, 30.0), channels=101, passes=2)
    site = folder / "site.toml"
    trajectories = rf.read(site).tracks
    (folder / "street.mp4").write_bytes(b"video")
    (folder / "calibration.json").write_text("{}")
    camera = '[camera]\nvideo = "street.mp4"\ncalibration = "calibration.json"\nstart = 2025-08-11T06:00:00Z\n'
    text = site.read_text()
    begin = text.index("[trajectories]")
    site.write_text(text[:begin] + camera + text[text.index("\n[", begin) :])
    seen = list[rf.Run]()
    tracked = SimpleNamespace(table=trajectories, dropped=trajectories[:3], placed="3 not placed")
    tracked.facts = {"tracks": 2, "frames": 99}
    calls = []
    monkeypatch.setattr("roadfiber.locating.followed", lambda camera: calls.append(camera) or tracked)
    monkeypatch.setattr("roadfiber.locating.scene_of", lambda survey: None)

    def fit(survey, **settings):
        pd.testing.assert_frame_equal(survey.tracks, trajectories)
        seen.append(survey.cautions)
        raise rf.InputError("far enough")

    monkeypatch.setattr("roadfiber.locating.locate_fiber", fit)
    (job,) = batching.jobs_of([folder], tmp_path / "out", ["track", "locate"])
    first = take(job, "track", ())
    assert (first.status, first.words) == (DONE, "2 vehicles in 99 frames")
    assert take(job, "track", ()).status == KEPT and len(calls) == 1
    assert take(job, "locate", [first]).words == "far enough" and seen == [("3 not placed",)]
    listed = batching.jobs_of([sites / "west"], tmp_path / "out", ["track"])[0]
    assert take(listed, "track", ()).status == NOTHING


def test_what_may_pass_is_tried_again_and_what_will_not_is_told(tmp_path, monkeypatch):
    job = Job(tmp_path / "site.toml", tmp_path, "a", ("ingest",))

    def failing(error):
        def fail(job, name):
            raise error

        monkeypatch.setattr(batch_steps, "taken", fail)

    failing(OSError(5, "Input/output error"))
    with pytest.raises(OSError, match="Input/output"):
        take(job, "ingest", ())
    failing(ZeroDivisionError("by nothing"))
    assert take(job, "ingest", ()).words == "ZeroDivisionError: by nothing"
    assert take(job, "ingest", [Outcome("a", "track", FAILED)]).status == LEFT


def test_a_task_that_was_given_up_is_told(tmp_path):
    job = Job(tmp_path / "site.toml", tmp_path, "a", ("ingest", "locate"))
    lost = KilledWorker("ingest", SimpleNamespace(address="tcp://a"), 3)
    asked = {
        (job, "ingest"): SimpleNamespace(status="error", exception=lambda: lost),
        (job, "locate"): SimpleNamespace(status="error", exception=lambda: lost),
    }
    done = batching.Batch(tuple(batching.outcomes(asked)), tmp_path)
    assert [one.status for one in done.outcomes] == [FAILED, LEFT]
    assert done.failed == ["a"] and done.headline == "1 sites: 1 failed"
    assert "its worker was lost at every try" in repr(done) and "worker was lost" in done._repr_html_()


def test_in_a_notebook_names_and_words_are_text_and_whole(tmp_path):
    long = f"{EVIL} and more words than a table of pandas shows by itself, to their end"
    told = batching.Batch((Outcome(EVIL, "locate", FAILED, long),), tmp_path)._repr_html_()
    assert tells(told) and is_offline(told) and "to their end" in told


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["nowhere", "--steps", "locate,dig"], "steps dig; give some of ingest, track, locate, diagnose"),
        (["a/site.toml", "b/a/site.toml"], "would share"),
        (["a", "--workers", "0"], "workers 0; give 1 or more"),
        (["a", "--workers", "2", "--scheduler", "tcp://127.0.0.1:9"], "or a scheduler in their place"),
        (["a", "--scheduler", "tcp://127.0.0.1:9"], "tcp://127.0.0.1:9: no scheduler answers; give an address as"),
    ],
)
def test_what_cannot_be_begun_is_one_line(tmp_path, monkeypatch, words, message):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(batch_cluster, "PATIENCE", 0.5)
    told = CliRunner().invoke(app, ["batch", *words])
    assert isinstance(told.exception, rf.InputError) and message in str(told.exception)
    assert list(tmp_path.iterdir()) == []


def test_without_dask_it_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(rf.InputError, match=r"batch needs Dask distributed; pip install 'roadfiber\[cluster\]'"):
        rf.batch([tmp_path], tmp_path / "runs")


def test_workers_of_another_version_are_refused():
    client = SimpleNamespace(wait_for_workers=lambda count, timeout: None, run=lambda f, name: {"tcp://b": "9.9"})
    with pytest.raises(
        rf.InputError, match=r"tcp://a: worker tcp://b has roadfiber 9.9, here it is .*; install one version"
    ):
        batch_cluster.require_alike(client, "tcp://a")
    client.run = lambda f, name: {}
    with pytest.raises(rf.InputError, match="has no workers; start some with `dask worker tcp://a"):
        batch_cluster.require_alike(client, "tcp://a")
