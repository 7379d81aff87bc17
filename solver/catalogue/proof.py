"""A plugin is tried in a process of its own first: it may print, hang, go on, or end the process that runs it."""

import ctypes
import faulthandler
import multiprocessing
import os
import re
import signal
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import TypeVar

import torch

from solver.catalogue.catalogue import built_in
from solver.catalogue.guard import untouched
from solver.catalogue.verify import verify
from solver.effect import Effect
from solver.fit.forks import can_fork
from vision.contract import InputError

#: Time that importing a plugin, or verifying one effect, may take, s; the slowest of our own takes three.
LIMIT = 60.0
#: Option of prctl by which a process takes in those whose parents have ended (PR_SET_CHILD_SUBREAPER).
SUBREAPER = 36
#: Files of the folder through which a trial answers.
ANSWER, HUNG = "answer.txt", "hung.txt"

S = TypeVar("S")


def prove(load: Callable[[S], Sequence[Effect]], source: S, who: str) -> None:
    """Load effects in a process of its own and verify each; nothing of that is left in this one.

    Parameters
    ----------
    load : gives the effects of `source`; both can be pickled
    who : the plugin, as messages begin

    Raises
    ------
    InputError
        If they cannot be loaded, one breaks a promise (see `verify.py`), takes too long, ends the process,
        or changes what all of roadfiber shares.
    """
    if fork := can_fork():
        warm()
    begun = multiprocessing.get_context("fork") if fork else multiprocessing.get_context("spawn")
    with tempfile.TemporaryDirectory() as name:
        trial = begun.Process(target=attempt, args=(load, source, Path(name), LIMIT), daemon=True)
        trial.start()
        try:
            trial.join()
        finally:  # processes that the plugin began, and the trial itself at Ctrl-C
            trial.terminate()
            trial.join()
            if trial.pid and hasattr(os, "killpg"):
                with suppress(ProcessLookupError):
                    os.killpg(trial.pid, signal.SIGKILL)
        told = verdict(Path(name), source, trial.exitcode or 0)
    if told:
        raise InputError(told if who in told or told.startswith("effect ") else f"{who}: {told}")


@cache
def warm() -> None:
    """Let PyTorch load what its first derivatives need, which each process would do anew.

    Some forward derivatives load its compiler, which puts functions of its own into torch: not the plugin's doing.
    """
    import_module("torch._dynamo")
    verify(built_in()["channel_coupling"])


def verdict(folder: Path, source: object, status: int) -> str:
    """What is wrong, by what a trial left in its folder and its exit status; "" for nothing."""
    if (folder / ANSWER).is_file():
        return (folder / ANSWER).read_text(encoding="utf-8")
    if stack := (folder / HUNG).read_text(encoding="utf-8") if (folder / HUNG).is_file() else "":
        own = re.search(rf'File "[^"]*{re.escape(Path(str(source)).name)}", line (\d+)', stack)
        place = f" (line {own[1]})" if own else ""
        return f"not done after {LIMIT:g} s{place}; see that every loop ends and that nothing takes long"
    how = f"signal {-status}" if status < 0 else f"exit status {status}"
    return f"ends the process that runs it ({how}), as os._exit does; raise an exception instead"


def attempt(load: Callable[[S], Sequence[Effect]], source: S, folder: Path, limit: float) -> None:
    """Verify effects in this process, leave in `folder` what is wrong with them, and end it."""
    if hasattr(os, "setsid"):
        os.setsid()  # one signal reaches all processes of this one
    if sys.platform == "linux":
        supervised()
    silence()
    torch.set_num_threads(1)
    warm()  # a forked process has this from the one before it, a spawned one has not
    told = ""
    with (folder / HUNG).open("w") as stack:
        try:
            with limited(limit, stack.fileno()), untouched("its import"):
                effects = load(source)
            for one in effects:
                with limited(limit, stack.fileno()), untouched(f"effect {one.name}: its function"):
                    verify(one)
        except InputError as error:
            told = str(error)
    (folder / ANSWER).write_text(told, encoding="utf-8")
    os._exit(0)  # waits for no thread of the plugin


def supervised() -> None:
    """Go on in a child of this process, which ends as that does, after every process that was begun there.

    Processes whose parents have ended become children of this one, also those that left its group.
    """
    ctypes.CDLL(None).prctl(SUBREAPER, 1)
    trial = os.fork()
    if not trial:
        return
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(1))
    status = 0
    try:
        _, status = os.waitpid(trial, 0)
    finally:
        children = Path(f"/proc/self/task/{os.getpid()}/children")
        while found := children.read_text().split() if children.exists() else []:
            for child in found:
                os.kill(int(child), signal.SIGKILL)
            os.wait()
        if os.WIFSIGNALED(status):
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
            os.kill(os.getpid(), os.WTERMSIG(status))
        os._exit(os.waitstatus_to_exitcode(status))


def silence() -> None:
    """Print nothing in this process: the plugin prints the same again where it is used."""
    nowhere = os.open(os.devnull, os.O_RDWR)
    for stream in (1, 2):
        os.dup2(nowhere, stream)
    sys.stdout = sys.stderr = open(nowhere, "w", encoding="utf-8")  # noqa: SIM115, PTH123 as long as the process


@contextmanager
def limited(seconds: float, stack: int) -> Iterator[None]:
    """End this process if it is still within after some time, and say in the file `stack` where it is."""
    faulthandler.dump_traceback_later(seconds, exit=True, file=stack)
    yield
    faulthandler.cancel_dump_traceback_later()
