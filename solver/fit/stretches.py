"""A long survey as stretches of fiber, each with the vehicles near it at the time they are near it."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise, zip_longest

import numpy as np
from numpy.typing import NDArray

from solver.fit.longest import is_one_stretch
from solver.fit.problem import MARGIN, Problem
from solver.noise.sample_runs import blocks_of
from solver.signal_path.traffic import Traffic
from solver.survey.limits import vehicle_reach
from solver.trajectory.vehicle_pass import Pass

#: How long before and after each pass the record is looked at, s: what filters leave behind shows there.
TAIL = 4.0
#: Stretches of a longer fiber, m. A vehicle has numbers of its own in each: over some seconds of driving tracks err
#: alike, farther on neither their errors nor the coupling of the ground are the same.
STRETCH = 60.0
#: Passes of each stretch that a long fiber is fitted to first: they lead near, and all then need few steps.
FIRST = 12
#: Passes of one stretch whose noise is taken to hang together, however close they follow one another.
TOGETHER = 60


def nearby(one: Pass, route: NDArray[np.float64], reach: float) -> Pass | None:
    """The part of a pass within `reach` of the route [channel, 3], m; None where it never comes that near."""
    low, high = route[:, :2].min(0) - reach, route[:, :2].max(0) + reach
    boxed = np.flatnonzero(((one.position >= low) & (one.position <= high)).all(1))
    distance = np.hypot(*(one.position[boxed, None, :] - route[None, :, :2]).transpose(2, 0, 1)).min(1, initial=np.inf)
    rows = boxed[distance <= reach]
    if len(rows) < 2:
        return None
    keep = slice(rows[0], rows[-1] + 1)
    return replace(
        one, **{name: getattr(one, name)[keep] for name in ("rows", "position", "velocity", "sigma", "in_view")}
    )


def around(passes: Sequence[Pass], samples: int, margin: int) -> np.ndarray:
    """Rows up to `margin` before and after each pass, within a record of so many samples.

    >>> around([], 10, 2)
    array([], dtype=int64)
    """
    rows = [np.arange(one.rows[0] - margin, one.rows[-1] + margin + 1) for one in passes]
    every = np.unique(np.concatenate(rows)) if rows else np.empty(0, np.int64)
    return every[(every >= 0) & (every < samples)]


def part(problem: Problem, chosen: NDArray[np.int64]) -> Problem:
    """The same survey with the passes `chosen` only."""
    passes = [problem.passes[i] for i in chosen]
    return replace(problem, passes=passes, traffic=Traffic.of(passes))


def is_long(problem: Problem) -> bool:
    """Whether a survey is fitted stretch by stretch."""
    return not is_one_stretch(float(problem.distance[-1] - problem.distance[0]))


def stretches(problem: Problem) -> list[slice]:
    """Fitted channels of each stretch, about equally long.

    >>> from types import SimpleNamespace
    >>> [(s.start, s.stop) for s in stretches(SimpleNamespace(distance=np.arange(0.0, 300.0)))]
    [(0, 60), (60, 120), (120, 180), (180, 240), (240, 300)]
    """
    length = float(problem.distance[-1] - problem.distance[0])
    count = max(1, round(length / STRETCH)) if not is_one_stretch(length) else 1
    cuts = np.searchsorted(problem.distance, problem.distance[0] + length * np.arange(1, count) / count)
    edges = [0, *cuts.tolist(), len(problem.distance)]
    return [slice(a, b) for a, b in pairwise(edges) if b > a]


def reach_of(problem: Problem) -> float:
    """How far along the fiber a stretch's model looks beyond its channels, m."""
    return problem.gauge_length / 2 + problem.channel_spacing + (MARGIN if problem.effects else 0.0)


