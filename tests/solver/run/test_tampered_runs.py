"""A run folder that somebody changed: whatever was done to one thing in it, commands refuse in one line."""

import io
import json
import shutil
import subprocess
import sys
import tracemalloc
import zipfile
from copy import deepcopy
from itertools import cycle
from pathlib import Path

import numpy as np
import pytest
from test_run_is_data import COMMANDS, command

from solver.run.arrays import EXPECTED, SMALL, check_sizes
from solver.run.folder import read_run
from solver.run.read_stored import printable
from solver.run.run import run_of
from solver.run.stored import FitFile
from vision.contract import InputError

#: Parts of fit.json whose keys are names that anything may have.
OPEN = ("parameters", "timings", "versions", "record")
names = cycle(COMMANDS)


@pytest.fixture(scope="module")
def whole(survey, tmp_path_factory) -> Path:
    """A run as it was written, with a warning, a plugin and a coil in its facts, so that every key is there."""
    folder = tmp_path_factory.mktemp("whole") / "run"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("solver.run.report.report_page.render", lambda run: "<!doctype html>")
        run_of(survey.result, **survey.arguments, warnings=["a line"], disputed=["another"]).save(folder)
    facts = json.loads((folder / "fit.json").read_text())
    facts["plugins"] = [{"file": "mine.py", "sha256": "ab" * 32, "effects": ["grip"], "text": "x = 1\n"}]
    facts["problem"]["coil"] = dict.fromkeys(("place", "length", "origin", "slope", "lateral", "depth"), 1.0)
    facts["settings"]["gaps"] = [[1.0, 2.0]]
    facts["effects"] = ["wheel_layout"]
    narrower = {"route": 0.1}
    taken = {"track_id": "1", "vehicle_class": "car", "speed": 9.0, "lane": 1.0, "narrower": narrower}
    missing = {"kind": "toward -x", "narrower": narrower}
    facts["choice"] = {"of": 9, "tested": 2, "taken": [taken], "missing": [missing]}
    (folder / "fit.json").write_text(json.dumps(facts))
    read_run(folder)
    return folder


@pytest.fixture
def run(whole, tmp_path) -> Path:
    return shutil.copytree(whole, tmp_path / "run")


def refused(run: Path, *, by: str | None = None) -> str:
    """What a command says, which must be a refusal that names the run's folder and changes nothing there."""
    before = {path.name: path.stat().st_mtime_ns for path in run.iterdir()}
    said = command(by or next(names), run)
    assert said.startswith(f"refused: {run}"), said
    assert len(said) < 600 and all(letter.isprintable() for letter in said)
    assert {path.name: path.stat().st_mtime_ns for path in run.iterdir()} == before
    return said


def places(value, at: tuple = ()):
    """Paths to every key of fit.json, and into the first element of what has any number of them."""
    keys = list(value) if isinstance(value, dict) else [0] if isinstance(value, list) and value else []
    for key in keys[:1] if at[:1] and at[0] in OPEN and len(at) == 1 else keys:
        yield (*at, key)
        yield from places(value[key], (*at, key))


@pytest.mark.parametrize("key", FitFile.model_fields)
def test_every_key_of_fit_json_is_checked(run, key):
    """Each key below it is left out, and given values of other types."""
    path = run / "fit.json"
    facts = json.loads(path.read_text())
    for place in [(key,), *places(facts[key], (key,))]:
        for wrong in ({"x": {"y": 1}}, "delete", [[]], "\x1b[2J", float("nan"), -1e400, True, None):
            if place == ("choice",) and wrong in ("delete", None):
                continue  # a run of all its passes has none
            if place == ("problem", "windows") and wrong == "delete":
                continue  # then the record is one window
            changed = deepcopy(facts)
            holder = changed
            for part in place[:-1]:
                holder = holder[part]
            now = holder[place[-1]]
            if wrong == "delete":
                del holder[place[-1]]
            else:
                holder[place[-1]] = wrong
            path.write_text(json.dumps(changed))
            if acceptable(place, now, wrong):
                read_run(run)
            elif isinstance(wrong, dict):
                refused(run)
            else:
                with pytest.raises(InputError) as caught:
                    read_run(run)
                assert str(caught.value).isprintable() and len(str(caught.value)) < 600


def acceptable(place: tuple, now, wrong) -> bool:
    """Whether a value may stand there: null where a number may be unknown, free text in the name, the plugin's text."""
    if wrong == "delete":
        a_pair = isinstance(now, int | float)
        return (isinstance(place[-1], int) and not a_pair) or (place[0] in OPEN and len(place) == 2)
    if place[0] == "record" and len(place) == 2:
        return wrong is None or wrong is True
    if wrong is None:
        unknown = ("value", "sigma", "chi2", "chi2_per_dof", "cost", "noise_floor", "held_out_chi2_per_dof", "coil")
        unknown += ("half_width", "half_width_fit", "shared")
        return place[-1] in (*unknown, "found", "expected", "scatter", "taken_up")
    if wrong is True:
        return isinstance(now, bool)
    return wrong == "\x1b[2J" and place in (("name",), ("plugins", 0, "text"))


