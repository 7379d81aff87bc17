"""A survey with some of its vehicles: posed, and fitted from every rough route."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass

from solver.effect import Effect
from solver.fit.choice import MANY, Choice, choose
from solver.fit.pose import with_slow_errors
from solver.fit.problem import Problem
from solver.fit.result import FitResult
from solver.fit.some_passes import only
from solver.fit.stretches import is_long
from solver.run.problems import problems_of
from solver.start.first_routes import FirstRoutes
from solver.survey.das.record import DASRecord
from solver.survey.survey import Survey
from solver.trajectory.vehicle_pass import Pass
from vision.contract import progress


@contextmanager
def timed(timings: dict[str, float], name: str) -> Iterator[None]:
    """Note how long a step takes, s; of one that is done again, in all."""
    begun = time.perf_counter()
    yield
    timings[name] = timings.get(name, 0.0) + time.perf_counter() - begun


def choice_of(whole: Problem, timings: dict[str, float]) -> Choice | None:
    """Which of many passes tell most; None where all are fitted."""
    if len(whole.passes) <= MANY or is_long(whole):
        return None
    with timed(timings, "choose"), progress("choosing passes", len(whole.passes)) as advance:
        choice = choose(whole, advance)
    return choice if choice.taken else None


@dataclass(frozen=True)
class PassesFit:
    """A fit with some vehicles.

    Parameters
    ----------
    passes : all that it may be of
    whole : the problem with all of them
    choice : of passes that tell most; None where all were fitted
    result, problem : the fit, and what it solves
    warnings : lines for the user
    disputed : sentences on anchors that contradict the others
    """

    passes: list[Pass]
    whole: Problem
    choice: Choice | None
    result: FitResult
    problem: Problem
    warnings: list[str]
    disputed: list[str]


@dataclass(frozen=True)
class Fitting:
    """What a survey's passes are fitted with.

    Parameters
    ----------
    survey : that is located
    record : its record, rounded samples dithered
    found : channels, anchors and rough routes
    effects : of the model, parts of the base model among them
    route : fits problems, one for each start, and if it can that of all channels that are felt; adds lines for the
        user, and sentences on anchors, to two lists
    all_passes : fit them all; else of many those that tell most
    timings : how long steps took, s; added to
    """

    survey: Survey
    record: DASRecord
    found: FirstRoutes
    effects: Sequence[Effect]
    route: Callable[[list[Problem], Problem | None, list[str], list[str]], tuple[FitResult, Problem]]
    all_passes: bool
    timings: dict[str, float]

    def timed(self, name: str) -> AbstractContextManager[None]:
        """Note how long a step takes."""
        return timed(self.timings, name)

    def of(self, passes: Sequence[Pass]) -> PassesFit:
        """Fit some vehicles."""
        warnings, disputed = list[str](), list(self.found.disputed)
        problems = problems_of(self.survey, self.record, passes, self.found, self.effects, warnings)
        whole, choice = problems[0], None if self.all_passes else choice_of(problems[0], self.timings)
        if choice is not None:
            problems = [only(one, choice.numbers) for one in problems]
        problems, wider = [with_slow_errors(one) for one in problems], None
        if (more := self.found.whole) is not None:
            (wider,) = problems_of(self.survey, self.record, passes, more, self.effects, [])
            wider = with_slow_errors(wider if choice is None else only(wider, choice.numbers))
        with self.timed("fit"):
            result, problem = self.route(problems, wider, warnings, disputed)
        if problem.coil is not None:
            warnings.append(self.found.coil_line)
        if wider is None or len(problem.channel) < len(wider.channel):
            warnings += self.found.beyond(result.channel[result.constrained])
        return PassesFit(list(passes), whole, choice, result, problem, warnings, disputed)
