"""What a fit reports: covariance, the share that data and not priors decided, parameters."""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.special import ndtri, stdtrit
from torch import Tensor

from solver.fit.chain import Chain
from solver.fit.corners import find_corners
from solver.fit.map_fit import MapFit
from solver.fit.normal import Reduced
from solver.fit.normal_parts import Block
from solver.fit.parameter_layout import PER_PASS, of_route
from solver.fit.prior import FREEDOM
from solver.fit.problem import Problem
from solver.fit.result import FitResult, Parameter
from solver.fit.state import State
from solver.fit.visit import Visit
from solver.trajectory.vehicle_pass import Pass

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: By how much the prior's part of a place's variance is wider than the Gaussian that is as sharp at its mode: slope and
#: curvature are Student t, and 95 % of that lie within its own quantile.
TAILS = float(stdtrit(FREEDOM, 0.975) / ndtri(0.975)) ** 2 * (FREEDOM + 1) / FREEDOM
UNITS = {"amplitude": "m^2", "along": "m", "across": "m", "wheelbase": "m", "front_share": "1"}


#: Channels of a stretch [channel] bool, numbers that all vehicles share, derivatives [channel, 3, number] by those.
Moves = tuple[NDArray[np.bool_], NDArray[np.int64], NDArray[np.float64]]
#: Knot intervals whose covariance is computed at once.
INTERVALS = 8