@pytest.mark.parametrize(
    ("part", "key", "value"),
    [
        ("problem", "sampling_rate", 0.011),
        ("problem", "sampling_rate", 5e-9),
        ("problem", "knots", [10.0, 10.0]),
        ("problem", "gauge_length", 9e3),
        ("problem", "channel_spacing", 0),
        ("problem", "added", ["grip", "grip"]),
        ("problem", "added", ["x" * 100000]),
        ("frame", "origin", [200.0, 0.0]),
        ("settings", "poisson_ratio", 0.5),
        ("anchors", 0, {"name": "a", "channel": 1e7, "x": 0.0, "y": 0.0, "z": 1.0, "sigma_xy": 1.0, "sigma_z": 1.0}),
        (None, "start", "2025-99-11T06:00:00Z"),
        (None, "more", 1),
        (None, "active_channels", [-3_000_000_000, 7]),
        (None, "iterations", 10**30),
    ],
)
def test_numbers_that_cannot_be_are_refused(run, part, key, value):
    """And those that contradict the arrays, of which a fit would make tables of any size."""
    facts = json.loads((run / "fit.json").read_text())
    (facts if part is None else facts[part])[key] = value
    (run / "fit.json").write_text(json.dumps(facts))
    refused(run)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\xff\xfe",
        b"[" * 100000,
        b'{"a":' * 100000,
        b"null",
        b'"x"',
        b"\x00" * 9,
        b'{"format": "roadfiber run 1"}',
    ],
)
def test_json_that_is_none_is_refused(run, content):
    (run / "fit.json").write_bytes(content)
    for name in COMMANDS:
        refused(run, by=name)


def test_a_run_of_another_version_says_what_to_do(run):
    facts = json.loads((run / "fit.json").read_text())
    for written, wanted in (
        ("roadfiber run 4", "run `roadfiber locate` on its survey again"),
        ("roadfiber run 6", "update roadfiber to open it"),
    ):
        (run / "fit.json").write_text(json.dumps(facts | {"format": written}))
        assert f'roadfiber (format "{written}"); {wanted}' in refused(run)
    (run / "fit.json").write_text(json.dumps(facts | {"format": "a letter"}))
    assert refused(run).endswith("give a folder that `roadfiber locate` wrote")


def test_a_tampered_law_of_noise_is_one_line_and_exit_code_2(run):
    """Through the program itself, without a word of Python's."""
    np.savez(run / "data.npz", **changed("law_hidden", 0, 1.5)(arrays_of(run)))
    done = subprocess.run(
        [sys.executable, "-m", "roadfiber", "ladder", run], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout) == (2, "")
    assert len(done.stderr.splitlines()) == 1, done.stderr
    assert "law_hidden is more than all noise" in done.stderr


def test_a_huge_or_strange_fit_json_is_not_read(run, monkeypatch):
    monkeypatch.setattr("solver.run.read_stored.LARGEST", 1000)
    assert "over" in refused(run)
    (run / "fit.json").unlink()
    (run / "fit.json").symlink_to("/dev/zero")
    assert "no run folder" in refused(run)


def arrays_of(run: Path) -> dict[str, np.ndarray]:
    with np.load(run / "data.npz") as file:
        return {name: file[name] for name in file.files}


def claimed(descr: str, shape: str) -> bytes:
    """An array's file that says much and holds nothing."""
    stream = io.BytesIO()
    np.save(stream, np.zeros(0))
    header = f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}".encode()
    return stream.getvalue()[:6] + b"\x01\x00" + len(header + b"\n").to_bytes(2, "little") + header + b"\n" + bytes(64)


@pytest.mark.parametrize("name", EXPECTED)
def test_every_array_is_checked(run, name):
    """Each is left out, given objects, another type, shape or length, and said to be huge."""
    arrays = arrays_of(run)
    value = arrays[name]
    numeric = value.dtype.kind in "fi"
    for wrong in (
        None,
        np.array([{"a": 1}], dtype=object),
        value.astype(complex) if numeric else np.zeros(value.shape),
        value.astype("<U9") if numeric else value.astype(object),
        value[None],
        value.reshape(-1)[:1].reshape((1,) * value.ndim),
        np.zeros((0,) * value.ndim, value.dtype),
        np.zeros(3, [("a", "f8"), ("b", "i8")]),
    ):
        if wrong is not None and (wrong.shape, wrong.dtype) == (value.shape, value.dtype):
            continue
        if wrong is not None and name in ("law_across", "law_own", "law_common", "vector") and wrong.size == 1:
            continue
        np.savez(run / "data.npz", **(arrays | {name: wrong} if wrong is not None else without(arrays, name)))
        with pytest.raises(InputError):
            read_run(run)
    refused(run)
    for descr, shape in ((repr(value.dtype.str), "(1000000000,)"), ("'<f8'", "(9999999, 999999)"), ("'|O'", "(1,)")):
        write_with(run, arrays, name, claimed(descr, shape))
        with pytest.raises(InputError):
            read_run(run)


def without(arrays: dict, name: str) -> dict:
    return {key: value for key, value in arrays.items() if key != name}


