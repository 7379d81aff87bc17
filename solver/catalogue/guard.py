"""Guards around code that is not ours: what it prints, where it ends, and what it changes for everybody."""

import builtins
import math
import os
import random
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, redirect_stdout, suppress
from dataclasses import replace
from functools import wraps
from typing import Any

import numpy as np
import torch

from solver.effect import Effect
from vision.contract import InputError

#: Modules whose functions all of roadfiber calls, and the packages of ours.
SHARED: tuple[Any, ...] = (builtins, math, np, torch, torch.Tensor)
OURS = ("solver", "vision")


class Aside:
    """Sends what is printed, by Python or below it, to standard error; for all threads while any is within."""

    def __init__(self) -> None:
        self.lock, self.within, self.undo = threading.Lock(), 0, ExitStack()

    @contextmanager
    def __call__(self) -> Iterator[None]:
        """Standard output is for results."""
        with self.lock:
            self.within += 1
            if self.within == 1:
                self.begin()
        try:
            yield
        finally:
            with self.lock:
                self.within -= 1
                if self.within == 0:
                    self.undo.close()

    def begin(self) -> None:
        """Turn standard output aside until `undo` is closed."""
        with suppress(OSError):  # a process may have none
            kept = os.dup(1)
            self.undo.callback(os.close, kept)
            os.dup2(2, 1)
            self.undo.callback(os.dup2, kept, 1)
        self.undo.enter_context(redirect_stdout(sys.stderr))


aside = Aside()


def settings() -> dict[str, Any]:
    """What a call may have changed for everybody: few, as this is asked at every call of an effect in a fit."""
    return {
        "torch's default dtype": torch.get_default_dtype(),
        "whether torch computes derivatives": torch.is_grad_enabled(),
        "numpy's handling of floating-point errors": np.geterr(),
    }


def more_settings() -> dict[str, Any]:
    """All that is shared and that a plugin could change: settings, random numbers, functions of modules."""
    found = settings() | {
        "torch's default device": torch.get_default_device(),
        "torch's number of threads": torch.get_num_threads(),
        "torch's random numbers": torch.get_rng_state().numpy().tobytes(),
        "torch's deterministic algorithms": torch.are_deterministic_algorithms_enabled(),
        "torch's precision of matrix products": torch.get_float32_matmul_precision(),
        "numpy's random numbers": np.random.get_state(legacy=False)["state"]["key"].tobytes(),  # noqa: NPY002 the shared
        "Python's random numbers": random.getstate(),
        "numpy's printing": repr(np.get_printoptions()),
        "the working directory": os.getcwd(),  # noqa: PTH109 as text
    }
    ours = [module for name, module in sys.modules.items() if name.partition(".")[0] in OURS]
    for owner in [*SHARED, *ours]:
        for part in reversed(getattr(owner, "__mro__", (owner,))):
            functions = {name: value for name, value in vars(part).items() if name[0] != "_" and callable(value)}
            found |= {f"{owner.__name__}.{name}": value for name, value in functions.items()}
    return found


@contextmanager
def untouched(who: str, state: Callable[[], dict[str, Any]] = more_settings) -> Iterator[None]:
    """Tell what changed within of what is shared.

    Parameters
    ----------
    who : did it, as the message begins
    state : what is compared: name -> value

    Raises
    ------
    InputError
        If anything did.

    >>> with untouched("nobody"):
    ...     x = torch.zeros(2)
    """
    before = state()
    yield
    after = state()
    for name, value in before.items():
        now = after.get(name)
        # Functions are compared by identity: some are equal to nothing.
        if now is not value and (callable(value) or now != value):
            raise InputError(f"{who} changes {name}, which all of roadfiber shares; leave it as it is")


@contextmanager
def running(who: str) -> Iterator[None]:
    """Let code that is not ours run: printing aside, an end of the program told.

    Raises
    ------
    InputError
        If it calls sys.exit.
    """
    try:
        with aside():
            yield
    except SystemExit as error:
        raise InputError(f"{who} ends the program (sys.exit); raise an exception instead") from error


def guarded(one: Effect) -> Effect:
    """The same effect, whose functions run under guard wherever it is used."""
    who = f"effect {one.name}: its function"

    def under_guard(function: Callable[..., Any]) -> Callable[..., Any]:
        @wraps(function)
        def call(*given: Any) -> Any:
            with running(who), untouched(who, settings):
                return function(*given)

        return call

    return replace(one, change=under_guard(one.change), seek=one.seek and under_guard(one.seek))
