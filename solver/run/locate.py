"""From a survey to a located fiber: smooth, match, fit."""

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import torch

from solver.catalogue.catalogue import built_in, find
from solver.catalogue.plugins import catalogue
from solver.effect import Effect
from solver.fit import FitResult, Prior, Problem, fit_spline
from solver.fit.anchor_check import contradiction
from solver.fit.chain import Chain
from solver.fit.choice import MANY, Choice, choose, only
from solver.fit.held_out import FOLDS, held_out
from solver.fit.pose import bent_ends, pose, shortened, with_slow_errors
from solver.fit.room import require_room_to_fit
from solver.fit.sides import best_of, hopeless, reopened
from solver.fit.stretches import is_long
from solver.load.wheel_layout import not_known
from solver.processing import filtered
from solver.run.chosen import choice_facts, choice_line
from solver.run.heard_passes import with_unlisted
from solver.run.methods import METHODS, method_of
from solver.run.run import Run, run_of
from solver.start.first_routes import find_first_routes
from solver.start.free_tracks import is_heard
from solver.start.regauge import shorter_gauges
from solver.survey.das.record import DASRecord, ranges
from solver.survey.das.rounding import dithered, told
from solver.survey.dead_channels import dead_channels
from solver.survey.survey import Survey
from solver.trajectory.agreement import check_apart, check_gauge, in_record, slow_line, suspicions
from solver.trajectory.passes import smooth_passes
from solver.trajectory.vehicle_pass import Pass
from vision.contract import InputError, progress

#: Effects that are in the model by default; `locate --effects none` is the paper's point loads and straight gauges.
EFFECTS = tuple(one.name for one in built_in().values() if one.base_part)
#: Chi2 per degree of freedom up to which a model explains the data well enough to judge anchors by it.
EXPLAINED = 1.03
#: Chi2 per degree of freedom from which a route is tried on more knots, and the share of what is beyond 1 that they
#: must explain: a fiber that dips under a culvert is beyond the usual knots, while most of what other physics leaves is
#: beyond any route.
LEFT_OVER, BY_ROUTE = 1.01, 0.6
#: m
FOOT = 0.3048
#: Passes below which the user is told that they are few.
FEW = 3


@contextmanager
def timed(timings: dict[str, float], name: str) -> Iterator[None]:
    """Note how long a step takes, s."""
    begun = time.perf_counter()
    yield
    timings[name] = time.perf_counter() - begun


def fit_sides(problems: Sequence[Problem], method: str) -> tuple[FitResult, Problem]:
    """Fit every start; the best is returned, marked ambiguous where another side is still open."""
    fit, steps = METHODS[method]
    ends: list[tuple[FitResult, Problem]] = []
    for problem in problems:
        with progress("fitting the route", steps) as advance:
            if ends and method == "spline":
                found = fit_spline(problem, advance, hopeless=hopeless(ends[0][0]))
            else:
                found = fit(problem, advance)
            ends.append((found, problem))
    (best, problem), ambiguous = best_of(ends, steps)
    return replace(best, ambiguous_side=ambiguous), problem


def fit_straight(
    result: FitResult, problem: Problem, method: str, recorded: tuple[int, int], warnings: list[str]
) -> tuple[FitResult, Problem]:
    """Fit again without the ends at which the fiber turns off the road, until none is left.

    Beyond a coil that the model does not have the route turns too, though the fiber does not.
    """
    if problem.coil is not None:
        return result, problem
    gauge = round(problem.gauge_length / problem.channel_spacing)
    while (keep := bent_ends(result, gauge)) != slice(0, len(problem.channel)):
        whole, problem = problem, shortened(problem, keep, result)
        for end in sorted({int(whole.channel[0]), int(whole.channel[-1])} - set(problem.channel[[0, -1]].tolist())):
            warnings.append(left_out(end, recorded, gauge))
        again, problem = fit_sides([problem], method)
        result = replace(again, ambiguous_side=result.ambiguous_side)
    return result, problem


