"""A run of a stretch of a long fiber, fitted by itself: a model is criticized over such stretches."""

from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import torch

from solver.fit.chain import Chain
from solver.fit.held_out import held_out
from solver.fit.longest import ONE_STRETCH
from solver.fit.pose import FEWEST, shortened, with_slow_errors
from solver.fit.problem import Problem
from solver.fit.spline import fit_spline
from solver.fit.stretches import TAIL, around, nearby
from solver.run.facts import fitted_facts
from solver.run.report.joined import facts_in
from solver.run.report.report_words import told
from solver.run.run import Run
from solver.run.strict_json import strict
from solver.signal_path.traffic import Traffic
from solver.survey.limits import vehicle_reach
from vision.contract import InputError


def stretches_of(run: Run) -> list[tuple[int, int]]:
    """First and last channel of stretches of a run that are short enough, about equally long.

    The whole run where it is short enough itself.
    """
    problem = run.problem
    length = float(problem.distance[-1] - problem.distance[0])
    count = max(1, int(np.ceil(length / ONE_STRETCH)))
    edges = problem.distance[0] + length * np.arange(1, count) / count
    parts = np.split(problem.channel, np.searchsorted(problem.distance, edges))
    return [(int(part[0]), int(part[-1])) for part in parts if len(part) > FEWEST]


def stretch_of(run: Run, first: int, last: int, advance: Callable[[int], None] = lambda n: None) -> Run:
    """The run of the channels `first` to `last` of a long run, from whose route on it is fitted by itself.

    Tracks have the slow errors that a short run gives them. Vehicles that come near no channel of it are left out.

    Parameters
    ----------
    run : located with `--method spline`
    first, last : channels, as the DAS file counts
    advance : called with 1 after each step of the fit and each group of passes held out

    Raises
    ------
    InputError
        If it has too few channels, no vehicle comes near it, or it is itself too long.
    """
    problem = shorter(run, first, last)
    result = fit_spline(problem, advance)
    problem = shortened(problem, slice(None), result)
    chain = Chain.of(problem)
    unseen = held_out(problem, advance, at=(chain, chain.state_of(torch.from_numpy(result.vector))))
    facts = run.facts | fitted_facts(result, problem, unseen, [])
    facts |= {
        "active_channels": [int(result.fitted_channel[0]), int(result.fitted_channel[-1])],
        "anchors": [asdict(one) for one in problem.anchors],
        "notes": [f"channels {first} to {last} of a longer run", *run.facts["notes"]],
    }
    found = replace(
        run,
        result=result,
        problem=problem,
        passes=list(problem.passes),
        anchors=list(problem.anchors),
        time=problem.time_of(result.samples),
        facts=strict(facts),
        added=None,
        folder=None,
        rungs=(),
    )
    return told(found)


def folder_of(part: Run) -> str:
    """Name of the folder of a stretch, in that of the whole run."""
    return f"channels-{part.problem.channel[0]}-{part.problem.channel[-1]}"


def saved(part: Run, folder: Path) -> Path:
    """The run folder of a stretch in that of the whole run, written unless it is there: its pages then stay."""
    at = folder / folder_of(part)
    if facts_in(at, "fit.json").get("created") != part.facts["created"]:
        part.save(at)
    return at


def shorter(run: Run, first: int, last: int) -> Problem:
    """The survey of a stretch of a run, with the vehicles near it at the time they are near it."""
    whole = run.problem
    keep = (whole.channel >= first) & (whole.channel <= last)
    name = f"channels {first} to {last}"
    if keep.sum() <= FEWEST:
        ends = f"{whole.channel[0]} to {whole.channel[-1]}"
        raise InputError(f"{name}: {keep.sum()} of them are fitted, too few for a route; the run has {ends}")
    cut = shortened(whole, slice(*np.flatnonzero(keep)[[0, -1]] + [0, 1]), run.result)
    if cut.distance[-1] - cut.distance[0] > ONE_STRETCH:
        length = cut.distance[-1] - cut.distance[0]
        raise InputError(f"{name}: {length:.0f} m of fiber, and {ONE_STRETCH:.0f} m can be fitted as one; give fewer")
    reach = vehicle_reach(whole.gauge_length)
    passes = [part for one in whole.passes if (part := nearby(one, cut.start, reach)) is not None]
    if not passes:
        raise InputError(f"{name}: no vehicle comes near; give channels beside the road that was driven")
    traffic = Traffic.of(passes, around(passes, len(cut.record), round(TAIL * cut.sampling_rate)))
    anchors = [one for one in whole.anchors if first <= one.channel <= last]
    return with_slow_errors(replace(cut, passes=passes, traffic=traffic, anchors=anchors))
