"""An effect whose size is moved by hand: what is asked of the worker, and what comes of it."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from roadfiber.web import words
from roadfiber.web.bench import Bench
from roadfiber.web.controls import Controls

if TYPE_CHECKING:
    from roadfiber.web.preview import Dial, Preview

#: Effect, its size, and whether all else follows.
Wanted = tuple[str, float, bool]


class Trial:
    """The size of one effect on one page.

    Parameters
    ----------
    bench, controls : of the page
    later : has something done on the page, from any thread
    show : draws the run with a preview, or without one
    """

    def __init__(
        self, bench: Bench, controls: Controls, later: Callable[[Callable[[], Any]], None], show: Callable[[], None]
    ):
        self.bench, self.controls, self.later, self.show = bench, controls, later, show
        self.preview: Preview | None = None
        self.dial: Dial | None = None
        self.wanted: Wanted | None = None
        self.asking = self.nearing = False
        controls.heard(controls.size, self.sized)
        controls.heard(controls.follow, self.sized)

    def begin(self, effect: str | None) -> None:
        """Prepare to move the size of an effect, or of none; the run is shown as it is until then."""
        self.dial, self.wanted = None, None
        if self.preview is not None:
            self.preview, self.controls.expected.object = None, ""
            self.show()
        self.slider()
        if effect is None:
            return
        bench, size, started = self.bench, self.controls.size, object()
        self.started = started
        self.controls.set(size, label="Size: being prepared ...", disabled=True)

        def ready(dial: "Dial") -> None:
            if self.started is started:
                self.dial = dial
                self.later(self.slider)

        def failed(said: str) -> None:
            if self.started is started:
                self.later(lambda: self.controls.set(size, label=said, disabled=True))

        bench.looker.ask("dial", bench.folder, bench.plugins, effect, then=ready, failed=failed)

    def slider(self) -> None:
        """Set the slider to where the effect is absent."""
        dial, size = self.dial, self.controls.size
        if dial is None:
            self.controls.set(size, label="Size: choose what may be missing", disabled=True, show_value=False)
            return
        unit = "" if dial.unit == "1" else f", {dial.unit}"
        said = f"Size ({dial.name}{unit}), absent at {dial.null:.3g}, fits best near {dial.best:.3g}"
        reach = {"start": dial.lower, "end": dial.upper, "step": (dial.upper - dial.lower) / 200}
        self.controls.set(size, **reach, value=dial.null, label=said, disabled=False, show_value=True)

    def sized(self) -> None:
        """The size was moved: show the residual with it."""
        if self.dial is None:
            return
        self.wanted = (self.dial.effect, float(self.controls.size.value), bool(self.controls.follow.value))
        if not self.asking:
            self.ask_preview(self.wanted)

    def ask_preview(self, wanted: Wanted) -> None:
        """Ask for the residual with an effect at some size."""
        self.asking = True

        def failed(said: str) -> None:
            self.asking = False
            self.bench.changed(said)

        self.ask("preview", wanted, lambda found: self.take(wanted, found), failed)

    def ask_nearer(self, wanted: Wanted) -> None:
        """Ask for a step nearer to where all else comes to rest; one at a time, while previews go on."""
        self.nearing = True

        def failed(said: str) -> None:
            self.nearing = False
            self.bench.changed(said)

        self.ask("nearer", wanted[:2], lambda found: self.take_nearer(wanted, found), failed)

    def ask(
        self, task: str, given: tuple[Any, ...], take: Callable[[Any], None], failed: Callable[[str], None]
    ) -> None:
        """Ask the worker for something, and take it on the page."""

        def then(found: Any) -> None:
            self.later(lambda: take(found))

        self.bench.looker.ask(task, self.bench.folder, self.bench.plugins, *given, then=then, failed=failed)

    def take(self, asked: Wanted, found: "Preview") -> None:
        """Show a preview, and ask for what comes next: what is wanted by now, or at rest a step nearer."""
        self.asking = False
        if self.wanted is None or self.dial is None:
            return
        if self.wanted[0] == asked[0]:
            self.shown(found)
        if self.wanted != asked:
            self.ask_preview(self.wanted)
        elif asked[2] and not self.nearing:
            self.ask_nearer(asked)

    def take_nearer(self, asked: Wanted, found: "Preview | None") -> None:
        """Show a step nearer, and ask for the next; for that of another size where the size was moved meanwhile."""
        self.nearing = False
        if self.wanted is None or self.asking:
            return
        if self.wanted == asked and found is not None:
            self.shown(found)
        if self.wanted[2] and (self.wanted != asked or found is not None):
            self.ask_nearer(self.wanted)

    def shown(self, preview: "Preview") -> None:
        """Show a preview."""
        self.preview = preview
        self.controls.expected.object = words.preview_words(preview, self.bench)
        self.show()