@dataclass(frozen=True)
class Posterior:
    """Gaussian approximation of the posterior at a visit (Laplace), from the factored normal equations.

    Parameters
    ----------
    chain, visit : the fit and its end
    """

    chain: Chain
    visit: Visit

    @cached_property
    def reduced(self) -> Reduced:
        """The normal equations, factored."""
        return self.visit.normal.reduced()

    def columns(self, where: NDArray[np.int64]) -> NDArray[np.float64]:
        """Columns [shared, where] of the covariance of what all vehicles share, not scaled."""
        unit = np.zeros((len(self.reduced.right), len(where)))
        unit[where, np.arange(len(where))] = 1.0
        return self.reduced.factor.solved(unit)

    @cached_property
    def shape(self) -> "csr_array":
        """Normal matrix [shared, shared] of the prior on the route's shape alone."""
        return self._sparse(
            Block(one.route.start, one.rows.jacobian.shape[1], np.zeros(0, int), one.gram)
            for one in self.chain.prior.shape(self.visit.state.coefficients)
            if not self.chain.prior.held
        )

    @cached_property
    def priors(self) -> "csr_array":
        """Normal matrix [shared, shared] of the priors on what is shared, anchors left out."""
        precision = self.chain.prior.precision(self.visit.state)[self.chain.border].numpy()
        border = Block(0, 0, np.arange(len(precision)), np.diag(precision))
        return self.shape + self._sparse([border])

    @cached_property
    def through_vehicles(self) -> "csr_array":
        """What the priors on the vehicles decide of what they share with the route, [shared, shared]."""
        normal = self.visit.normal
        sums = [np.zeros_like(one.matrix) for one in normal.blocks]
        for part, (across, _) in zip(normal.parts, self.reduced.lifts, strict=True):
            sums[part.stretch] += across.T @ (part.precision[:, None] * across)
        return self._sparse(one.of(total) for one, total in zip(normal.blocks, sums, strict=True))

    def _sparse(self, blocks: Iterable[Block]) -> "csr_array":
        from scipy.sparse import coo_array

        size, band = len(self.visit.normal.right), self.visit.normal.size
        found = [(one.where(band), one.matrix) for one in blocks]
        row = [np.repeat(where, len(where)) for where, _ in found]
        column = [np.tile(where, len(where)) for where, _ in found]
        values = [matrix.ravel() for _, matrix in found]
        none: list[NDArray] = [np.zeros(0)]
        index = np.concatenate(row or none).astype(int), np.concatenate(column or none).astype(int)
        return coo_array((np.concatenate(values or none), index), shape=(size, size)).tocsr()

    @cached_property
    def own_covariance(self) -> list[NDArray[np.float64]]:
        """Covariance [own, own] of the parameters of each link that no other has, not scaled."""
        normal, found = self.visit.normal, []
        inside: dict[int, NDArray[np.float64]] = {}
        for part, (across, _) in zip(normal.parts, self.reduced.lifts, strict=True):
            if part.stretch not in inside:
                where = normal.blocks[part.stretch].where(normal.size)
                inside[part.stretch] = self.columns(where)[where]
            found.append(np.linalg.inv(part.own) + across @ inside[part.stretch] @ across.T)
        return found

    @cached_property
    def border_covariance(self) -> NDArray[np.float64]:
        """Covariance of what all stretches share beside the route, [border, border], not scaled."""
        where = self.visit.normal.size + np.arange(self.visit.normal.border)
        return self.columns(where)[where]

    @cached_property
    def decided(self) -> float:
        """Number of parameters that data and anchors decide: the free ones, less the priors' share of them."""
        normal = self.visit.normal
        free = len(normal.right) + sum(len(part.own) for part in normal.parts)
        prior = sum(
            float(np.diagonal(covariance) @ part.precision)
            for covariance, part in zip(self.own_covariance, normal.parts, strict=True)
        )
        border = self.chain.prior.precision(self.visit.state)[self.chain.border].numpy()
        prior += float(np.diagonal(self.border_covariance) @ border)
        return free - prior - self._shape_trace

    @cached_property
    def _shape_trace(self) -> float:
        total = 0.0
        for one in self.chain.prior.shape(self.visit.state.coefficients):
            if self.visit.normal.size:
                where = one.where.numpy()
                total += float((self.columns(where)[where] * one.gram).sum())
        return total

    @cached_property
    def chi2_per_dof(self) -> float:
        """Weighted misfit over degrees of freedom."""
        samples = sum(float((weights.good * weights.soft).sum()) for weights in self.visit.weights)
        return self.visit.misfit / max(samples - self.decided, 1.0)

    @cached_property
    def scale(self) -> float:
        """Factor of all covariances: unmodeled physics errs at least by the misfit that it leaves.

        In the data or at the anchors (Birge ratio).
        """
        missed = [one.rows.residual for one in self.chain.prior.anchored(self.visit.state)]
        square = sum(float((miss**2).sum()) for miss in missed)
        return max(1.0, self.chi2_per_dof, square / max(sum(map(len, missed)), 1))

    def moves(self, distance: NDArray[np.float64]) -> Iterator[Moves]:
        """How the route at `distance` [channel], m, moves with what all vehicles share, stretch by stretch."""
        basis, state = self.chain.basis, self.visit.state
        place, by_number, other = self.chain.prior.led(state, distance)
        border = self.visit.normal.size + self.chain.rank(other)
        at = place.clamp(basis.start, basis.stop).numpy()
        tangent = basis.along(state.coefficients.numpy(), at, 1)
        interval = basis.interval(at)
        for first in range(0, basis.intervals, INTERVALS):
            here = (interval >= first) & (interval < first + INTERVALS)
            if not here.any():
                continue
            part = basis.part(first, min(first + INTERVALS, basis.intervals))
            spline = of_route(first, part.size)
            where = np.concatenate([np.arange(spline.start, spline.stop), border])
            moves = tangent[here][:, :, None] * by_number.numpy()[here][:, None, :]
            yield (
                here,
                where,
                np.concatenate([np.kron(part.at(at[here]), np.eye(3)).reshape(len(moves), 3, -1), moves], 2),
            )

    def route(self, distance: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
        """Route [channel, 3] of the fiber that counts as `distance` [channel], m, and covariances [channel, 3, 3].

        The whole covariance, the prior's part of it, and that of shape alone.
        """
        basis, coefficients = self.chain.basis, self.visit.state.coefficients.numpy()
        place = self.chain.prior.led(self.visit.state, distance)[0]
        at = place.clamp(basis.start, basis.stop).numpy()
        route = basis.along(coefficients, at) + basis.along(coefficients, at, 1) * (place.numpy() - at)[:, None]
        out = tuple(np.full((len(distance), 3, 3), np.nan) for _ in range(3))
        for here, where, by in self.moves(distance):
            columns = self.columns(where)
            decided = columns.T @ (self.priors @ columns) + columns.T @ (self.through_vehicles @ columns)
            for total, block in zip(out, (columns[where], decided, columns.T @ (self.shape @ columns)), strict=True):
                total[here] = self.scale * (by @ block @ by.transpose(0, 2, 1))
        return route, *out

    def shared(self, distance: NDArray[np.float64], covariance: NDArray[np.float64]) -> NDArray[np.float64]:
        """Share [3] of the variance of x, y and z that places have in common: that of their mean error.

        Parameters
        ----------
        distance : [channel], m
        covariance : [channel, 3, 3], m^2, of each place
        """
        mean = np.zeros((len(self.reduced.right), 3))
        for _, where, by in self.moves(distance):
            mean[where] += by.sum(0).T / len(distance)
        common = self.scale * np.einsum("na,na->a", mean, self.reduced.factor.solved(mean))
        return np.asarray(common / np.einsum("caa->a", covariance) * len(distance))

    def sigmas(self) -> Tensor:
        """Standard deviation [parameter] of all but the route; 0 where it is fixed."""
        sigma = torch.zeros_like(self.chain.mean)
        sigma[self.chain.border] = torch.from_numpy(np.sqrt(self.scale * np.diagonal(self.border_covariance)))
        for where, covariance in zip(self.chain.own_places, self.own_covariance, strict=True):
            sigma[where] = torch.from_numpy(np.sqrt(self.scale * np.diagonal(covariance)))
        return sigma


def lateral_share(route: NDArray[np.float64], total: NDArray[np.float64], prior: NDArray[np.float64]) -> NDArray:
    """Share [channel] of the variance across the route, in the horizontal plane, that the prior does not decide."""
    tangent = np.gradient(route[:, :2], axis=0)
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], 1) / np.linalg.norm(tangent, axis=1, keepdims=True)
    across = [np.einsum("ca,cab,cb->c", normal, c[:, :2, :2], normal) for c in (total, prior)]
    return np.asarray(1 - across[1] / across[0])


