"""What the doctor says of this machine and of broken ones; and that packages of the same names are not taken."""

import json
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest
from typer.testing import CliRunner

import roadfiber as rf
from roadfiber import checkup as doctor
from roadfiber import own_packages
from roadfiber.command import app
from roadfiber.schemas import FILES
from vision.contract import InputError

ROOT = Path(rf.__file__).parents[1]


def test_the_doctor_finds_this_machine_healthy_and_says_so_twice() -> None:
    told = CliRunner().invoke(app, ["doctor"], catch_exceptions=False)
    facts = json.loads(CliRunner().invoke(app, ["doctor", "--json"], catch_exceptions=False).stdout)
    assert told.exit_code == 0 and facts["healthy"]
    names = [one["name"] for one in facts["checks"]]
    assert names[:3] == ["python", "roadfiber", "own packages"] and {"onnx providers", "fonts", "browser", "cache"} <= {
        *names
    }
    assert len(told.stdout.splitlines()) == len(names)
    packages = next(one for one in facts["checks"] if one["name"] == "packages")
    assert f"numpy {version('numpy')}" in packages["found"]


def test_what_is_missing_is_told_with_its_purpose_and_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    there = doctor.version

    def absent(name: str) -> str:
        if name in ("bokeh", "scipy"):
            raise doctor.PackageNotFoundError(name)
        return "0.0.1" if name == "pandas" else there(name)

    monkeypatch.setattr(doctor, "version", absent)
    wanted = [
        "scipy>=1",
        "pandas>=2",
        "numpy>=2",
        "bokeh>=3; extra == 'workbench'",
        "colorama; sys_platform == 'win32'",
    ]
    monkeypatch.setattr(doctor, "requires", lambda name: wanted)
    core, extra = doctor.core(), doctor.extra("workbench")
    assert core.state == "broken" and core.found == "not there: scipy, pandas>=2 (there is 0.0.1)"
    assert extra == doctor.Check(
        "[workbench]",
        "missing",
        "bokeh: for pages in the browser: `calibrate page`",
        "pip install 'roadfiber[workbench]'",
    )
    assert not rf.Checkup((extra, core)).healthy and rf.Checkup((extra,)).healthy
    assert repr(rf.Checkup((extra,))).startswith("missing [workbench]")


def test_another_opencv_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    class Other:
        metadata = {"Name": "opencv-python"}  # noqa: RUF012

    monkeypatch.setattr(doctor, "distributions", lambda: [Other])
    assert doctor.opencv().state == "broken" and "pip uninstall opencv-python" in doctor.opencv().mend


def test_a_cache_that_cannot_be_written_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("ROADFIBER_CACHE", str(tmp_path / "file" / "below"))
    found = doctor.cache()
    assert found.state == "missing" and "ROADFIBER_CACHE" in found.mend


def test_a_broken_machine_is_exit_status_2(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "checks", lambda: iter([doctor.Check("opencv", "broken", "there are two")]))
    assert CliRunner().invoke(app, ["doctor"]).exit_code == 2


@pytest.mark.parametrize("as_package", [False, True])
def test_a_file_of_the_user_that_is_called_as_a_package_of_ours_is_told_in_a_line(
    tmp_path: Path, as_package: bool
) -> None:
    if as_package:
        (tmp_path / "vision").mkdir()
        (tmp_path / "vision" / "__init__.py").write_text("")
    else:
        (tmp_path / "vision.py").write_text("raise RuntimeError('mine was run')")
    code = f"import sys; sys.path[:0] = [{str(tmp_path)!r}, {str(ROOT)!r}]; import roadfiber"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path)
    last = done.stderr.strip().splitlines()[-1]
    assert last.startswith("ImportError: roadfiber: vision is taken from") and "rename or remove the other" in last
    assert done.returncode == 1


def test_folders_of_data_that_are_called_as_packages_of_ours_do_no_harm(tmp_path: Path) -> None:
    """Where roadfiber is an editable install, which Python asks only after all of its path."""
    for name in own_packages.OWN:
        (tmp_path / name).mkdir()
    code = (
        f"import sys; from importlib.machinery import PathFinder; root = {str(ROOT)!r}\n"
        "class Editable:\n"
        "    find_spec = staticmethod(lambda name, path=None, target=None: PathFinder.find_spec(name, [root]))\n"
        "sys.path = [one for one in sys.path if one != root]\n"
        "sys.meta_path.insert(sys.meta_path.index(PathFinder) + 1, Editable)\n"
        "import roadfiber, calib"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr


def test_packages_that_are_not_there_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(own_packages, "OWN", ("no_such_package",))
    assert own_packages.foreign(ROOT)[0].startswith("no_such_package is missing from")
    monkeypatch.setattr(doctor, "packages_distributions", lambda: {"vision": ["roadfiber", "vision-tools"]})
    monkeypatch.setattr(own_packages, "OWN", ())
    assert "vision-tools install packages of the same names" in doctor.own_packages().found


def test_the_calibration_page_needs_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    from vision.contract import extras

    monkeypatch.setattr(extras, "find_spec", lambda name: None)
    told = CliRunner().invoke(app, ["calibrate", "page", "street.mp4"])
    assert isinstance(told.exception, InputError)
    assert str(told.exception) == "the calibration page needs bokeh; pip install 'roadfiber[workbench]'"


def test_schemas_are_listed_and_printed() -> None:
    assert CliRunner().invoke(app, ["schema"]).stdout.split() == list(FILES)
    printed = json.loads(CliRunner().invoke(app, ["schema", "fit.json"]).stdout)
    assert printed["title"] == "fit.json"
    assert isinstance(CliRunner().invoke(app, ["schema", "fit"]).exception, InputError)


def test_figures_are_shown_in_a_notebook_before_pyplot_is_used() -> None:
    from IPython.core.interactiveshell import InteractiveShell
    from matplotlib.figure import Figure

    from roadfiber.in_notebooks import prepare

    shell = InteractiveShell.instance()
    try:
        prepare()
        shown, _ = shell.display_formatter.format(Figure(figsize=(1, 1)))
        assert shown["image/png"]
    finally:
        InteractiveShell.clear_instance()
