"""What a page has done in a process of its own, see `roadfiber.web.worker`: the Python API on run folders."""

from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import lru_cache
from pathlib import Path
from typing import Any

import roadfiber as rf
from roadfiber.locating import open_street
from roadfiber.web.preview import Dial, Preview, Previews
from roadfiber.web.site_checks import Checked, check
from roadfiber.web.site_draft import Draft
from solver.catalogue.catalogue import find
from solver.catalogue.plugins import Plugin, catalogue, read_plugin
from solver.criticism.bench import scorable
from solver.criticism.candidate import score_candidate
from solver.criticism.comparison.comparison import Comparison
from solver.criticism.plain_verdict import spoken
from solver.criticism.repairs import SEARCHES
from solver.criticism.scorer import Scorer, score_all
from solver.effect import Effect
from solver.fit.least_squares import solve
from solver.fit.map_fit import MapFit
from solver.fit.track_trust import strict_tracks, track_spread
from solver.run.fitted import fitted
from solver.run.run import Run
from solver.run.strict_json import strict
from vision.contract import InputError

Tell = Callable[[Any], None]
#: Tasks that may take their time, and those that do not wait for them: a size that is moved is shown at once.
AT_LEISURE, MEANWHILE = frozenset({"nearer"}), frozenset({"preview"})
#: Steps that a fit whose tracks are trusted more may take before effects are scored.
SETTLING = 12


def opened(folder: Path, plugins: tuple[Path, ...]) -> Run:
    """A run with these plugins as they are now; the last few are kept."""
    return opened_as(folder, tuple(map(read_plugin, plugins)))


@lru_cache(maxsize=3)
def opened_as(folder: Path, plugins: tuple[Plugin, ...]) -> Run:
    """A run with plugins of these texts."""
    return open_street(folder, plugins=[one.path for one in plugins])


def previews(folder: Path, plugins: tuple[Path, ...]) -> Previews:
    """The previews of a run; the last few are kept."""
    return previews_as(folder, tuple(map(read_plugin, plugins)))


@lru_cache(maxsize=2)
def previews_as(folder: Path, plugins: tuple[Plugin, ...]) -> Previews:
    """The previews of a run with plugins of these texts."""
    run = opened_as(folder, plugins)
    fit, state = fitted(run)
    return Previews(fit, state, run.result.chi2_per_dof)


def titles(tell: Tell, plugins: tuple[Path, ...]) -> dict[str, str]:
    """Titles of all effects, by name."""
    return {name: one.title for name, one in catalogue(plugins).items()}


def compare(tell: Tell, folder: Path, plugins: tuple[Path, ...]) -> Comparison:
    """Where model and measurement differ."""
    return rf.compare(opened(folder, plugins)).finding


def score(tell: Tell, folder: Path, plugins: tuple[Path, ...], only: Sequence[str] = ()) -> list[dict[str, Any]]:
    """Effects that a run may lack, best first, by the score test alone; rows as in diagnosis.json.

    Parameters
    ----------
    only : names of effects; all that the run may be given where there are none
    """
    run = opened(folder, plugins)
    fit, state = fitted(run)
    trusted = MapFit(strict_tracks(fit.problem, track_spread(fit.problem.passes, state.vehicles.along.numpy())))
    scorer = Scorer(trusted, solve(trusted, state, iterations=SETTLING).state)
    effects = [find(name, run.known) for name in only] or list(run.known.values())
    asked = scorable(fit.problem, effects)
    count = iter(range(1, len(asked) + 1))
    table = score_all(scorer, asked, lambda n: tell(("done", next(count, len(asked)), len(asked))))
    listed = spoken([score_candidate(one, None) for one in table], fit.problem, asked)
    rows: list[dict[str, Any]] = [strict(asdict(one)) for one in listed]
    return rows


def diagnose(tell: Tell, folder: Path, plugins: tuple[Path, ...]) -> dict[str, Any]:
    """The diagnosis of a run, which is written into its folder; the content of diagnosis.json."""
    found = rf.diagnose(opened(folder, plugins), tell=lambda words: tell(("line", words.splitlines()[0])))
    found.save(folder)
    return found.facts


def add(tell: Tell, folder: Path, plugins: tuple[Path, ...], effect: str, out: Path, force: bool) -> Path:
    """Put an effect into a run's model, fit everything again, and write the run as a folder, whole or not at all.

    Parameters
    ----------
    out : an empty folder, which is removed where nothing is written
    """
    return saved(
        tell, out, lambda: rf.add(opened(folder, plugins), effect, force=force, tell=lambda line: tell(("line", line)))
    )


def turn(tell: Tell, folder: Path, plugins: tuple[Path, ...], channel: int, out: Path) -> Path:
    """Let a run's fiber turn at a channel, and write the run as `add` does."""
    return saved(tell, out, lambda: rf.turn(opened(folder, plugins), channel))


def saved(tell: Tell, out: Path, make: Callable[[], Run]) -> Path:
    """Write a run that is made into an empty folder, which is removed where nothing is written."""
    try:
        better = make()
        tell(("line", "writing"))
        better.save(out)
    finally:
        if not any(out.iterdir()):
            out.rmdir()
    return out


def dial(tell: Tell, folder: Path, plugins: tuple[Path, ...], effect: str) -> Dial:
    """What can be moved by hand of an effect."""
    return previews(folder, plugins).dial(known(folder, plugins, effect))


def preview(tell: Tell, folder: Path, plugins: tuple[Path, ...], effect: str, value: float, follow: bool) -> Preview:
    """A run's model with an effect at some size."""
    return previews(folder, plugins).at(known(folder, plugins, effect), value, follow)


def nearer(tell: Tell, folder: Path, plugins: tuple[Path, ...], effect: str, value: float) -> Preview | None:
    """The last preview after a step more of all else; None where that gains little."""
    return previews(folder, plugins).nearer(known(folder, plugins, effect), value)


def known(folder: Path, plugins: tuple[Path, ...], name: str) -> Effect:
    """An effect of a run by its name."""
    if name in SEARCHES:
        raise InputError(f"{name}: a fault of the survey, with no size to choose; add it, and it is mended")
    return find(name, opened(folder, plugins).known)


def own(tell: Tell, folder: Path, plugins: tuple[Path, ...], mine: Path) -> list[dict[str, Any]]:
    """Try a file with effects of a user's own under guard, and score what it defines; rows as of `score`."""
    others = tuple(one for one in plugins if one != mine)
    there, with_mine = set(opened(folder, others).known), (*others, mine)
    names = [name for name in opened(folder, with_mine).known if name not in there]
    return score(tell, folder, with_mine, names)


def check_site(tell: Tell, folder: Path, draft: Draft) -> Checked:
    """The checks of a survey whose site.toml would stand in a folder."""
    return check(folder, draft, lambda what: tell(("line", what)))
