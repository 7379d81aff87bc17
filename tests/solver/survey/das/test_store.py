"""A store holds what reading the files gives, through kills, full disks and damaged files."""

import csv
import json
import logging
import os
import resource
import signal
import subprocess
import sys
import time
import warnings

import h5py
import numpy as np
import pytest

from solver.survey.das import ingest as ingesting
from solver.survey.das.description import describe
from solver.survey.das.ingest import ingest
from solver.survey.das.opened import Raw, opened
from solver.survey.das.prodml import write_prodml
from solver.survey.das.reader import record_from
from solver.survey.das.store import CHANNELS, FILES, Store, part_name
from solver.survey.das.units import dascore
from vision.contract import InputError

START = np.datetime64("2025-08-11T06:00:00", "ns")
RATE, ROWS, CHANNEL = 100.0, 1000, 40


def das_file(folder, part, seed=0, **changes):
    rate = np.random.default_rng(seed + part).normal(0, 1e-8, (ROWS, CHANNEL))
    start = START + np.timedelta64(part * ROWS * 10, "ms")
    setting = {"sampling_rate": RATE, "gauge_length": 10.0, "channel_spacing": 1.02, "first_channel": 7} | changes
    write_prodml(folder / f"{part}.h5", rate, start=start, **setting)
    return folder / f"{part}.h5"


@pytest.fixture
def files(tmp_path):
    (tmp_path / "das").mkdir()
    return [das_file(tmp_path / "das", part) for part in (0, 1, 2, 4)]


@pytest.fixture(autouse=True)
def small_parts(monkeypatch):
    monkeypatch.setattr(ingesting, "BYTES", 0)
    monkeypatch.setattr(ingesting, "FEWEST", 100)


def tables(folder):
    return [list(csv.DictReader((folder / name).read_text().splitlines())) for name in (CHANNELS, FILES)]


def same(found, wanted):
    assert (found.start, found.gauge_length, found.sampling_rate) == (
        wanted.start,
        wanted.gauge_length,
        wanted.sampling_rate,
    )
    assert np.array_equal(found.channel, wanted.channel)
    assert np.allclose(found.distance, wanted.distance)
    count = len(found.time)
    assert 0 <= len(wanted.time) - count <= 10
    assert np.allclose(found.strain_rate, wanted.strain_rate[:count], rtol=0, atol=1e-13, equal_nan=True)
    assert not np.isfinite(wanted.strain_rate[count:]).any()


def test_a_store_holds_what_reading_gives(files, tmp_path):
    known = describe(files)
    store = ingest(known, files, {}, tmp_path / "store")
    whole = record_from(known, rate=20.0)
    same(store.record(), whole)
    assert store.record().gaps == pytest.approx(np.array(whole.gaps))
    assert store.record().cautions == whole.cautions
    assert store.record().provenance["decimated"] == "from 100 Hz by 5"
    second = np.timedelta64(1, "s")
    part = {"channels": (12, 30), "times": [(START + 5 * second, START + 9 * second), (START + 42 * second, store.end)]}
    same(store.record(**part), record_from(known, rate=20.0, **part))
    assert store.record(**part).recorded.channels == (7, 46)
    channels, held = tables(tmp_path / "store")
    assert [int(row["channel"]) for row in channels] == list(range(7, 47))
    # What passes the filter of a tenth of the band.
    assert np.median([float(row["noise"]) for row in channels]) == pytest.approx(1e-8 * 0.18**0.5, rel=0.1)
    assert [(row["file"], row["seconds_used"]) for row in held] == [(f"{n}.h5", "10.000") for n in (0, 1, 2, 4)]


def test_others_open_it(files, tmp_path):
    store = ingest(describe(files), files, {}, tmp_path / "store")
    record = store.record()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the index that DASCore makes through pandas
        patches = dascore().spool(tmp_path / "store").update().chunk(time=None)
    assert [round(float(one.get_array("time").size)) for one in patches] == [580, 180]
    patch = patches[0].transpose("time", "distance")
    assert np.allclose(1e-9 * patch.data, record.strain_rate[10:590], rtol=1e-5)
    assert patch.attrs.gauge_length == 10.0
    with h5py.File(tmp_path / "store" / part_name(store.said.parts[0])) as file:
        data = file["Acquisition/Raw[0]/RawData"]
        assert [data.dims[axis][0].name.rpartition("/")[2] for axis in (0, 1)] == ["RawDataTime", "distance"]
        assert data.dims[0][0].attrs["units"] == "microseconds since 1970-01-01"
        assert np.allclose(data.dims[1][0][:], record.distance)