def left_out(end: int, recorded: tuple[int, int], gauge: int) -> str:
    """What a user should read of an end that is not located; where the record ends there, no bend can be seen.

    >>> left_out(60, (0, 240), 10)
    'the fiber turns off the road near channel 60; it is not located there'
    >>> left_out(60, (58, 108), 10)
    'the model does not explain the end of the record near channel 60; the fiber is not located there'
    """
    if min(end - recorded[0], recorded[1] - end) >= gauge:
        return f"the fiber turns off the road near channel {end}; it is not located there"
    return f"the model does not explain the end of the record near channel {end}; the fiber is not located there"


def fit_finely(result: FitResult, problem: Problem, method: str) -> tuple[FitResult, Problem]:
    """Fit again on twice as many knots where much is left over; kept if the route alone explains most of that."""
    if method != "spline" or is_long(problem) or not (result.converged and result.chi2_per_dof > LEFT_OVER):
        return result, problem
    fine = replace(shortened(problem, slice(None), result), knot_spacing=problem.knot_spacing / 2)
    most = result.chi2 * (1 / result.chi2_per_dof + (1 - BY_ROUTE) * (1 - 1 / result.chi2_per_dof))
    with progress("fitting the route on finer knots", METHODS[method][1]) as advance:
        again = fit_spline(fine, advance, hopeless=most)
    if not again.converged or again.chi2 > most:
        return result, problem
    return replace(again, ambiguous_side=result.ambiguous_side, seconds=result.seconds + again.seconds), fine


def fit_agreeing(result: FitResult, problem: Problem, method: str, disputed: list[str]) -> tuple[FitResult, Problem]:
    """Fit again without anchors that all others and the tracks contradict; where it is not clear which, say so.

    What is said of them is added to `disputed`. Where the model does not explain the data, it and not an anchor may be
    wrong: all anchors stay, and what they miss widens the sigmas.
    """
    while result.converged and result.chi2_per_dof < EXPLAINED and (found := contradiction(problem, result)):
        disputed.append(found.sentence)
        if len(found.suspects) > 1 or len(problem.anchors) < 2:
            break
        disputed[-1] += "; it is left out"
        rest = [one for one in problem.anchors if one not in found.suspects]
        again, problem = fit_sides([replace(shortened(problem, slice(None), result), anchors=rest)], method)
        result = replace(again, ambiguous_side=reopened(result.ambiguous_side, again, problem))
    return result, problem


