"""A model that grows: add effects to a run, draw its error ladder, tell the story; and the clock that fits best."""

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from roadfiber.diagnosing import diagnose
from roadfiber.widening import FULL, check_corridor, with_corridor
from solver.criticism.diagnosis import converged
from solver.criticism.diagnosis_files import check_out, story_facts, write_diagnosis, write_story
from solver.criticism.growth import Grown, check_names, fitted_with, grow, held_out_before, with_growth
from solver.criticism.pages import Chapter, story_page
from solver.criticism.verdict_words import left_open
from solver.effect import Effect
from solver.fit.held_out import FOLDS, held_out
from solver.fit.least_squares import solve
from solver.fit.map_fit import MapFit
from solver.fit.refinement import knots_around
from solver.fit.track_trust import strict_tracks
from solver.run.fitted import fitted
from solver.run.ladder import climbed, rungs_of
from solver.run.ladder_file import ladder_facts, write_ladder
from solver.run.report.joined import join
from solver.run.report.ladder_page import ladder_figure, ladder_page
from solver.run.run import Run, require_whole
from solver.run.rung import Rung, route_moved
from solver.run.titles import lower
from solver.trajectory.trajectory_effects import CLOCK
from vision.contract import InputError, progress, writing
from vision.contract.notebook import framed

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


def add(
    run: Run,
    *effects: str | Effect,
    force: bool = False,
    tell: Callable[[str], None] | None = None,
    corridor: str = FULL,
) -> Run:
    """Add effects to the model of a run, one after another, and fit everything again.

    Parameters
    ----------
    run : to start from; it stays as it is
    effects : names out of the catalogue, or effects of your own
    force : keep an effect even if passes held out fit no better with it
    tell : called with a line on each effect, such as `print`
    corridor : as of `locate`

    Returns
    -------
    run : one rung up the error ladder for each call

    Raises
    ------
    InputError
        If there is no such effect, it is in the model already or does nothing in this survey, passes held out fit no
        better with it, or the run is of a long fiber.

    Examples
    --------
    >>> better = rf.add(run, "camber", force=True, corridor="fit")
    >>> better.effects, len(better.rungs)
    (['camber'], 2)
    """
    check_corridor(corridor)
    begun = time.perf_counter()
    mine = [one for one in effects if isinstance(one, Effect)]
    require_whole(run)
    names = [one.name if isinstance(one, Effect) else one for one in effects]
    run = replace(run, known=run.known.extended(mine))
    check_names(names, run.problem, run.known)
    fit, state = fitted(run)
    held, step = list(run.effects), None
    with progress("fitting with more effects", (FOLDS + 2) * len(names) + FOLDS) as advance:
        before = held_out_before(run, fit, state, advance)
        for name in names:
            step = grow(fit, state, name, run.known, before, advance)
            words = f"{name}: held-out chi2 per degree of freedom from {step.held_out_words}"
            if not step.better and not force:
                raise InputError(
                    f"{name}: chi2 per degree of freedom of held-out passes goes from {step.held_out_words}; "
                    "not kept (--force keeps it all the same)"
                )
            if tell is not None:
                tell(words)
            fit, state = step.fit, step.solution.state
            before = None if step.after is None else step.after.chi2_per_dof
            held.append(name)
    if step is None:
        raise InputError("no effect to add; name one of `roadfiber effects`")
    return with_corridor(with_growth(run, step, held, time.perf_counter() - begun), corridor)


