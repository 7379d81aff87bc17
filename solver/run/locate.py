"""From a survey to a located fiber: smooth, match, fit."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import torch

from solver.catalogue.catalogue import built_in, find
from solver.catalogue.plugins import catalogue
from solver.effect import Effect
from solver.fit.chain import Chain
from solver.fit.held_out import FOLDS, HeldOut, held_out
from solver.fit.pose import shortened
from solver.fit.problem import Problem
from solver.fit.result import FitResult
from solver.fit.room import require_room_to_fit
from solver.processing import filtered
from solver.run.chosen import choice_facts, choice_line
from solver.run.heard_passes import fit_hearing
from solver.run.methods import method_of
from solver.run.passes_fit import Fitting, timed
from solver.run.problems import as_points, matched, smoothed, untaken
from solver.run.route_fits import fit_route
from solver.run.run import Run, run_of
from solver.start.first_routes import FirstRoutes
from solver.start.free_tracks import is_heard
from solver.start.regauge import shorter_gauges
from solver.survey.das.record import DASRecord
from solver.survey.das.rounding import dithered
from solver.survey.survey import Survey
from solver.trajectory.agreement import check_apart, check_gauge, unseen_crossings
from solver.trajectory.vehicle_pass import Pass
from vision.contract import InputError, progress

#: Effects that are in the model by default; `locate --effects none` is the paper's point loads and straight gauges.
EFFECTS = tuple(one.name for one in built_in().values() if one.base_part)
#: Passes below which the user is told that they are few.
FEW = 3


def few_line(passes: Sequence[Pass]) -> str:
    """What a user should read of a route that rests on few passes that a camera saw; empty of more."""
    seen = sum(not is_heard(one) for one in passes)
    if seen >= FEW:
        return ""
    count = "one pass" if seen == 1 else f"{seen} passes"
    return (
        f"{count} only: an error of a track goes straight into the route, and no other vehicle checks it; "
        "survey at least four passes, in both directions"
    )


def tested(result: FitResult, problem: Problem, rest: Problem | None) -> HeldOut | None:
    """Misfit of passes held out of a fit to `problem`, or of the `rest`, which were not chosen."""
    chain = Chain.of(problem)
    ended = (chain, chain.state_of(torch.from_numpy(result.vector)))
    with progress("fitting without some passes", FOLDS) as advance:
        return held_out(problem, advance, at=ended, rest=rest)


@dataclass(frozen=True)
class Begun:
    """What a fit begins from.

    Parameters
    ----------
    heard : the record, rounded samples dithered
    passes : all vehicles, smoothed
    found : channels, anchors and rough routes
    """

    heard: DASRecord
    passes: list[Pass]
    found: FirstRoutes


def begin(
    survey: Survey,
    warnings: list[str],
    timings: dict[str, float],
    wheels: bool = True,
    shown: Callable[[DASRecord], DASRecord] = shorter_gauges,
) -> Begun:
    """Find where a fit of a survey with tracks begins, which takes a second or two.

    Parameters
    ----------
    warnings, timings : lines for the user, and s of each step, are added
    wheels : whether they are in the model
    shown : the record as the matched filter looks at it

    Raises
    ------
    InputError
        If record, tracks and anchors cannot be of one road and one time.
    """
    if survey.tracks is None:
        raise InputError(f"{survey.name}: has a camera only; track its video first and give the trajectories")
    record = survey.record
    check_gauge(record)
    check_apart(survey.anchors, record.channel_spacing)
    heard = replace(record, strain_rate=dithered(record.strain_rate, record.rounding))
    with timed(timings, "smooth"):
        passes = smoothed(survey.tracks, record, wheels, warnings)
    with timed(timings, "match"):
        found = matched(shown(heard), passes, survey.anchors, survey.ground.means, warnings, raw=record)
    return Begun(heard, passes, found)


def locate(
    survey: Survey,
    *,
    method: str = "spline",
    likelihood: str | None = None,
    effects: Sequence[str | Effect] = EFFECTS,
    filters: Sequence[str] = (),
    all_passes: bool = False,
    unlisted: bool = False,
) -> Run:
    """Locate the fiber of a survey.

    Parameters
    ----------
    survey : with its tracks
    method : "spline" (default) or "network" (the paper's)
    likelihood : of the network: "published" (default), or "whitened": noise, priors and anchors as the spline has them
    effects : names out of the catalogue, or effects of the user's own; empty = the paper's point loads and straight
        gauges
    filters : "fk" or "median", one after the other, of what the matched filter looks at. Fits model the noise, so a
        filter would only lose signal: they take the record as it came
    all_passes : fit them all; else of more than `solver.fit.choice.MANY` those that tell most, and the rest test the
        route
    unlisted : fit vehicles, too, that are heard beside those of the trajectories, with free tracks

    Raises
    ------
    InputError
        If the survey's video is not tracked yet, clocks do not overlap, or no vehicle is seen in the DAS.
    """
    method = method_of(method, likelihood)
    known = catalogue().extended(one for one in effects if isinstance(one, Effect))
    asked = [one if isinstance(one, Effect) else find(one, known) for one in effects]
    wheels = any(one.base_part == "wheels" for one in asked)
    timings = {"read": survey.seconds}
    record = survey.record
    warnings = [*record.cautions, *survey.cautions]

    def shown(record: DASRecord) -> DASRecord:
        return shorter_gauges(filtered(record, filters))

    start = begin(survey, warnings, timings, wheels, shown)
    passes = start.passes

    def routed(
        problems: list[Problem], wider: Problem | None, told: list[str], disputed: list[str]
    ) -> tuple[FitResult, Problem]:
        if method != "network":
            require_room_to_fit(problems[0])
        return fit_route(problems, wider, method, record, told, disputed)

    fitting = Fitting(survey, start.heard, start.found, asked, routed, all_passes, timings)
    laid_out = list if wheels else as_points
    fit = fit_hearing(fitting, passes, shown, survey.ground.means, laid_out) if unlisted else fitting.of(passes)
    every, whole, choice, result, problem = fit.passes, fit.whole, fit.choice, fit.result, fit.problem
    warnings += fit.warnings
    if few := few_line(problem.passes):
        warnings.append(few)
    warnings += unseen_crossings(survey.anchors, problem.passes, result.channel, result.route)
    again = shortened(problem, slice(None), result)
    rest = untaken(again, whole, choice)
    with timed(timings, "held_out"):
        unseen = tested(result, again, rest) if method == "spline" else None
    told_choice = None
    if choice is not None:
        every = [one for one in every if one.track_id in {mine.track_id for mine in problem.passes}]
        told_choice = choice_facts(choice, 0 if rest is None else len(rest.passes))
        warnings.append(choice_line(told_choice))
    if all(one.vehicle_class == "vehicle" for one in passes):
        asked = [one for one in asked if one.base_part != "wheels"]
    return run_of(
        result,
        survey,
        passes=every,
        anchors=list(problem.anchors),
        problem=again,
        timings=timings,
        held_out=unseen,
        effects=[one.name for one in asked],
        warnings=warnings + fit.disputed,
        disputed=fit.disputed,
        known=known,
        choice=told_choice,
    )