def other_unit(record: DASRecord, passes: Sequence[Pass], priors: Mapping[str, float]) -> str:
    """Say in which unit tracks would follow a record that they do not follow, as the end of a sentence; empty: in none.

    Parameters
    ----------
    priors : prior means of depth, m, and Poisson's ratio
    """
    for factor, words in ((FOOT, "x and y of the trajectories"), (1 / FOOT, "gauge_length and channel_spacing")):
        scaled = [
            replace(one, **{name: factor * getattr(one, name) for name in ("position", "velocity", "sigma")})
            for one in passes
        ]
        try:
            find_first_routes(record, scaled, [], **priors, warnings=[])
        except InputError:
            continue
        return f"; they would follow if {words} were in feet: give them in m"
    return ""


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
    parts = {one.base_part for one in asked}
    if survey.tracks is None:
        raise InputError(f"{survey.name}: has a camera only; track its video first and give the trajectories")
    timings = {"read": survey.seconds}
    record = survey.record
    check_gauge(record)
    warnings = [*record.cautions, *survey.cautions]
    check_apart(survey.anchors, record.channel_spacing)
    anchors = in_record(survey.anchors, record, warnings)
    heard = replace(record, strain_rate=dithered(record.strain_rate, record.rounding))
    shown = shorter_gauges(filtered(heard, filters))
    with timed(timings, "smooth"):
        passes = smooth_passes(survey.tracks, record, warnings=warnings)
        if "wheels" in parts:
            warnings += not_known([one.vehicle_class for one in passes])
        else:
            passes = [replace(one, vehicle_class="vehicle") for one in passes]
    ground = survey.ground
    if slow := slow_line(record, passes):
        warnings.append(slow)
    with timed(timings, "match"):
        priors = {"depth": ground.depth[0], "poisson_ratio": ground.poisson_ratio}
        try:
            found = find_first_routes(shown, passes, anchors, **priors, warnings=warnings)
        except InputError as error:
            why = other_unit(shown, passes, priors) or suspicions(record, passes)
            raise InputError(f"{error}{why}") from error
    every = passes
    if unlisted:
        with timed(timings, "listen"):
            every = with_unlisted(shown, found, passes, priors, warnings)
        if "wheels" not in parts:
            every = [replace(one, vehicle_class="vehicle") for one in every]
    prior = Prior(depth=ground.depth, poisson_ratio=(ground.poisson_ratio, Prior.poisson_ratio[1]))
    dead = dead_channels(heard, found.channel)
    if len(dead):
        warnings.append(
            f"channels {ranges(dead)} are nearly silent where their neighbors record vehicles; they are left out, and "
            "the route there depends on their neighbors"
        )
    begun = pose(record, every, found.anchors, found.routes[0], found.channel, prior, dead)
    # All starts share noise and samples, so that their misfits compare.
    alive = np.isin(found.channel, begun.channel)
    posed = [replace(begun, start=start[alive]) for start in found.routes]
    more, curved = tuple(one for one in asked if not one.base_part), "bends" in parts
    recorded = (int(record.channel[0]), int(record.channel[-1]))
    problems = [with_slow_errors(replace(one, effects=more, curved=curved, coil=found.coil)) for one in posed]
    whole, choice = problems[0], None
    if not all_passes and len(whole.passes) > MANY and not is_long(whole):
        with timed(timings, "choose"), progress("choosing passes", len(whole.passes)) as advance:
            choice = choose(whole, advance)
        if choice.taken:
            problems = [only(one, choice.numbers) for one in problems]
    if method != "network":
        require_room_to_fit(problems[0])
    if record.rounding:
        warnings += told(record.rounding.at(posed[0].channel - record.channel[0]), posed[0].noise.numpy())
    disputed = list(found.disputed)
    with timed(timings, "fit"):
        result, problem = fit_straight(*fit_sides(problems, method), method, recorded, warnings)
        result, problem = fit_finely(result, problem, method)
        result, problem = fit_agreeing(result, problem, method, disputed)
    if (seen := sum(not is_heard(one) for one in problem.passes)) < FEW:
        count = "one pass" if seen == 1 else f"{seen} passes"
        warnings.append(
            f"{count} only: an error of a track goes straight into the route, and no other vehicle checks it; "
            "survey at least four passes, in both directions"
        )
    with timed(timings, "held_out"), progress("fitting without some passes", FOLDS) as advance:
        again = shortened(problem, slice(None), result)
        chain = Chain.of(again)
        ended = (chain, chain.state_of(torch.from_numpy(result.vector)))
        rest = untaken(again, whole, choice)
        unseen = held_out(again, advance, at=ended, rest=rest) if method == "spline" else None
    told_choice = None
    if choice is not None and choice.taken:
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
        warnings=warnings + disputed,
        disputed=disputed,
        known=known,
        choice=told_choice,
    )


def untaken(problem: Problem, whole: Problem, choice: Choice | None) -> Problem | None:
    """The survey of passes that were not chosen, over the channels of the problem that was fitted; None without any."""
    if choice is None or not choice.taken or not choice.others:
        return None
    columns = np.isin(whole.channel, problem.channel)
    every = replace(problem, record=whole.record[:, columns], passes=whole.passes, traffic=whole.traffic)
    return only(every, choice.others)