def write_with(run: Path, arrays: dict, name: str, content: bytes) -> None:
    np.savez(run / "data.npz", **without(arrays, name))
    with zipfile.ZipFile(run / "data.npz", "a") as file:
        file.writestr(f"{name}.npy", content)


def changed(name: str, at, value):
    def change(arrays):
        array = arrays[name].astype(arrays[name].dtype if isinstance(value, int | float) else f"<U{len(value)}")
        array[at] = value
        return arrays | {name: array}

    return change


@pytest.mark.parametrize(
    "change",
    [
        changed("fitted_channel", 0, -3),
        changed("fitted_channel", -1, 9000),
        changed("channel", 0, -(2**62)),
        changed("samples", 0, -1),
        changed("samples", -1, 10**8),
        changed("pass_rows", -1, 400),
        changed("pass_rows", 3, 7),
        changed("fitted_pass_rows", -1, -1),
        changed("pass_count", 0, 0),
        changed("pass_count", 0, 2**62),
        changed("fitted_pass_count", 1, 5),
        changed("noise", 0, 0.0),
        changed("noise", 0, float("nan")),
        changed("route", 0, float("inf")),
        changed("start", 0, 1e7),
        changed("time", 0, 1e6),
        changed("time", 0, float("nan")),
        changed("vector", 0, float("nan")),
        changed("record", 0, float("inf")),
        changed("weight", 0, 2.0),
        changed("covariance", 0, -1.0),
        changed("law_own", 0, 0.0),
        changed("law_hidden", 0, -0.1),
        changed("law_hidden", 0, 1.5),
        changed("law_hidden", 0, float("nan")),
        lambda arrays: arrays | {"law_hidden": np.array([0.1, -0.2])},
        lambda arrays: arrays | {"law_hidden": np.full(len(arrays["record"]) + 1, 0.1)},
        changed("pass_wheelbase", 0, -1.0),
        changed("pass_track_id", 0, "\x1b[2J"),
        changed("fitted_pass_class", 0, "car\n"),
    ],
)
def test_values_that_cannot_be_are_refused(run, change):
    np.savez(run / "data.npz", **change(arrays_of(run)))
    refused(run)


def test_an_archive_that_would_fill_the_memory_is_not_unpacked(run):
    """Its directory and its headers agree; what it holds is zeros that a small file can stand for."""
    arrays = arrays_of(run)
    arrays["record"] = np.zeros((SMALL // arrays["record"][:1].nbytes + 1, arrays["record"].shape[1]), np.float32)
    np.savez_compressed(run / "data.npz", **arrays)
    del arrays
    tracemalloc.start()
    try:
        assert "they would take" in refused(run, by="ladder")
        assert tracemalloc.get_traced_memory()[1] < 2**23
    finally:
        tracemalloc.stop()


def test_sizes_are_bounded_by_the_file_and_for_good():
    check_sizes(SMALL, 1)
    check_sizes(SMALL * 2, SMALL)
    for total, stored in ((SMALL + 1, 1), (2**40, 2**39)):
        with pytest.raises(ValueError, match="they would take"):
            check_sizes(total, stored)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"\x93NUMPY", b"PK\x05\x06" + bytes(18)])
def test_what_is_not_an_archive_is_refused(run, content):
    (run / "data.npz").write_bytes(content)
    refused(run)


def test_an_archive_cut_short_or_damaged_is_refused(run):
    whole = (run / "data.npz").read_bytes()
    for cut in (len(whole) // 2, len(whole) - 30):
        (run / "data.npz").write_bytes(whole[:cut])
        refused(run)
    middle = len(whole) // 3
    (run / "data.npz").write_bytes(whole[:middle] + bytes(200) + whole[middle + 200 :])
    refused(run)


def test_what_no_command_reads_may_be_anything(run):
    """compare.json and diagnosis.json are written for others."""
    for name in ("compare.json", "diagnosis.json", "report.html", "route.csv", "route.geojson"):
        (run / name).write_text("[" * 1000)
    assert "chi2/dof" in command("ladder", run)


def test_markup_in_a_run_is_text_on_its_pages(run):
    facts = json.loads((run / "fit.json").read_text())
    evil = "<script>alert(1)</script>"
    for key in ("name", "headline", "method", "created"):
        facts[key] = evil if key != "created" else facts[key]
    facts["effects"] = facts["warnings"] = [evil]
    (run / "fit.json").write_text(json.dumps(facts))
    command("ladder", run)
    assert evil not in (run / "ladder.html").read_text(encoding="utf-8")


def test_strangers_words_are_shown_shortened_and_harmless():
    assert printable("\x1b]0;x\x07" + "y" * 300).startswith("?]0;x?yyy") and len(printable("y" * 300)) < 90


def test_refusal_names_the_key(run):
    facts = json.loads((run / "fit.json").read_text())
    facts["problem"]["prior"]["depth"] = [0.9]
    (run / "fit.json").write_text(json.dumps(facts))
    with pytest.raises(InputError, match=r"fit\.json: problem\.prior\.depth\.1: field required; give a folder"):
        read_run(run)
