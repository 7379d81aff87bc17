"""The command itself: its version, and how it ends when the machine refuses something."""

import os
import re
import shlex
import shutil
import sys
from importlib.metadata import version

import pint
import pytest
import typer.main
from numba.core import caching
from typer.testing import CliRunner

import roadfiber.command
from solver.ground.compiled import compiled
from solver.survey.das.units import require_cache
from vision.contract import InputError


def ended(monkeypatch, capsys, *words) -> tuple[int, str]:
    """Exit status and standard error of `roadfiber`."""
    monkeypatch.setattr(sys, "argv", ["roadfiber", *map(str, words)])
    with pytest.raises(SystemExit) as end:
        roadfiber.command.main()
    return end.value.code, capsys.readouterr().err


def leaves(command, *names):
    """Commands and groups of them, by the words that call them."""
    subs = getattr(command, "commands", {})
    return {names: command} | {key: leaf for name in subs for key, leaf in leaves(subs[name], *names, name).items()}


def test_each_command_has_examples_that_it_understands():
    commands = leaves(typer.main.get_command(roadfiber.command.app))
    for names, command in commands.items():
        if hasattr(command, "commands"):
            continue
        examples = re.findall(r"`roadfiber ([^`]+)`", command.help.partition("Example")[2])
        assert examples, f"{command.name} has no example"
        for example in examples:
            words = shlex.split(example.partition(" > ")[0])
            called = tuple(words[: len(names)])
            assert commands[called].make_context(called[-1], words[len(called) :]).params


def test_version():
    result = CliRunner().invoke(roadfiber.command.app, ["--version"])
    assert (result.exit_code, result.output) == (0, f"roadfiber {version('roadfiber')}\n")


@pytest.mark.parametrize(
    ("error", "status", "line"),
    [
        (KeyboardInterrupt(), 130, "roadfiber: interrupted; the unfinished output is discarded\n"),
        (MemoryError(), 2, "roadfiber: not enough memory; name fewer channels in [das] of site.toml, "),
        (ImportError("libtorch_cpu.so: failed to map segment from shared object"), 2, "roadfiber: not enough memory; "),
        (InputError("\x1b[2Ja.h5: no"), 2, "roadfiber: ?[2Ja.h5: no\n"),
        (OSError(5, "Input/output error", "a.h5"), 2, "roadfiber: a.h5: Input/output error\n"),
    ],
)
def test_what_ends_a_command_is_one_line(monkeypatch, capsys, error, status, line):
    def fail(*given):
        raise error

    monkeypatch.setattr("solver.catalogue.plugins.catalogue", fail)
    code, told = ended(monkeypatch, capsys, "effects")
    assert code == status and told.startswith(line) and told.count("\n") == 1


def test_a_fault_of_the_program_keeps_its_traceback(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["roadfiber", "effects"])
    monkeypatch.setattr("solver.catalogue.plugins.catalogue", lambda plugins: {}["fault"])
    with pytest.raises(KeyError):
        roadfiber.command.main()


def test_no_output_and_no_folder_are_one_line(monkeypatch, capsys, tmp_path):
    with monkeypatch.context() as closed:
        closed.setattr(sys, "stdout", None)
        assert ended(closed, capsys, "effects") == (
            2,
            "roadfiber: standard output is closed; send it somewhere, as with >/dev/null\n",
        )
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    told = ended(monkeypatch, capsys, "effects")
    assert told == (2, "roadfiber: the folder that you are in was removed; change to another\n")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="/dev/full is Linux's")  # noqa: PTH110
def test_a_result_that_cannot_be_printed_is_reported(monkeypatch, capsys):
    with open("/dev/full", "w") as full:  # noqa: PTH123
        monkeypatch.setattr(sys, "stdout", full)
        code, told = ended(monkeypatch, capsys, "--version")
    assert (code, told) == (2, "roadfiber: standard output: no space left; make room, or write elsewhere\n")


@pytest.mark.parametrize(
    "words",
    [
        ["simulate", "street"],
        ["track", "street.mp4"],
        ["demo"],
        ["calibrate", "board", "--draw"],
    ],
)
def test_a_target_that_cannot_be_written_ends_a_command_before_its_work(monkeypatch, capsys, tmp_path, words):
    (tmp_path / "file").write_text("")
    target = tmp_path / "file" / ("out.png" if words[-1] == "--draw" else "out.csv")
    words = [*words, target] if words[-1] == "--draw" else [*words, "--out", target]
    code, told = ended(monkeypatch, capsys, *words)
    assert (code, told) == (2, f"roadfiber: {target}: cannot be written (Not a directory); name a place that can be\n")


def test_code_is_compiled_without_a_cache_where_none_can_be_written(monkeypatch):
    monkeypatch.setattr(caching.CacheImpl, "_locator_classes", [])
    assert compiled(lambda x: x + 1)(2) == 3


def test_a_full_disk_does_not_end_compiling(monkeypatch):
    def full(*given):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(caching.IndexDataCacheFile, "save", full)
    assert compiled(lambda x: x + 2)(2) == 4


@pytest.mark.skipif(sys.platform == "win32", reason="there the cache's place is not a variable")
def test_units_are_read_where_no_cache_can_be_written(monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file" / "cache"))
    with pytest.raises(NotADirectoryError):
        pint.UnitRegistry(cache_folder=":auto:")
    require_cache()
    assert pint.UnitRegistry(cache_folder=":auto:").Quantity(1, "nm/m").to("").magnitude == 1e-9
    shutil.rmtree(os.environ["XDG_CACHE_HOME"])