def test_xarray_opens_a_part(files, tmp_path):
    xarray = pytest.importorskip("xarray", reason="xarray is not installed")
    pytest.importorskip("h5netcdf", reason="h5netcdf is not installed")
    store = ingest(describe(files), files, {}, tmp_path / "store")
    path = tmp_path / "store" / part_name(store.said.parts[0])
    with xarray.open_dataset(path, engine="h5netcdf", group="Acquisition/Raw[0]") as found:
        assert found["RawData"].dims == ("RawDataTime", "distance")
        assert found["RawDataTime"].values[0] == START + np.timedelta64(500, "ms")


KILLED = """
import sys
from pathlib import Path
from solver.survey.das import ingest as ingesting
from solver.survey.das.description import describe
ingesting.BYTES, ingesting.FEWEST = 0, 20
files = sorted(Path(sys.argv[1]).glob("*.h5"))
ingesting.ingest(describe(files), files, {}, Path(sys.argv[2]))
"""


def test_a_killed_run_is_gone_on_with(files, tmp_path, monkeypatch):
    monkeypatch.setattr(ingesting, "FEWEST", 20)
    folder = tmp_path / "store"
    child = subprocess.Popen([sys.executable, "-c", KILLED, str(files[0].parent), str(folder)])
    while child.poll() is None and len(list(folder.glob("part-*.h5"))) < 9:
        time.sleep(0.002)
    os.kill(child.pid, signal.SIGKILL)
    assert child.wait() == -signal.SIGKILL
    with pytest.raises(InputError, match="the store is not complete; run roadfiber ingest again"):
        Store.open(folder)
    # Every part that is there is whole, and is left alone.
    kept = {path.name: path.stat().st_mtime_ns for path in folder.glob("part-*.h5")}
    assert len(kept) >= 9
    for name in kept:
        with h5py.File(folder / name) as file:
            assert np.isfinite(file["Acquisition/Raw[0]/RawData"][:]).all()
    (folder / ".part-000000010-000000030.h5.killed").mkdir()
    known = describe(files)
    same(ingest(known, files, {}, folder).record(), record_from(known, rate=20.0))
    assert {name: (folder / name).stat().st_mtime_ns for name in kept} == kept
    assert not list(folder.glob(".part*"))


AT_ANY_INSTANT = """
import os, shutil, signal, sys
import numpy as np
from pathlib import Path
from solver.survey.das import ingest as ingesting
from solver.survey.das.description import describe
ingesting.BYTES, ingesting.FEWEST = 0, 800
CHANGES = {"open", "os.rename", "os.remove", "os.mkdir", "os.rmdir", "shutil.rmtree"}
files, folder = sorted(Path(sys.argv[1]).glob("*.h5")), Path(sys.argv[2])
known = describe(files)

def content():
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.name.endswith(".csv")} | {
        path.name: path.stat().st_size for path in folder.glob("part-*.h5")
    }

def killed_at(number):
    seen = 0
    def hook(event, arguments):
        nonlocal seen
        if event in CHANGES and str(folder) in str(arguments[0]):
            seen += 1
            if seen == number:
                os.kill(os.getpid(), signal.SIGKILL)
    sys.addaudithook(hook)

whole = ingesting.ingest(known, files, {}, folder).record().strain_rate
wanted = content()
kills = 0
while True:
    shutil.rmtree(folder)
    child = os.fork()
    if not child:
        killed_at(kills + 1)
        ingesting.ingest(known, files, {}, folder)
        os._exit(0)
    if os.waitpid(child, 0)[1] == 0:
        break
    kills += 1
    found = ingesting.ingest(known, files, {}, folder).record().strain_rate
    assert np.array_equal(found, whole, equal_nan=True) and content() == wanted, kills
    assert not [path for path in folder.iterdir() if path.name.startswith(".")], kills
print(kills)
"""


def test_a_run_that_is_killed_before_any_change_on_the_disk_is_gone_on_with(files, tmp_path):
    words = [sys.executable, "-c", AT_ANY_INSTANT, str(files[0].parent), str(tmp_path / "store")]
    ended = subprocess.run(words, capture_output=True, text=True, check=False)
    assert not ended.returncode, ended.stderr
    # Five files, each in a folder of its own that is made, renamed from, and removed.
    assert int(ended.stdout) >= 15


def test_a_full_disk_ends_it_in_a_line_and_it_goes_on_later(files, tmp_path):
    folder = tmp_path / "store"
    known = describe(files)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (15_000, before[1]))
    try:
        with pytest.raises(InputError, match="no space left to write it; make room, or write elsewhere") as caught:
            ingest(known, files, {}, folder)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert "\n" not in str(caught.value)
    assert not list(folder.glob("part-*.h5")) and not list(folder.glob(".part*"))
    same(ingest(known, files, {}, folder).record(), record_from(known, rate=20.0))


