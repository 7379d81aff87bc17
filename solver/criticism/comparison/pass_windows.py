"""What is shown of a pass with its surroundings, and when a region that fails lies in it."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from solver.criticism.comparison.regions import Region
from solver.noise.sample_runs import blocks_of
from solver.run.report.misfit import nearest_channel, rows_of
from solver.run.seen import Seen
from solver.trajectory.vehicle_pass import Pass

Array = NDArray[np.float64]
AROUND = 6.0  # seconds before and after a pass that its picture shows


def shown(run: Seen, one: Pass) -> Pass:
    """The pass with the fitted samples shortly before and after it among its rows: what else went by is seen there."""
    samples, rows = run.result.samples, rows_of(run.result, one)
    if not len(rows):
        return one
    block = next(b for b in blocks_of(samples) if b.start <= rows[0] < b.stop)
    seconds = run.time[block]
    inside = (seconds >= run.time[rows[0]] - AROUND) & (seconds <= run.time[rows[-1]] + AROUND)
    return replace(one, rows=np.union1d(samples[block][inside], samples[rows]))


def path_of(run: Seen, one: Pass) -> tuple[Array, Array]:
    """Time [row], s, and channel [row] nearest to the vehicle, NaN beyond the fitted ones."""
    return run.time[rows_of(run.result, one)], nearest_channel(run.result, one)[np.isin(one.rows, run.result.samples)]


def touches(region: Region, run: Seen, number: int) -> tuple[float, float] | None:
    """First and last second of a region in a pass, None where it is elsewhere.

    That is while its vehicle drives by the region's channels, a gauge length before and after included. A region that
    no vehicle made has a time of its own.
    """
    one = run.passes[number]
    seconds, path = path_of(run, one)
    if not len(seconds):
        return None
    if region.time is not None and region.kind == "unseen":
        whole = run.time[rows_of(run.result, shown(run, one))]
        first, last = max(region.time[0], whole[0]), min(region.time[1], whole[-1])
        return (float(first), float(last)) if first <= last else None
    margin = run.facts["settings"]["gauge_length"] / run.facts["settings"]["channel_spacing"]
    by = seconds[(path >= region.channels[0] - margin) & (path <= region.channels[1] + margin)]
    return (float(by[0]), float(by[-1])) if len(by) and one.track_id in region.passes else None
