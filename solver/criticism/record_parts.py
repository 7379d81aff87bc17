"""A record in parts, one after the other: what candidates share of each takes little memory at any length."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from solver.fit.state import Linearized, State, Weights
from solver.fit.windowed import Windowed
from solver.noise.sample_runs import blocks_of
from solver.noise.whitening import Whitener
from solver.signal_path.extension import Values
from solver.signal_path.local import Section
from solver.signal_path.observation import BRIDGE, bridged
from solver.signal_path.signal_path import SignalPath
from solver.signal_path.traffic import columns as vehicles_by_row

if TYPE_CHECKING:
    from solver.fit.map_fit import MapFit

#: What each sample of a map depends on: the vehicles at it, those of its stretch of the record, or on anything.
Reach = Literal["sample", "stretch", "record"]
#: Bytes of local derivatives above which a record is taken in parts, and of each part, about.
WHOLE, EACH = 1e8, 2e7


@dataclass(frozen=True)
class RecordPart:
    """A part of a record, or all of it.

    Parameters
    ----------
    reach : of the effects that are told by such parts
    section : its samples, those before it that its noise is told from, and the rows at them; None: all
    first : its own first sample
    lead : how many samples before that are looked back at
    fit : whose record it is
    weights : of all its samples
    """

    reach: Reach
    section: Section | None
    first: int
    lead: int
    fit: "MapFit"
    weights: Weights

    @cached_property
    def whitener(self) -> Whitener:
        """Makes the noise of maps [..., sample, channel] white, samples looked back at before its own."""
        if self.section is None:
            return self.fit.whiten
        problem = self.fit.problem
        samples = problem.traffic.samples[self.section.samples]
        return Whitener(problem.noise, samples, problem.channel, problem.law, self.lead)

    def jacobian(self, state: State, values: Values) -> Windowed:
        """Derivatives [its own sample * channel, free] by all that is free, whitened and weighted."""
        assert self.section is not None
        fit, rows = self.fit, self.section.rows
        fiber = fit.fiber(state, values)
        local = fit.path.sensitivities(fiber, state.vehicles, state.poisson_ratio, values, rows)
        maps = fit.free_columns(state, local, values, self.section)
        return Windowed.through_each(maps, self.white, fit.whiten.memory)

    def white(self, maps: Tensor) -> Tensor:
        """Whitened, weighted maps [column, its own sample, channel]."""
        return self._weighing(maps)

    @cached_property
    def _weighing(self) -> Callable[[Tensor], Tensor]:
        """What whitens and weighs maps of this part."""
        good, soft = self.weights.good, self.weights.soft
        if self.section is None:
            return self.whitener.weighing(good, soft.sqrt())
        samples = self.section.samples
        return self.whitener.weighing(good[samples], soft[self.first : samples.stop].sqrt())


def linearized(fit: "MapFit", state: State) -> tuple[Linearized, list[RecordPart]]:
    """A fit near a state, with its local derivatives left out, and the parts of its record, the last the whole of it.

    The Jacobian of a long record is made part by part, so that no more of the local derivatives is ever held.
    """
    values = fit.values(state)
    size = local_bytes(fit, state, values)
    if size <= WHOLE or reach_of(fit.path, values) != "sample":
        at = fit.linearized(state)
        return replace(at, local=at.local.shifts), [RecordPart("record", None, 0, 0, fit, at.weights)]
    evaluation = fit.glance(state)
    weights, residual = fit.weighted(evaluation)
    parts, channels = record_parts(fit, weights, size), fit.data.shape[1]
    pieces = ((one.first * channels, one.jacobian(state, values)) for one in parts if one.reach == "sample")
    jacobian = Windowed.stacked(pieces, fit.data.numel(), int(fit.free.sum()))
    residual = (residual * weights.soft.sqrt()).flatten()
    return Linearized(jacobian, residual, weights, evaluation.model, evaluation.local), parts


def local_bytes(fit: "MapFit", state: State, values: Values) -> float:
    """Bytes of the derivatives of each gauge by each vehicle, about: by its points and by the wheels."""
    rows = state.vehicles.rows(fit.path.traffic)
    points = fit.path.gauges(fit.fiber(state, values), values).points.shape[1]
    wheels = fit.path.loads(vehicles_by_row(rows), values).share.shape[-1]
    return 8.0 * len(rows.amplitude) * len(fit.ends.ahead) * (7 * points + 3 * wheels + 8)


def record_parts(fit: "MapFit", weights: Weights, size: float) -> list[RecordPart]:
    """Parts of a fit's record with about as many rows of vehicles each, stretches of it, and then the whole of it.

    Parameters
    ----------
    size : bytes of all local derivatives
    """
    traffic, whole = fit.path.traffic, RecordPart("record", None, 0, 0, fit, weights)
    count, samples = int(np.ceil(size / EACH)), traffic.samples
    total = np.cumsum(np.bincount(traffic.sample_index.numpy(), minlength=len(samples)))
    wanted = np.searchsorted(total, total[-1] * np.arange(1, count) / count)
    opening = np.concatenate([np.full(run.stop - run.start, run.start) for run in blocks_of(samples)])

    def cut(reach: Reach, at: NDArray[np.int64]) -> list[RecordPart]:
        cuts = np.unique([0, *at, len(samples)]).tolist()
        leads = [min(first - int(opening[first]), fit.whiten.memory) for first in cuts[:-1]]
        return [
            RecordPart(reach, Section.of(traffic, slice(first - lead, stop)), first, lead, fit, weights)
            for (first, stop), lead in zip(pairwise(cuts), leads, strict=True)
        ]

    # A filter in time begins anew at each stretch, before which the noise is not told either.
    starts = np.array([one.start for one in bridged(samples, round(BRIDGE * fit.problem.sampling_rate))])
    closed = cut("stretch", starts[np.searchsorted(starts, wanted, "right") - 1])
    return [*cut("sample", wanted), *(closed if len(closed) > 1 else []), whole]


def reach_of(path: SignalPath, values: Values) -> Reach:
    """What each sample of the map depends on."""
    if path.extension.traffic is not None:
        return "record"
    stages = path.described(values or path.extension.local(path.extension.numbers()))
    return "stretch" if stages.in_time or stages.processing.steps or stages.nonlinear else "sample"