def crowds(passes: Sequence[Pass]) -> list[list[Pass]]:
    """Passes that share samples of the record, or go on where another ends.

    >>> from types import SimpleNamespace
    >>> made = [SimpleNamespace(rows=np.arange(*ends)) for ends in ((0, 5), (9, 12), (4, 7))]
    >>> [[len(one.rows) for one in crowd] for crowd in crowds(made)]
    [[5, 3], [3]]
    """
    found: list[list[Pass]] = []
    last = -1
    for one in sorted(passes, key=lambda one: int(one.rows[0])):
        if found and one.rows[0] <= last + 1:
            found[-1].append(one)
        else:
            found.append([one])
        last = max(last, int(one.rows[-1]))
    return found


def some(group: Sequence[Problem], most: int) -> list[Problem]:
    """Small problems of a stretch with about so many passes: those of single vehicles first, both ways by turns.

    >>> from types import SimpleNamespace as Some
    >>> made = [Some(passes=[Some(speed=v) for v in speeds]) for speeds in ([9, -8], [12], [14], [-11])]
    >>> [[one.speed for one in part.passes] for part in some(made, 2)]
    [[12], [-11]]
    """
    ways: tuple[list[Problem], list[Problem]] = [], []
    for one in sorted(group, key=lambda part: len(part.passes)):
        ways[one.passes[0].speed < 0].append(one)
    chosen: list[Problem] = []
    for one in (part for pair in zip_longest(*ways) for part in pair if part is not None):
        if sum(len(part.passes) for part in chosen) < most:
            chosen.append(one)
    return chosen


def one_by_one(problem: Problem) -> list[Problem]:
    """A survey of one stretch crowd by crowd, each with its share of the samples: together they are the whole.

    Only the problem itself where effects may mix what vehicles do, or where they are not in the order of time.
    """
    first = [int(one.rows[0]) for one in problem.passes]
    groups = crowds(problem.passes)
    if len(groups) < 2 or first != sorted(first) or not all(one.slow_error for one in problem.effects):
        return [problem]
    samples = problem.traffic.samples
    begin = np.array([min(one.rows[0] for one in group) for group in groups])
    # Samples before the first crowd of a gapless run are that crowd's.
    run = samples[[block.start for block in blocks_of(samples)]]
    opening = run[np.searchsorted(run, begin, side="right") - 1]
    begin = np.where(np.append(True, opening[1:] != opening[:-1]), opening, begin)
    owner = np.maximum(np.searchsorted(begin, samples, side="right") - 1, 0)
    return [
        replace(problem, passes=group, traffic=Traffic.of(group, samples[owner == number]), anchors=())
        for number, group in enumerate(groups)
    ]


def looked_back_at(problem: Problem, group: Sequence[Problem]) -> list[NDArray[np.int64]]:
    """Samples before each of a survey's crowds that its noise is told from: as many as the noise remembers.

    None where a gap in the samples, or very many passes, part it from those before.
    """
    samples, memory = problem.traffic.samples, len(problem.law.own) - 1
    found, passes = [], 0
    opening = np.concatenate([np.full(b.stop - b.start, b.start) for b in blocks_of(samples)])
    for one in group:
        first = int(np.searchsorted(samples, one.traffic.samples[0]))
        back = samples[max(int(opening[first]), first - memory) : first]
        passes = passes + len(one.passes) if len(back) else len(one.passes)
        if passes > TOGETHER:
            back, passes = back[:0], len(one.passes)
        found.append(back)
    return found


def parts(problem: Problem) -> list[list[Problem]]:
    """The survey of each stretch, crowd by crowd: small problems that together are the whole.

    Stretches without a vehicle are left out: nothing is measured there.
    """
    cuts = stretches(problem)
    if len(cuts) == 1:
        return [one_by_one(problem)]
    found, reach = [], vehicle_reach(problem.gauge_length)
    for cut in cuts:
        start = problem.start[cut]
        here = replace(
            problem,
            record=problem.record[:, cut],
            noise=problem.noise[cut],
            channel=problem.channel[cut],
            start=start,
            anchors=(),
        )
        near = [part for one in problem.passes if (part := nearby(one, start, reach)) is not None]
        groups = [list(near)] if near and problem.effects else crowds(near)
        found.append([replace(here, passes=group, traffic=Traffic.of(group)) for group in groups])
    return [stretch for stretch in found if stretch]
