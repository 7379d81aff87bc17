"""Whether a fit has room in memory."""

from bisect import bisect_right
from itertools import pairwise

import numpy as np

from solver.fit.convoy import KEPT
from solver.fit.problem import Problem
from solver.fit.stretches import is_long, one_by_one, part
from solver.survey.memory import available, require_memory

#: Bytes that a fit takes: whatever it is of, by each number of the model's map (a vehicle's sample on a channel), and
#: by each of them and each pass that is worked on at once. Measured on 8 to 40 passes over 51 to 98 channels, all at
#: once (0.4 to 4.4 GB); right within 25 %.
ALWAYS, BY_CELL, BY_CELL_AND_PASS = 9.4e7, 5.05e3, 376.0
#: Bytes by each sample on a channel, where crowds are worked on one by one: residuals, weights and models.
BY_SAMPLE = 300.0


def fit_memory(problem: Problem, channels: int) -> float:
    """Bytes that a fit of some of its channels takes at its largest: two crowds at once, and what is kept of all."""
    crowds = [(len(one.traffic.pass_index), len(one.passes)) for one in one_by_one(problem)]
    both = [tuple(np.add(a, b)) for a, b in pairwise(crowds)] or crowds
    largest = max(rows * channels * (BY_CELL + BY_CELL_AND_PASS * passes) for rows, passes in both)
    if len(crowds) == 1:
        return ALWAYS + largest
    kept = min(KEPT, BY_CELL_AND_PASS * sum(rows for rows, _ in crowds) * channels)
    return ALWAYS + largest + kept + BY_SAMPLE * len(problem.traffic.samples) * channels


def require_room_to_fit(problem: Problem) -> None:
    """Refuse a survey whose fit does not fit into memory; a long fiber is fitted stretch by stretch and always does.

    Raises
    ------
    InputError
        Says how many channels, or how many passes, would.
    """
    if is_long(problem):
        return
    channels, passes = len(problem.channel), len(problem.passes)
    needed, room = fit_memory(problem, channels), available()
    if needed <= room:
        return
    fewer = bisect_right(range(1, channels), room, key=lambda n: fit_memory(problem, n))

    def first(count: int) -> float:
        return fit_memory(part(problem, np.arange(count)), channels)

    require_memory(
        needed,
        f"fitting {channels} channels and {passes} passes",
        f"name {fewer} channels at most, channels = [first, last], in [das] of site.toml, or give the tracks "
        f"of {bisect_right(range(1, passes), room, key=first)} passes",
    )
