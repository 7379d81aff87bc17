"""A process of its own that works for a page: it answers requests in turn, tells how far it is, and can be stopped.

A task that only betters what is shown already is done in a thread of it: what is quick need not wait for that.

The server itself computes nothing that takes long and runs no code of a user's.
"""

import logging
import multiprocessing
import os
import queue
import signal
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

from vision.contract.errors import InputError, machine_words

#: Logger of the fits, which tells each step: names of the effects, number of passes, step, chi2 per sample.
FITS = "roadfiber.fit"
#: Time that a process which is stopped has to discard what it was writing, s.
PATIENCE = 5.0

Then = Callable[[Any], None]


@dataclass(frozen=True)
class Asked:
    """A request that is under way: what is done with its answer, its steps, and what may go wrong."""

    then: Then
    told: Then
    failed: Callable[[str], None]


class Worker:
    """A process that is begun when it is first asked, and again after it was stopped.

    Parameters
    ----------
    name : what messages call it

    Callbacks are called in a thread of their own.
    """

    def __init__(self, name: str):
        self.name = name
        self._lock = threading.RLock()
        self._open: dict[int, Asked] = {}
        self._count = 0
        self._process: Any = None
        self._connection: Any = None

    @property
    def busy(self) -> bool:
        """Whether something is under way."""
        return bool(self._open)

    def ask(
        self,
        task: str,
        *given: Any,
        then: Then,
        told: Then = lambda step: None,
        failed: Callable[[str], None] = lambda words: None,
    ) -> None:
        """Have a function of `roadfiber.web.tasks` called.

        Parameters
        ----------
        task : its name
        given : what it is given, beside what it tells its steps with; all of it can be pickled
        then : called with what it returns
        told : called with each step that it tells
        failed : called with a line that says why there is no answer
        """
        with self._lock:
            if self._process is None or not self._process.is_alive():
                self._begin()
            self._count += 1
            self._open[self._count] = Asked(then, told, failed)
            try:
                self._connection.send((self._count, task, given))
            except OSError:
                self._open.pop(self._count)
                failed(f"{self.name} has ended; try again")

    def stop(self) -> None:
        """End the process; what it was writing is discarded, and what was under way fails."""
        with self._lock:
            process, self._process = self._process, None
        if process is None or not process.is_alive():
            return
        send_signal(process.pid, signal.SIGINT)
        process.join(PATIENCE)
        if process.is_alive():
            send_signal(process.pid, getattr(signal, "SIGKILL", signal.SIGTERM))
            process.join(PATIENCE)

    def _begin(self) -> None:
        # Spawned: a fork of a server with threads may hang.
        context = multiprocessing.get_context("spawn")
        mine, its = context.Pipe()
        self._process = context.Process(target=work, args=(its,))
        self._process.start()
        its.close()
        self._connection = mine
        self._open = {}
        threading.Thread(target=self._listen, args=(mine, self._open), daemon=True).start()

    def _listen(self, connection: Connection, asked: dict[int, Asked]) -> None:
        """Pass on what the process says, until it ends."""
        while True:
            try:
                number, kind, content = connection.recv()
            except (EOFError, OSError):
                break
            one = asked.get(number) if kind == "told" else asked.pop(number, None)
            if one is not None:
                {"told": one.told, "done": one.then, "failed": one.failed}[kind](content)
        while asked:
            asked.popitem()[1].failed("stopped")


def send_signal(process: int, number: int) -> None:
    """Signal a process and those that it has begun."""
    try:
        if hasattr(os, "killpg"):
            os.killpg(process, number)
        else:
            os.kill(process, signal.SIGTERM)
    except OSError:
        pass  # It has ended.


# ---- in that process -------------------------------------------------------------------------------------------------


class Teller(logging.Handler):
    """Tells the steps of fits to the page."""

    def __init__(self, tell: Then):
        super().__init__(logging.DEBUG)
        self.tell = tell

    def emit(self, record: logging.LogRecord) -> None:
        """Pass the numbers of a step on."""
        self.tell(("step", record.args))


def work(connection: Connection) -> None:
    """Answer requests until there are no more; when the server ends, so does this, and leaves nothing half written."""
    if hasattr(os, "setsid"):
        os.setsid()  # One signal reaches all processes of this one.
    requests: queue.Queue[Any] = queue.Queue()

    def read() -> None:
        try:
            while True:
                requests.put(connection.recv())
        except (EOFError, OSError):
            os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=read, daemon=True).start()
    log = logging.getLogger(FITS)
    log.setLevel(logging.DEBUG)
    log.propagate = False
    logging.getLogger("roadfiber").setLevel(logging.WARNING)
    try:
        from roadfiber.web import tasks

        in_turn(requests, tasks, Answers(connection, log))
    except (KeyboardInterrupt, BrokenPipeError):
        pass


def in_turn(requests: "queue.Queue[Any]", tasks: Any, answers: "Answers") -> None:
    """Do tasks one after the other; what may take its time in a thread, so that a quick task need not wait for it.

    Parameters
    ----------
    tasks : holds them by name; `AT_LEISURE` those that a thread does, `MEANWHILE` those that do not wait for it
    """
    leisurely: threading.Thread | None = None
    while True:
        number, name, given = requests.get()
        if leisurely is not None and name not in tasks.MEANWHILE:
            leisurely.join()  # Some tasks fork, which no thread may be at work at.
        if name in tasks.AT_LEISURE:
            leisurely = threading.Thread(
                target=answers.quietly, args=(number, getattr(tasks, name), given), daemon=True
            )
            leisurely.start()
        else:
            answers.answer(number, getattr(tasks, name), given)


class Answers:
    """What is said of tasks, from any thread.

    Parameters
    ----------
    connection : to the server
    log : of the fits, whose steps are told
    """

    def __init__(self, connection: Connection, log: logging.Logger):
        self.connection, self.log = connection, log
        self._lock = threading.Lock()

    def send(self, *words: Any) -> None:
        """Send one message, whole."""
        with self._lock:
            self.connection.send(words)

    def answer(self, number: int, task: Callable[..., Any], given: Any) -> None:
        """Do one task, and say what came of it."""

        def tell(step: Any) -> None:
            self.send(number, "told", step)

        handler = Teller(tell)
        self.log.addHandler(handler)
        try:
            found = task(tell, *given)
        except InputError as error:
            self.send(number, "failed", str(error))
        except Exception as error:
            told = machine_words(error) or f"{type(error).__name__}: {' '.join(str(error).split())}"
            self.send(number, "failed", told)
        else:
            self.send(number, "done", found)
        finally:
            self.log.removeHandler(handler)

    def quietly(self, number: int, task: Callable[..., Any], given: Any) -> None:
        """The same where the server may have ended meanwhile."""
        with suppress(OSError):
            self.answer(number, task, given)
