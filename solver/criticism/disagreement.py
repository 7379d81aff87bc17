"""How far the parts of a record disagree about the route, over how far noise makes them.

Where a fit ends, each part b of its record still pulls it by g_b = J_b' r_b, and all together cancel. Of noise alone,
g_b has the covariance H_b - H_b H^-1 H_b, with H_b = J_b' J_b and the normal matrix H. The squares of the route's moves
H^-1 g_b over what they then would be are a Birge ratio of what moves the route, where chi2 over its freedom is one of
the whole record: a model may leave little, all of which moves the route. Clusters and their moves are those of the
sandwich (Liang and Zeger 1986, Biometrika 73, 13). A wrong model that pulls all parts alike does not show in it.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from solver.criticism.directions import Directions
from solver.criticism.score import Score
from solver.fit.map_fit import MapFit
from solver.fit.state import State
from solver.fit.windowed import Windowed

Array = NDArray[np.float64]

#: Clusters of samples for each pass.
CLUSTERS = 2
#: Ways of the route that are looked at together.
FEW = 16
#: Share of the largest singular value below which a way of the route is none, and least variance of a place, m^2.
RANK, LEAST = 1e-6, 1e-12


@dataclass(frozen=True)
class Disagreement:
    """How far parts of a record disagree about the route.

    Parameters
    ----------
    factor : mean square of how far they move it, over that of noise alone; about 1 where nothing is missing
    covariance : of the route if nothing is missing [channel, 3, 3], m^2
    """

    factor: float
    covariance: Array

    @classmethod
    def of(cls, scorer: Directions, score: Score | None = None) -> "Disagreement":
        """At the end of a fit, which may be one linear step away; where a score's effect is in the model, too."""
        samples = scorer.fit.data
        # The anchors' rows are below those of the record.
        record = scorer.jacobian.between(0, samples.numel())
        rest = scorer.residual[: samples.numel()] - record.times(scorer.step)
        if score is not None:
            rest = rest - scorer.changed(score).flatten()
        ways, covariance = ways_of_route(scorer)
        found = expected = 0.0
        for first, last in clusters(record, ways, samples.shape[1], CLUSTERS * len(scorer.fit.problem.passes)):
            cluster = record.between(first, last)
            seen = cluster.times(ways)
            pull = cluster.transposed_times(Windowed.whole(seen))
            fitted = torch.linalg.solve_triangular(scorer.factor, pull, upper=False)
            found += float((seen @ rest[first:last]).square().sum())
            expected += float(seen.square().sum() - fitted.square().sum())
        return cls(found / expected if expected > 0 else 1.0, covariance)

    @property
    def added(self) -> Array:
        """What it adds to the route's covariance [channel, 3, 3], m^2."""
        return max(self.factor - 1, 0.0) * self.covariance


def ways_of_route(scorer: Directions) -> tuple[Tensor, Array]:
    """Ways [way, fitted] by which a pull moves the route, in its sigmas, and its covariance [channel, 3, 3], m^2."""
    by = torch.from_numpy(route_derivative(scorer.fit, scorer.state))
    moves = by.new_zeros(len(by), 3, len(scorer.factor))
    moves[:, :, : scorer.fitted] = by
    pulled = torch.cholesky_solve(moves.flatten(0, 1).T, scorer.factor).T.reshape(moves.shape)
    covariance = pulled @ moves.mT
    variances, axes = torch.linalg.eigh(covariance)
    in_sigmas = axes.mT @ pulled / variances.clamp_min(LEAST).sqrt()[:, :, None]
    _, values, ways = torch.linalg.svd(in_sigmas.flatten(0, 1), full_matrices=False)
    kept = values > RANK * values.max()
    return values[kept, None] * ways[kept], covariance.numpy()


def route_derivative(fit: MapFit, state: State) -> Array:
    """Derivatives [channel, 3, free] of the places of fitted channels by all that is fitted."""
    place, by_number, other = fit.prior.led(state, fit.problem.distance)
    at = place.clamp(fit.basis.start, fit.basis.stop).numpy()
    tangent = fit.basis.along(state.coefficients.numpy(), at, 1)
    by = np.zeros((len(at), 3, fit.layout.size))
    by[:, :, fit.layout["route"]] = np.kron(fit.basis.at(at), np.eye(3)).reshape(len(at), 3, -1)
    by[:, :, other.numpy()] += tangent[:, :, None] * by_number.numpy()[:, None, :]
    return by[:, :, fit.free.numpy()]


def clusters(record: Windowed, ways: Tensor, channels: int, count: int) -> Iterator[tuple[int, int]]:
    """Rows [first, last) of so many clusters of whole samples that tell about as much of the route each."""
    told = torch.zeros(record.rows, dtype=torch.float64)
    for some in ways.split(FEW):
        told += record.times(some).square().sum(0)
    total = told.reshape(-1, channels).sum(1).cumsum(0).numpy()
    edges = np.searchsorted(total, total[-1] * np.arange(1, count) / count)
    for first, last in pairwise(np.unique([0, *edges, len(total)])):
        yield int(first) * channels, int(last) * channels