def turn(run: Run, *channels: int, corridor: str = FULL) -> Run:
    """Let the fiber turn at some channels as sharply as ducts do, and fit everything again.

    `locate` finds most corners by itself; this is for one that you know of.

    Parameters
    ----------
    run : to start from; it stays as it is
    channels : within the fitted ones
    corridor : as of `locate`

    Returns
    -------
    run : one rung up the error ladder, its effects as before

    Raises
    ------
    InputError
        If a channel was not fitted, or the run is of a long fiber.

    Examples
    --------
    >>> turned = rf.turn(run, 100, corridor="fit")
    >>> turned.problem.basis.size - run.problem.basis.size, len(turned.rungs)
    (11, 2)
    """
    check_corridor(corridor)
    begun = time.perf_counter()
    fit, state = fitted(run)
    first, last = fit.problem.channel[[0, -1]].tolist()
    for one in channels or (None,):
        if one is None or not first <= one <= last:
            raise InputError(
                f"channel {one}: channels {first} to {last} are fitted; give the one where the fiber turns"
            )
    problem, state = knots_around(fit.problem, state, fit.problem.distance_of(channels).tolist())
    fit = MapFit(problem)
    end = solve(fit, state)
    grown = Grown(fit, end, None, held_out(problem, at=(fit, end.state)))
    return with_corridor(with_growth(run, grown, run.effects, time.perf_counter() - begun), corridor)


@dataclass(frozen=True, repr=False)
class Ladder:
    """The error ladder: misfit against models, and how far the route moved.

    Parameters
    ----------
    rungs : lowest first
    name : of the survey
    folder : of the last rung's run; the working directory where it was not saved
    """

    rungs: tuple[Rung, ...]
    name: str
    folder: Path

    @property
    def table(self) -> "pd.DataFrame":
        """A row per rung: effects, chi2_per_dof, held_out_chi2_per_dof, noise_floor, route_change (m) ..."""
        import pandas as pd

        rows = [asdict(one) for one in self.rungs]
        return pd.DataFrame(rows).drop(columns=["route", "folder"])

    @property
    def facts(self) -> dict[str, Any]:
        """The content of ladder.json."""
        return ladder_facts(self.rungs, self.folder)

    def plot(self) -> "Figure":
        """Draw misfit, held-out misfit and the way that the route moved, rung by rung."""
        return ladder_figure(self.rungs)

    def save(self, folder: Path | str) -> None:
        """Write ladder.json and ladder.html into a folder."""
        write_ladder(Path(folder), self.rungs, self.name)

    def lines(self) -> list[str]:
        """What a terminal shows."""
        lines = list[str]()
        for rung in self.rungs:
            held = "-" if rung.held_out_chi2_per_dof is None else f"{rung.held_out_chi2_per_dof:.3f}"
            names = ", ".join(rung.effects) or "as published"
            misfit = f"chi2/dof {rung.chi2_per_dof:.3f}  held out {held}"
            lines += [*rung.words, f"{misfit}  moved {rung.moved}  {names}"]
        return lines

    def __repr__(self) -> str:
        return "\n".join([f"<Ladder {self.name}", *(f"  {line}" for line in self.lines())]) + ">"

    def _repr_html_(self) -> str:
        return framed(ladder_page(self.rungs, self.name))


def ladder(*runs: Run) -> Ladder:
    """The error ladder of runs.

    Parameters
    ----------
    runs : lowest first; a single run brings the ladder that it has grown on

    Examples
    --------
    >>> rf.ladder(run, rf.add(run, "camber", force=True, corridor="fit")).table["effects"].tolist()
    [(), ('camber',)]
    """
    if not runs:
        raise InputError("no run to draw a ladder of; give one or more")
    *below, last = runs
    rungs = rungs_of(runs[0])
    for before, after in zip(below, runs[1:], strict=True):
        rungs = climbed(replace(before, rungs=rungs), after)
    return Ladder(rungs, last.name, last.folder or Path())


