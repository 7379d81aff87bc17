"""What is on the workbench: a run and the rungs that grew out of it, what they lack, and the work that is under way.

One bench serves all browsers that look at a run. It knows nothing of how it is drawn.
"""

import threading
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from roadfiber.web.job import Job
from roadfiber.web.own_effect import kept_beside
from roadfiber.web.run_folders import kept_candidates, reserved
from roadfiber.web.worker import Worker
from solver.run.read_seen import read_seen
from solver.run.rung import route_moved
from solver.run.seen import Seen
from solver.run.titles import lower
from vision.contract import InputError
from vision.contract.errors import machine_words
from vision.contract.rounding import fall_words

if TYPE_CHECKING:
    from solver.criticism.comparison.comparison import Comparison

#: Messages that are kept.
KEPT = 6
#: Where candidates come from that nothing was fitted for.
SCORES = "scores alone, best first"


class Bench:
    """A run on the workbench.

    Parameters
    ----------
    run : as `roadfiber.open` or `read_seen` reads it; of a folder
    plugins : files with effects of the user's own
    asleep : compute nothing before `wake`, so that the run is drawn first
    """

    def __init__(self, run: Seen, plugins: Iterable[Path] = (), *, asleep: bool = False):
        if run.folder is None:
            raise InputError('the run is in memory only; save it first: run.save("run"); run = rf.open("run")')
        self.first = run.folder
        self.runs, self.at = [run], 0
        self.plugins = tuple(Path(one).resolve() for one in plugins)
        self.candidates: list[dict[str, Any]] = []
        self.source, self._asleep = "", True
        self.comparison: Comparison | None = None
        self.job: Job | None = None
        self.messages, self.version = list[str](), 0
        self.checked = ""  # what came of the last check of an effect of the user's own
        self.looker, self.adder = Worker("the worker that looks"), Worker("the worker that fits")
        self._written: dict[Path, str] = {}
        self._scored: dict[tuple[Any, ...], list[dict[str, Any]]] = {}
        self._lock = threading.RLock()
        self._watchers: list[Callable[[], None]] = []
        self.titles: dict[str, str] = {}
        if not asleep:
            self.wake()

    # ---- what a page asks --------------------------------------------------------------------------------------------

    @property
    def run(self) -> Seen:
        """The rung that is looked at."""
        return self.runs[self.at]

    @property
    def before(self) -> Seen | None:
        """The rung below, where it is on the bench."""
        return self.runs[self.at - 1] if self.at else None

    @property
    def folder(self) -> Path:
        """Of that rung."""
        assert self.run.folder is not None
        return self.run.folder

    def title(self, effect: str) -> str:
        """Title of an effect; its name until the worker that looks has told."""
        return self.titles.get(effect, effect.replace("_", " "))

    def titled(self, titles: dict[str, str]) -> None:
        """Take in the titles of all effects."""
        self.titles = titles
        self.changed()

    @property
    def refused(self) -> str:
        """Why nothing can be put into its model, and what to do; empty where effects can."""
        return self.run.too_long

    @property
    def busy(self) -> bool:
        """Whether a fit or diagnosis is under way."""
        return self.job is not None and not self.job.ended

    @property
    def can(self) -> dict[str, bool]:
        """What may be asked of it now."""
        free = not self.busy
        asked = free and not self.refused
        up, down = self.at + 1 < len(self.runs), self.at > 0
        moves = {"undo": free and down, "redo": free and up}
        return {"add": free, "cancel": not free, "diagnose": asked, "check": asked, "turn": asked} | moves

    def watch(self, called: Callable[[], None]) -> Callable[[], None]:
        """Have a function called, in any thread, whenever something changes; what is returned ends that."""
        with self._lock:
            self._watchers.append(called)

        def end() -> None:
            with self._lock:
                if called in self._watchers:
                    self._watchers.remove(called)

        return end

    def changed(self, message: str = "") -> None:
        """Say that something has changed, to all pages."""
        with self._lock:
            if message:
                self.messages = [*self.messages, message][-KEPT:]
            self.version += 1
            watchers = list(self._watchers)
        for called in watchers:
            called()

    def wake(self) -> None:
        """Begin to look for what the run lacks, once."""
        awake, self._asleep = not self._asleep, False
        if not awake:
            self.looker.ask("titles", self.plugins, then=self.titled)
            self.look()

    # ---- looking -----------------------------------------------------------------------------------------------------

    def look(self) -> None:
        """Find out what the rung that is looked at lacks: from its diagnosis, else by scores, in the background."""
        folder, self.comparison = self.folder, None
        self.candidates, self.source = kept_candidates(self.folder), "its diagnosis"
        asked = folder, self.plugins
        if not self.candidates and asked in self._scored:
            self.candidates, self.source = self._scored[asked], SCORES
        self.changed()

        def compared(found: "Comparison") -> None:
            if folder == self.folder:
                self.comparison = found
                self.changed()

        self.looker.ask("compare", *asked, then=compared, failed=self.changed)
        if self.refused:
            self.candidates, self.source = [], "not asked, the fiber is too long"
        if self.candidates or self.refused:
            return
        self.source = "scoring ..."

        def scored(rows: list[dict[str, Any]]) -> None:
            self._scored[asked] = rows
            if folder == self.folder and not self.candidates:
                self.candidates, self.source = rows, SCORES
                self.changed()

        def told(step: tuple[Any, ...]) -> None:
            if folder == self.folder and step[0] == "done":
                self.source = f"scoring, {step[1]} of {step[2]} ..."
                self.changed()

        def failed(words: str) -> None:
            if folder == self.folder and not self.candidates:
                self.source = "none"
                self.changed(words)

        self.looker.ask("score", *asked, then=scored, told=told, failed=failed)

    # ---- growing -----------------------------------------------------------------------------------------------------

    def begin(
        self,
        title: str,
        task: str,
        *given: Any,
        then: Callable[[Any], None],
        unless: Callable[[str], None] = lambda words: None,
    ) -> Job | None:
        """Begin work in the background; None, and a message, where some is under way.

        Parameters
        ----------
        then, unless : called with what came of it; with words on why nothing did
        """
        with self._lock:
            if self.busy:
                self.changed(f"{self.job.title if self.job else 'something'} is under way; wait for it, or cancel it")
                return None
            job = self.job = Job(title, self.title)

        def told(step: tuple[Any, ...]) -> None:
            job.take(step)
            self.changed()

        def ended(found: Any) -> None:
            job.ended = True
            then(found)

        def failed(words: str) -> None:
            stopped = words == "stopped"
            job.ended, job.came = True, "Canceled" if stopped else "Failed"
            unless("canceled" if stopped else words)
            kept = "; nothing was written, and all rungs are as they were"
            self.changed(f"{title}: {'canceled' if stopped else words}{kept if stopped else ''}")

        self.changed()
        self.adder.ask(task, self.folder, self.plugins, *given, then=ended, told=told, failed=failed)
        return job

    def add(self, effect: str, title: str, force: bool = False) -> None:
        """Put an effect into the model and fit everything again, in the background; a rung of its own folder."""
        self.grow(f"adding {lower(title)}", f"added: {lower(title)}", "add", effect, force)

    def turn(self, channel: int) -> None:
        """Let the fiber turn at a channel and fit everything again, likewise."""
        self.grow(f"fitting a turn at channel {channel}", f"the fiber may turn at channel {channel}", "turn", channel)

    def grow(self, title: str, done: str, task: str, what: Any, *more: Any) -> None:
        """Have a run with more in its model made in the background.

        Parameters
        ----------
        title, done : of the work, under way and when it is done
        task : of `roadfiber.web.tasks`, given `what`, the folder to write and `more`
        """
        try:
            out = reserved(self.first)
        except OSError as error:
            self.changed(f"{title}: not begun; {machine_words(error)}")
            return
        below = self.at

        def grown(folder: Path) -> None:
            better = read_seen(folder)
            rung = better.rungs[-1]
            with self._lock:
                self.runs, self.at = [*self.runs[: below + 1], better], below + 1
            was, now = better.rungs[-2].chi2_per_dof, rung.chi2_per_dof
            moved = f"misfit {was:.3f} -> {now:.3f}, {route_moved(rung.route_change)}"
            self.changed(f"{done}; {moved}; {folder}")
            self.look()

        def unused(words: str) -> None:
            with suppress(OSError):  # where the worker has removed it, which may have been killed before
                out.rmdir()

        if self.begin(title, task, what, out, *more, then=grown, unless=unused) is None:
            unused("")

    def diagnose(self) -> None:
        """Diagnose the rung that is looked at, in the background, and write that into its folder."""
        at, folder = self.at, self.folder

        def found(facts: dict[str, Any]) -> None:
            with self._lock:  # its route, corridor and trust follow the diagnosis
                self.runs = [*self.runs[:at], read_seen(folder), *self.runs[at + 1 :]]
            if folder == self.folder:
                self.candidates, self.source = facts["candidates"], "its diagnosis"
            self.changed(f"diagnosis: {facts['headline']}")

        self.begin("diagnosing", "diagnose", then=found)

    def cancel(self) -> None:
        """Stop what is under way in the background."""
        if self.busy:
            threading.Thread(target=self.adder.stop, daemon=True).start()

    def undo(self) -> None:
        """Go back to the rung below; the folder of the one above stays."""
        self.go(self.at - 1, "back to the rung below; the one above stays in {}")

    def redo(self) -> None:
        """Go to the rung above."""
        self.go(self.at + 1, "")

    def go(self, at: int, words: str) -> None:
        """Look at another rung of the bench."""
        with self._lock:
            if self.busy or not 0 <= at < len(self.runs):
                return
            left, self.at = self.folder, at
        self.changed(words.format(left))
        self.look()

    # ---- effects of the user's own -----------------------------------------------------------------------------------

    def own(self, name: str, text: str) -> None:
        """Keep a file with effects of the user's own beside the run, try it under guard, and score what it defines."""
        try:
            path = kept_beside(self.first, name, text, self._written)
        except InputError as error:
            self.checked = str(error)
            self.changed(self.checked)
            return

        def failed(words: str) -> None:
            self.checked = f"{path.name}: {words}"

        def scored(rows: list[dict[str, Any]]) -> None:
            self._scored.clear()  # The file may be an older one with another text.
            self.plugins = (*(one for one in self.plugins if one != path), path)
            names = {row["effect"] for row in rows}
            others = [row for row in self.candidates if row["effect"] not in names]
            self.candidates = sorted([*rows, *others], key=lambda row: -(row["evidence"] or 0.0))
            said = ", ".join(f"{row['told']['title']} (chi2 {fall_words(row['delta_chi2'])})" for row in rows)
            self.checked = f"{path.name}: checked; {said or 'it does nothing in this survey'}"
            self.changed(self.checked)

        self.checked = ""
        self.begin(f"checking {name}", "own", path, then=scored, unless=failed)

    def close(self) -> None:
        """End all work."""
        self.looker.stop()
        self.adder.stop()
