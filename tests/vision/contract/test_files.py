"""Outputs are whole or not there; a place that cannot be written is told before the work and in a line."""

import errno
import os
import re
import resource
import signal
from contextlib import contextmanager, suppress
from pathlib import Path

import h5py
import numpy as np
import pytest

from vision.contract import InputError, require_writable, writing, writing_into
from vision.contract import files as module
from vision.contract.errors import machine_words


@contextmanager
def full_disk(size: int):
    """No file may grow beyond `size` bytes: what a full disk is to every library, without a disk to fill."""
    kept = resource.getrlimit(resource.RLIMIT_FSIZE)
    ignored = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, kept[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, kept)
        signal.signal(signal.SIGXFSZ, ignored)


def left(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


def as_text(path):
    path.write_text("x" * 100_000)


def as_arrays(path):
    np.savez(path, x=np.zeros(50_000))


def as_hdf5(path):
    with h5py.File(path, "w") as file:
        file["x"] = np.zeros(50_000)


@pytest.mark.parametrize("write", [as_text, as_arrays, as_hdf5])
def test_a_full_disk_leaves_the_earlier_file_and_is_one_line(tmp_path, write):
    target = tmp_path / "deep" / "a.npz"
    words = r"a\.npz: no space left to write it; make room, or write elsewhere"
    with full_disk(10_000), pytest.raises(InputError, match=words), writing(target) as path:
        write(path)
    assert left(tmp_path) == []
    target.parent.mkdir()
    target.write_text("earlier")
    with full_disk(10_000), pytest.raises(InputError, match="no space left"), writing(target) as path:
        write(path)
    assert left(tmp_path) == ["deep", "deep/a.npz"] and target.read_text() == "earlier"


def test_files_that_belong_together_appear_together(tmp_path):
    (tmp_path / "a").write_text("earlier")
    (tmp_path / "other").write_text("stays")
    words = f"^{tmp_path}: no space left"
    with full_disk(10_000), pytest.raises(InputError, match=words), writing_into(tmp_path) as folder:
        (folder / "a").write_text("new")
        as_text(folder / "b")
    assert left(tmp_path) == ["a", "other"] and (tmp_path / "a").read_text() == "earlier"
    with writing_into(tmp_path) as folder:
        (folder / "a").write_text("new")
        (folder / "b").write_text("too")
    assert left(tmp_path) == ["a", "b", "other"] and (tmp_path / "a").read_text() == "new"


def test_what_is_written_within_is_named_by_where_it_was_to_be(tmp_path):
    words = f"^{tmp_path / 'a'}: no space left"
    with (
        full_disk(10_000),
        pytest.raises(InputError, match=words),
        writing(tmp_path / "a") as out,
        writing(out) as file,
    ):
        as_text(file)
    assert left(tmp_path) == []


def test_a_full_disk_is_seen_before_the_work(tmp_path):
    with full_disk(10_000), pytest.raises(InputError, match="run: no space left"):
        require_writable(tmp_path / "deep" / "run")
    require_writable(tmp_path / "deep" / "run", tmp_path / "a.csv")
    assert left(tmp_path) == []


@pytest.mark.parametrize("code", [errno.EROFS, errno.EACCES])
def test_a_folder_that_only_can_be_read_is_reported_before_the_work(tmp_path, monkeypatch, code):
    def refuse(*given, **named):
        raise OSError(code, os.strerror(code), str(tmp_path))

    monkeypatch.setattr(module.tempfile, "mkdtemp", refuse)
    for write in (require_writable, lambda target: writing(target).__enter__()):
        with pytest.raises(InputError, match=rf"run: cannot be written \({os.strerror(code)}\); name a place"):
            write(tmp_path / "deep" / "run")
    with pytest.raises(InputError, match="run: cannot be written"), writing_into(tmp_path / "run"):
        pass
    assert left(tmp_path) == []


def test_a_file_where_a_folder_should_be_is_reported(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r"a\.csv: cannot be written \(Not a directory\)"):
        require_writable(tmp_path / "file" / "a.csv")


def test_errors_of_what_is_read_meanwhile_are_their_own(tmp_path):
    with pytest.raises(FileNotFoundError), writing(tmp_path / "a") as path:
        path.write_text((tmp_path / "absent").read_text())
    with pytest.raises(InputError, match=r"^mine$"), writing(tmp_path / "a"):
        raise InputError("mine")


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (MemoryError("Unable to allocate 3 TiB"), "not enough memory; name fewer channels"),
        (RuntimeError("[enforce fail] DefaultCPUAllocator: can't allocate memory: you tried"), "not enough memory"),
        (OSError(28, "No space left on device"), "the disk: no space left; make room"),
        (OSError(5, "Input/output error", "a.h5"), r"a\.h5: Input/output error"),
        (OSError("Unable to open\nfile"), "Unable to open file"),
    ],
)
def test_what_the_machine_refuses_is_one_line(error, words):
    told = machine_words(error)
    assert told is not None and "\n" not in told and re.match(words, told)


def test_a_fault_of_the_program_is_none_of_the_machine():
    assert machine_words(RuntimeError("shapes do not match")) is None


@pytest.mark.parametrize("swap", [True, False])
def test_a_kill_at_any_step_leaves_a_folder_in_place_or_to_be_found(tmp_path, monkeypatch, swap):
    """What a killed process leaves is put back, or cleaned away, by the next; what another is making stays."""
    if not swap:
        monkeypatch.setattr(module, "exchange", lambda one, other: False)
    target = tmp_path / "run"
    real, steps = Path.replace, []

    class Killed(BaseException):
        pass

    def replace(path, other):
        steps.append(path)
        if len(steps) == 2:
            raise Killed
        return real(path, other)

    def write(text):
        with writing(target) as path:
            path.mkdir()
            (path / "a").write_text(text)

    write("earlier")
    steps.clear()
    monkeypatch.setattr(Path, "replace", replace)
    monkeypatch.setattr(module.shutil, "rmtree", lambda *given, **named: None)
    with suppress(Killed):
        write("new")
    monkeypatch.undo()
    assert target.exists() == swap and len(list(tmp_path.glob(".run*"))) == 1
    with writing(tmp_path / "run") as mine:
        require_writable(target)
        assert (target / "a").read_text() == ("new" if swap else "earlier")
        mine.mkdir()
    assert left(tmp_path) == ["run"]
