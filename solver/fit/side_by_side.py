"""Independent tasks on all cores: in processes, since derivatives hold Python's lock."""

import multiprocessing
import pickle
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import TypeVar

import torch

from solver.fit.forks import can_fork
from solver.survey.memory import available

S = TypeVar("S")
T = TypeVar("T")

#: Processes at most, and bytes that each holds of its own.
MOST, EACH = 8, 1e9
#: How long Ctrl-C may go unheard, s.
UNHEARD = 0.1

_task: Callable[[int], bytes]


def side_by_side(
    function: Callable[[S], T], of: Sequence[S], advance: Callable[[int], None] = lambda n: None
) -> list[T]:
    """Results of a function for each of some things, in their order.

    Each core that PyTorch may use (`torch.set_num_threads`) is one process, forked with all that the function refers
    to; only the results are sent back. Where forks are not safe, it is all done here.

    Parameters
    ----------
    function : what it returns can be pickled; what it changes may not be seen here
    of : what it is called with
    advance : called with 1 after each

    >>> side_by_side(lambda number: number**2, [0, 1, 4])
    [0, 1, 16]
    """
    workers = min(torch.get_num_threads(), len(of), int(min(available() // EACH, MOST)))
    parallel = workers > 1 and can_fork()
    results = {}
    for number, result in forked(function, of, workers) if parallel else enumerate(map(function, of)):
        results[number] = result
        advance(1)
    return [results[number] for number in range(len(of))]


def in_groups(
    function: Callable[[Sequence[S]], Sequence[T]], of: Sequence[S], size: int, advance: Callable[[int], None]
) -> list[T]:
    """Results for each of some things of a function that takes about `size` of them at once.

    Those of one group come from all over: neighbors may all take long.

    >>> in_groups(lambda some: [number**2 for number in some], [0, 1, 2, 3, 4], 2, lambda n: None)
    [0, 1, 4, 9, 16]
    """
    count = -(-len(of) // size)
    groups = [range(first, len(of), count) for first in range(count)]
    left = [len(group) for group in groups]
    found = side_by_side(lambda group: function([of[n] for n in group]), groups, lambda n: advance(left.pop()))
    results = {n: one for group, some in zip(groups, found, strict=True) for n, one in zip(group, some, strict=True)}
    return [results[n] for n in range(len(of))]


def forked(function: Callable[[S], T], of: Sequence[S], workers: int) -> Iterator[tuple[int, T]]:
    """Number and result of each as it ends.

    Raises
    ------
    MemoryError
        If the system ended a process.
    """

    def task(number: int) -> bytes:
        # Else tensors would go through shared memory, of which containers have little.
        return pickle.dumps(function(of[number]))

    context = multiprocessing.get_context("fork")
    with held_back() as interrupted, ProcessPoolExecutor(workers, context, _begin, (task,)) as pool:
        try:
            numbers = {pool.submit(_run, number): number for number in range(len(of))}
            pending = set(numbers)
            while pending:
                done, pending = wait(pending, UNHEARD, FIRST_COMPLETED)
                if interrupted:
                    raise KeyboardInterrupt
                for one in done:
                    yield numbers[one], pickle.loads(one.result())
        except BrokenProcessPool as error:
            # Ctrl-C in a terminal ends the processes, too.
            raise KeyboardInterrupt if interrupted else MemoryError("the system ended a process") from error
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


@contextmanager
def held_back() -> Iterator[list[int]]:
    """Note Ctrl-C in a list and go on: raised within a pool, it may leave a lock held, for which all wait for ever.

    Raises
    ------
    KeyboardInterrupt
        At the end, if it came and nothing else is raised.
    """
    noted: list[int] = []
    before = signal.getsignal(signal.SIGINT)
    if before is not signal.default_int_handler or threading.current_thread() is not threading.main_thread():
        yield noted
        return
    signal.signal(signal.SIGINT, lambda number, _: noted.append(number))
    try:
        yield noted
    finally:
        signal.signal(signal.SIGINT, before)
    if noted:
        raise KeyboardInterrupt


def _begin(task: Callable[[int], bytes]) -> None:
    global _task
    # Ctrl-C ends it without a word: this process says what there is to say.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    torch.set_num_threads(1)
    _task = task


def _run(number: int) -> bytes:
    return _task(number)
