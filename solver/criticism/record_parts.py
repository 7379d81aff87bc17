"""A record in parts, one after the other: what candidates share of each takes little memory at any length."""

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from torch import Tensor

from solver.fit.state import Weights
from solver.noise.sample_runs import blocks_of
from solver.noise.whitening import Whitener
from solver.signal_path.extension import Values
from solver.signal_path.local import Section
from solver.signal_path.signal_path import SignalPath

if TYPE_CHECKING:
    from solver.fit.map_fit import MapFit

#: Bytes of local derivatives above which a record is taken in parts, and of each part, about.
WHOLE, EACH = 1e8, 2e7


@dataclass(frozen=True)
class RecordPart:
    """A part of a record, or all of it.

    Parameters
    ----------
    section : its samples, those before it that its noise is told from, and the rows at them; None: all
    first : its own first sample
    lead : how many samples before that are looked back at
    fit : whose record it is
    weights : of all its samples
    """

    section: Section | None
    first: int
    lead: int
    fit: "MapFit"
    weights: Weights

    @property
    def whitener(self) -> Whitener:
        """Makes the noise of maps [..., sample, channel] white, samples looked back at before its own."""
        if self.section is None:
            return self.fit.whiten
        problem = self.fit.problem
        samples = problem.traffic.samples[self.section.samples]
        return Whitener(problem.noise, samples, problem.channel, problem.law, self.lead)

    def white(self, maps: Tensor) -> Tensor:
        """Whitened, weighted maps [column, its own sample, channel]."""
        if self.section is None:
            return self.fit.whiten(maps * self.weights.good) * self.weights.soft.sqrt()
        samples = self.section.samples
        return self.whitener(maps * self.weights.good[samples]) * self.weights.soft[self.first : samples.stop].sqrt()


def record_parts(fit: "MapFit", weights: Weights, size: float) -> list[RecordPart]:
    """Parts of a fit's record with about as many rows of vehicles each, and then the whole of it.

    The whole alone where that is small, or where no part can be told by itself.

    Parameters
    ----------
    size : bytes of all local derivatives
    """
    traffic, whole = fit.path.traffic, RecordPart(None, 0, 0, fit, weights)
    if size <= WHOLE or not apart(fit.path, {}):
        return [whole]
    count, samples = int(np.ceil(size / EACH)), traffic.samples
    total = np.cumsum(np.bincount(traffic.sample_index.numpy(), minlength=len(samples)))
    cuts = np.unique([0, *np.searchsorted(total, total[-1] * np.arange(1, count) / count), len(samples)]).tolist()
    opening = np.concatenate([np.full(run.stop - run.start, run.start) for run in blocks_of(samples)])
    parts = []
    for first, stop in pairwise(cuts):
        lead = min(first - int(opening[first]), fit.whiten.memory)
        parts.append(RecordPart(Section.of(traffic, slice(first - lead, stop)), first, lead, fit, weights))
    return [*parts, whole]


def apart(path: SignalPath, values: Values) -> bool:
    """Whether each sample of the map depends on the vehicles at that sample alone."""
    scopes = {slot.parameter.scope for slot in path.extension.slots}
    if path.extension.traffic is not None or "time" in scopes:
        return False
    stages = path.described(values or path.extension.local(path.extension.numbers()))
    return not (stages.in_time or stages.processing.steps or stages.nonlinear)
