"""Where along the fiber the model does not explain what vehicles leave, and what that does to the route there."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from solver.criticism.comparison.cells import cells_of
from solver.criticism.comparison.region_search import regions_of
from solver.criticism.comparison.regions import Region
from solver.criticism.route_change import route_of
from solver.fit.chain import Chain
from solver.fit.least_squares import solve
from solver.fit.map_fit import MapFit
from solver.fit.posterior import Posterior
from solver.run.fitted import fitted
from solver.run.geojson import runs
from solver.run.report.report_words import told
from solver.run.run import Run
from solver.run.run_corridor import median_half
from solver.run.trust import DIAGNOSE, Gate, with_gate

Array = NDArray[np.float64]

#: Kinds of regions that are about channels; the others are about one shape of the signal, or a vehicle nobody listed.
OF_CHANNELS = ("gain", "late", "place", "offset", "power")
#: Share of the channels beyond which a failure is not local: it is the model's, and the misfit's check tells it.
LOCAL = 0.5


def unexplained(run: Run, regions: Sequence[Region]) -> NDArray[np.bool_]:
    """Channels [channel] whose gauge holds what several vehicles leave; none where that is most of the fiber.

    What a single vehicle leaves is about that vehicle.
    """
    result, settings = run.result, run.facts["settings"]
    half = settings["gauge_length"] / settings["channel_spacing"] / 2
    found = np.zeros(len(result.channel), bool)
    for one in regions:
        if one.kind in OF_CHANNELS and (len(one.passes) > 1 or len(run.passes) == 1):
            first, last = one.channels
            found |= (result.channel >= first - half) & (result.channel <= last + half)
    return found if found.mean() <= LOCAL else np.zeros_like(found)


def without(run: Run, lost: NDArray[np.bool_]) -> Array | None:
    """What is added to the route's covariance [channel, 3, 3], m^2, by not believing some channels [channel].

    The covariance of a fit that lacks their data, and the square of the way that the route moves with it. None where
    that fit does not converge.
    """
    fit, state = fitted(run)
    problem, channel = fit.problem, run.result.channel
    record = np.array(problem.record, dtype=np.float64)
    record[:, np.isin(problem.channel, channel[lost])] = np.nan
    rest = MapFit(replace(problem, record=record))
    end = solve(rest, state)
    if not end.converged:
        return None
    move = route_of(rest, end.state, channel) - run.result.route
    _, wide, _, _ = Posterior(Chain.single(rest), end.at).route(problem.distance_of(channel))
    more = wide - run.result.covariance
    values, vectors = np.linalg.eigh((more + more.transpose(0, 2, 1)) / 2)
    more = (vectors * np.maximum(values, 0.0)[:, None, :]) @ vectors.transpose(0, 2, 1)
    return np.asarray(more + move[:, :, None] * move[:, None, :])


def gate_of(run: Run, lost: NDArray[np.bool_]) -> Gate:
    """The check that every part of the fiber is explained, given the channels [channel] that are not."""
    if not lost.any():
        return Gate("places", "passed", "no place stands out")
    channel, x = run.result.channel, run.result.route[:, 0]
    parts = [(channel[a], channel[b], *sorted((x[a], x[b]))) for a, b in runs(lost) if lost[a]]
    where = "at channels " + ", ".join(f"{first} to {last}" for first, last, _, _ in parts)
    place = ", ".join(f"{low:.0f} to {high:.0f} m" for _, _, low, high in parts)
    words = f"the model does not explain what vehicles leave at x = {place}"
    return Gate("places", "failed", words, (DIAGNOSE,), where=where)


def with_local_misfit(run: Run) -> Run:
    """The run with its local misfit told.

    Channels that the model does not explain are not constrained, the check of places enters the sentence of trust, and
    a corridor that holds what the model may lack is that of a fit without their data there.
    """
    if run.too_long:
        return run
    lost = unexplained(run, regions_of(run, cells_of(run)))
    facts = run.facts | {"trust": with_gate(run.facts["trust"], gate_of(run, lost))}
    result = replace(run.result, constrained=run.result.constrained & ~lost)
    run = replace(run, result=result, facts=facts)
    if lost.any() and run.added is not None and (more := without(run, lost)) is not None:
        run = replace(run, added=run.added + more)
        corridor = run.facts["corridor"] | {"half_width": median_half(run.place)}
        run = replace(run, facts=run.facts | {"corridor": corridor})
    return told(run)