def test_files_and_settings_that_changed_make_it_stale(files, tmp_path, caplog):
    folder = tmp_path / "store"
    said = {"exclude": [9]}
    ingest(describe(files, **said), files, said, folder)
    assert isinstance(opened(files, said, folder), Store)
    os.utime(files[1])  # copied with another time, the same content
    assert isinstance(opened(files, said, folder), Store)
    parts = {path: path.stat().st_mtime_ns for path in folder.glob("part-*.h5")}
    ingest(describe(files, **said), files, said, folder)
    assert {path: path.stat().st_mtime_ns for path in folder.glob("part-*.h5")} == parts
    for change, why in (
        (lambda: (files, {"exclude": [9, 10]}), "[das] of site.toml changed since it was made"),
        (lambda: (files[:3], said), "there are other DAS files since it was made"),
        (lambda: (das_file(files[1].parent, 1, seed=50), (files, said))[1], "1.h5 changed since it was made"),
    ):
        with caplog.at_level(logging.WARNING):
            assert isinstance(opened(*change(), folder), Raw)
        assert why in caplog.text and "the DAS files are read instead" in caplog.text
    # Ingesting again makes it of the files there are.
    known = describe(files, **said)
    same(ingest(known, files, said, folder).record(), record_from(known, rate=20.0))
    assert isinstance(opened(files, said, folder), Store)


def test_the_health_tables_say_what_is_left_out_and_why(files, tmp_path):
    folder = tmp_path / "das"
    (folder / "2.h5").write_bytes(b"")
    with h5py.File(folder / "1.h5", "r+") as file:
        values = file["Acquisition/Raw[0]/RawData"]
        values[300:310, 5] = np.nan
    for path in files[:2] + files[3:]:
        with h5py.File(path, "r+") as file:
            file["Acquisition/Raw[0]/RawData"][:, 20] = 4.0
    store = ingest(describe(files), files, {}, tmp_path / "store")
    record = store.record()
    assert record.dead.nonzero()[0].tolist() == [20]
    spoilt = ~np.isfinite(record.strain_rate[:, 5]) & record.measured
    assert spoilt.sum() == 22  # Of ten samples, and of as many as the filter reaches on either side.
    channels, held = tables(tmp_path / "store")
    assert [(row["channel"], row["bad"]) for row in channels if row["bad"] != "0"] == [("12", "10")]
    assert [row["channel"] for row in channels if row["dead"] == "1"] == ["27"]
    assert {row["file"]: row["left_out"] for row in held if row["left_out"]} == {
        "2.h5": "an empty file, 0 bytes; copy it again"
    }
    assert record.cautions[0] == "of 4 files this is left out: 2.h5 (an empty file, 0 bytes; copy it again)"
    assert record.cautions[1].startswith("no number, one and the same, or a straight line for a while on channel 12:")
    assert "gap of 20.0 s" in record.cautions[2]


def test_rounding_and_clipping_are_known(tmp_path):
    values = np.clip(np.rint(np.random.default_rng(0).normal(0, 300, (3000, 12))), -700, 700).astype(np.int16)
    np.save(tmp_path / "a.npy", values)
    side = {"start": f"{START}Z", "sampling_rate": 100.0, "channel_spacing": 1.0, "gauge_length": 4.0}
    (tmp_path / "a.json").write_text(json.dumps(side))
    known = describe([tmp_path / "a.npy"], quantity="strain_rate", scale=1e-11)
    found = ingest(known, [tmp_path / "a.npy"], {}, tmp_path / "store").record()
    wanted = record_from(known, rate=20.0)
    assert np.allclose(found.rounding.step, wanted.rounding.step)
    assert np.allclose(found.rounding.law, wanted.rounding.law)
    assert found.cautions[0].split(" ", 1)[1] == wanted.cautions[0].split(" ", 1)[1]


def test_a_folder_of_something_else_is_left_alone(files, tmp_path):
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "thesis.txt").write_text("years of work")
    with pytest.raises(InputError, match="holds something that is not a store; name another folder"):
        ingest(describe(files), files, {}, tmp_path / "other")
    assert [path.name for path in (tmp_path / "other").iterdir()] == ["thesis.txt"]


def test_a_damaged_store_is_not_trusted(files, tmp_path, caplog):
    folder = tmp_path / "store"
    store = ingest(describe(files), files, {}, folder)
    path = folder / part_name(store.said.parts[1])
    path.write_bytes(path.read_bytes()[:2000])
    with pytest.raises(InputError, match=r"part-.*: cannot be read .*; run roadfiber ingest again"):
        Store.open(folder).record()
    (folder / "store.json").write_text("{}")
    assert isinstance(opened(files, {}, folder), Raw)
    assert "store.json: format: field required; remove it and run roadfiber ingest" in caplog.text