@dataclass(frozen=True, repr=False)
class Story:
    """What a model lacked, found and added step by step.

    Parameters
    ----------
    run : the last rung's
    chapters : each diagnosis, and what was done about it
    """

    run: Run
    chapters: tuple[Chapter, ...]

    @property
    def rungs(self) -> tuple[Rung, ...]:
        """Of the error ladder."""
        return rungs_of(self.run)

    @property
    def still_open(self) -> str:
        """What could not be told apart; empty where nothing is left open."""
        return left_open(one.diagnosis.candidates[0] for one in self.chapters if one.diagnosis.candidates)

    def facts(self, out: Path | None = None) -> dict[str, Any]:
        """What `roadfiber explain --json` prints, of a story that is saved in a folder."""
        story = story_facts(self.chapters, self.rungs, out or Path())
        return story | {"trust": self.run.trust, "still_open": self.still_open}

    def save(self, folder: Path | str) -> None:
        """Write the last rung's run folder with its diagnosis, ladder.html and explain.html, whole or not at all."""
        folder = Path(folder)
        check_out(folder, self.run)
        with writing(folder) as temporary:
            replace(self.run, rungs=self.rungs).save(temporary)
            write_ladder(temporary, self.rungs, self.run.name, seen_from=folder)
            write_diagnosis(temporary, self.chapters[-1].diagnosis, self.run.name, self.run)
            write_story(temporary, self.chapters, self.rungs, self.run.name)
            join(temporary, called=folder.resolve().name)

    def __repr__(self) -> str:
        return "\n".join([f"<Story {self.run.name}", *(f"  {chapter.done}" for chapter in self.chapters)]) + ">"

    def _repr_html_(self) -> str:
        return framed(story_page(self.chapters, self.rungs, self.run.name))


def explain(run: Run, *, most: int = 4, tell: Callable[[str], None] | None = None) -> Story:
    """Diagnose, add, and again until the model is adequate; nothing is added that held-out passes do not want.

    Parameters
    ----------
    run : to start from
    most : effects to add
    tell : called with a line on every step, such as `print`

    Examples
    --------
    >>> rf.explain(run, tell=print).save(folder / "explained")  # doctest: +SKIP
    """
    say = tell or (lambda line: None)
    chapters: list[Chapter] = []
    while True:
        found = diagnose(run, tell=lambda words: say(words.splitlines()[0]))
        say(f"{found.verdict}: {found.headline} ({found.words})")
        if found.verdict != "missing-effect" or found.effect is None or len(chapters) == most:
            chapters.append(Chapter(found.finding, "Nothing more was added.", found.run))
            break
        begun = time.perf_counter()
        fit, state = fitted(run)
        step: Grown = grow(fit, state, found.effect, run.known, held_out_before(run, fit, state))
        if not step.better:
            tried = f"It was tried in the model ({found.effect}): passes held out fit no better, so it was left out."
            chapters.append(Chapter(found.finding, tried, found.run))
            break
        after = with_growth(run, step, [*run.effects, found.effect], time.perf_counter() - begun)
        rung = after.rungs[-1]
        title = lower(found.finding.candidates[0].title)
        done = f"Added to the model: {title}; {route_moved(rung.route_change)}."
        chapters.append(Chapter(found.finding, done, run, added=True))
        for line in rung.words:
            say(line)
        misfit = f"{after.rungs[-2].chi2_per_dof:.3f} -> {rung.chi2_per_dof:.3f}"
        say(f"added {found.effect}: chi2 per degree of freedom {misfit}")
        run = after
    weighed = found.finding.corridor is not None or not run.rungs
    return Story(found.run if weighed else with_corridor(found.run, FULL), tuple(chapters))


def clock_offset(run: Run) -> tuple[float, float]:
    """Estimate the offset between the clocks of trajectories and DAS from a located run.

    The offset that fits all passes best, with the route free to move along.

    Returns
    -------
    offset, sigma : s; the DAS clock is ahead of the trajectories' by that

    Examples
    --------
    >>> offset, sigma = rf.clock_offset(run)
    >>> abs(offset) < 5 * sigma < 0.5
    True
    """
    fit, state = fitted(run)
    fit, state = converged(strict_tracks(fit.problem), state)
    found = fitted_with(fit, state, CLOCK, lambda n: None)
    return float(found.estimate[-1]), float(found.sigma[-1])
