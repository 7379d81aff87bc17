"""Users' own effects: from a file, from installed packages, and as the documentation shows them."""

import hashlib
import os
import py_compile
import re
from importlib.metadata import EntryPoint
from pathlib import Path
from types import SimpleNamespace

import pytest

from solver.catalogue import plugins
from solver.catalogue.catalogue import built_in
from solver.catalogue.plugins import catalogue, load_plugin, read_plugin
from solver.catalogue.trial_survey import Trial, trial_survey
from vision.contract import InputError

HOW = Path(__file__).parents[3] / "docs" / "howto" / "effect.md"

MINE = """
from dataclasses import replace
from solver.effect import Parameter, effect
from solver.cable.cable_effects import shear_lag

@effect("{name}", "cable", [Parameter("share", "1", 0.1)], physics="Mine.", source="Mine.")
def mine(cable, p, survey):
    return replace(cable, gain=cable.gain * ({null} + p["share"]))

alias = mine
"""


def written(folder: Path, name: str = "grip", null: str = "1") -> Path:
    path = folder / "mine.py"
    path.write_text(MINE.format(name=name, null=null))
    return path


def example() -> str:
    """The Python block of the documentation."""
    (block,) = re.findall(r"```python\n(# mine\.py\n.*?)```", HOW.read_text(encoding="utf-8"), re.DOTALL)
    return block


def test_the_readme_s_effect_works(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(example())
    assert len([line for line in example().splitlines() if line]) <= 12
    one = catalogue([path])["downforce"]
    trial = Trial(one, *trial_survey())
    fit = trial.fit
    speed = fit.problem.traffic.velocity.norm(dim=1)
    load = one.change(trial.given(), {"share": trial.numbers({"share": 0.1})[0]}, trial.around)
    assert load.share[:, 0].sum(1).numpy() == pytest.approx((1 + 0.1 * (speed / 30) ** 2).numpy())


def test_a_file_joins_the_catalogue_after_the_built_in_effects(tmp_path):
    every = catalogue([written(tmp_path)])
    assert list(every) == [*built_in(), "grip"]


def test_a_name_that_is_taken_is_refused(tmp_path):
    with pytest.raises(InputError, match="effect highpass: is in the catalogue already; give yours another name"):
        catalogue([written(tmp_path, name="highpass")])


def test_a_copy_of_a_plugin_is_the_same_plugin(tmp_path):
    copy = tmp_path / "plugin-1.py"
    copy.write_text(written(tmp_path).read_text())
    assert list(catalogue([copy, tmp_path / "mine.py"])) == [*built_in(), "grip"]


def test_a_plugin_is_verified(tmp_path):
    with pytest.raises(InputError, match=r"effect grip: not absent at share = 0: .* 0\.1 of its largest"):
        catalogue([written(tmp_path, null="1.1")])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("import nowhere_at_all", "ModuleNotFoundError"),
        ("x = 1", "defines no effect; decorate"),
        ("from solver.cable.cable_effects import shear_lag", "defines no effect"),
        (MINE.format(name="grip", null="1").replace('"cable"', '"fiber"'), "stage 'fiber' is none of trajectory"),
        ("def f(:", "SyntaxError"),
    ],
)
def test_a_file_that_cannot_serve_is_refused_in_a_line(tmp_path, text, words):
    path = tmp_path / "mine.py"
    path.write_text(text)
    with pytest.raises(InputError, match=words) as caught:
        load_plugin(read_plugin(path))
    assert "\n" not in str(caught.value) and str(path) in str(caught.value)


def test_a_missing_file_is_reported(tmp_path):
    with pytest.raises(InputError, match=r"nowhere\.py: no such file"):
        read_plugin(tmp_path / "nowhere.py")


@pytest.fixture
def package(tmp_path, monkeypatch):
    (tmp_path / "roads_of_mine.py").write_text(MINE.format(name="grip", null="1"))
    monkeypatch.syspath_prepend(tmp_path)

    def declared(value):
        point = EntryPoint("mine", value, plugins.GROUP)
        monkeypatch.setattr(plugins, "entry_points", lambda group: [point] if group == plugins.GROUP else [])

    return SimpleNamespace(declared=declared)


@pytest.mark.parametrize("value", ["roads_of_mine", "roads_of_mine:mine"])
def test_an_entry_point_is_a_module_or_an_effect(package, value):
    package.declared(value)
    assert list(catalogue()) == [*built_in(), "grip"]


def test_an_entry_point_that_fails_is_named(package):
    package.declared("roads_of_nobody")
    with pytest.raises(InputError, match=r"entry point mine \(roads_of_nobody\): ModuleNotFoundError.* uninstall"):
        catalogue()


def test_what_runs_is_what_the_checksum_is_of(tmp_path):
    """Not a compiled copy beside the file, which Python would take for it by its time."""
    path = written(tmp_path)
    honest, stamp = path.read_text(), path.stat().st_mtime_ns
    path.write_text(honest.replace("grip", "grap"))
    os.utime(path, ns=(stamp, stamp))
    py_compile.compile(str(path))
    path.write_text(honest)
    os.utime(path, ns=(stamp, stamp))
    assert [one.name for one in load_plugin(read_plugin(path))] == ["grip"]
    assert read_plugin(path).sha256 == hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.mark.parametrize(("content", "words"), [(b"\xff\xfe", "not UTF-8 text"), (b"#" * (2**20 + 1), "over 1 MiB")])
def test_what_is_not_text_of_a_plugin_is_reported(tmp_path, content, words):
    (tmp_path / "mine.py").write_bytes(content)
    with pytest.raises(InputError, match=words):
        read_plugin(tmp_path / "mine.py")