def gauge_coverage(problem: Problem, channel: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which places [channel] lie within the gauge of a fitted channel.

    Elsewhere the fiber may turn without a trace: what the prior on its shape makes of channels and anchors farther off
    is no measurement, however sharp.
    """
    at = np.searchsorted(problem.channel, channel).clip(1, len(problem.channel) - 1)
    apart = np.minimum(np.abs(channel - problem.channel[at - 1]), np.abs(channel - problem.channel[at]))
    return np.asarray(apart * problem.channel_spacing <= problem.gauge_length / 2)


def names_of(chain: Chain) -> list[tuple[str, str]]:
    """Name and unit of every fitted number but the route's."""
    passes = legs(chain.passes)
    names = [(f"{name}[{one}]", UNITS[name]) for name in PER_PASS for one in passes]
    names.append(("poisson_ratio", "1"))
    for slot, place in zip(chain.links[0].fit.extension.slots, chain.slots, strict=True):
        count = len(place)
        name = f"{slot.effect.name}.{slot.parameter.name}"
        names += [(name if count == 1 else f"{name}[{i}]", slot.parameter.unit) for i in range(count)]
    return names


def legs(passes: Sequence[Pass]) -> list[str]:
    """Names of vehicles; of one that is fitted in several stretches, with where it is in each.

    >>> from types import SimpleNamespace
    >>> legs([SimpleNamespace(track_id=name, position=np.full((1, 2), x)) for name, x in (("7", 3.2), ("7", 64.0))])
    ['7 at x 3 m', '7 at x 64 m']
    """
    known = Counter(one.track_id for one in passes)
    return [
        one.track_id if known[one.track_id] == 1 else f"{one.track_id} at x {one.position[:, 0].mean():.0f} m"
        for one in passes
    ]


def parameters(posterior: Posterior, known: bool = True) -> dict[str, Parameter]:
    """Every fitted number but the route's, by name; without sigmas where these are not `known`."""
    chain = posterior.chain
    names, sigma, values = names_of(chain), posterior.sigmas(), posterior.visit.state.vector()
    sigma = sigma if known else torch.full_like(sigma, torch.nan)
    first = chain.layout["route"].stop
    return {
        name: Parameter(float(values[first + i]), float(sigma[first + i]), unit, bool(chain.free[first + i]))
        for i, (name, unit) in enumerate(names)
    }


def maps(chain: Chain, visit: Visit) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Model, 1/s, and weight of each sample [sample, channel] of a survey; NaN and 0 where nothing was fitted."""
    problem = chain.problem
    if len(chain.links) == 1:
        weights = visit.weights[0]
        whole = torch.where(problem.measured, visit.models[0], torch.nan)
        return whole.numpy(), (weights.good * weights.soft).numpy()
    shape = len(problem.traffic.samples), len(problem.channel)
    kind = np.float32 if chain.long else np.float64
    model: NDArray = np.full(shape, np.nan, kind)
    weight: NDArray = np.zeros(shape, kind)
    for link, part, weights in zip(chain.links, visit.models, visit.weights, strict=True):
        row = np.searchsorted(problem.traffic.samples, link.fit.problem.traffic.samples)
        column = np.searchsorted(problem.channel, link.fit.problem.channel)
        model[np.ix_(row, column)] = torch.where(link.fit.measured, part, torch.nan).numpy()
        weight[np.ix_(row, column)] = (weights.good * weights.soft).numpy()
    return model, weight


def assemble(
    problem: Problem,
    fit: MapFit | Chain,
    state: State,
    *,
    method: str,
    iterations: int,
    seconds: float,
    converged: bool,
    near: Visit | None = None,
) -> FitResult:
    """Result of a fit that ended in `state`; `near` is the visit there, if known."""
    chain = fit if isinstance(fit, Chain) else Chain.single(fit)
    posterior = Posterior(chain, near or chain.visit(state))
    state, channel = posterior.visit.state, problem.route_channel
    distance = problem.distance_of(channel)
    route, total, prior, shape = posterior.route(distance)
    tails = (TAILS - 1) * shape
    share = 1 - np.diagonal(prior, axis1=1, axis2=2) / np.diagonal(total, axis1=1, axis2=2)
    constrained = (lateral_share(route, total, shape) > 0.5) & gauge_coverage(problem, channel) & converged
    shared = posterior.shared(distance[constrained], total[constrained]) if constrained.any() else None
    model, weight = maps(chain, posterior.visit)
    return FitResult(
        method=method,
        channel=channel,
        distance=distance,
        route=route,
        # Where a fit has not ended its sigmas say nothing, so that it has none, and no place counts as decided by data.
        covariance=total + tails if converged else np.full_like(total, np.nan),
        tails=tails,
        constrained=constrained,
        data_share=share,
        parameters=parameters(posterior, known=converged),
        vector=state.vector().numpy(),
        samples=problem.traffic.samples,
        fitted_channel=problem.channel,
        measured=problem.strain_rate.numpy(),
        model=model,
        noise=problem.noise.numpy(),
        weight=weight,
        law=problem.law,
        chi2=posterior.visit.misfit,
        chi2_per_dof=posterior.chi2_per_dof,
        cost=chain.cost(posterior.visit),
        ambiguous_side=False,
        iterations=iterations,
        seconds=seconds,
        converged=converged,
        shared=None if shared is None else (float(shared[1]), float(shared[2])),
        corners=find_corners(posterior, *problem.distance[[0, -1]]) if converged else (),
    )
