"""From the end of a fit to what is reported: covariance, what data and not priors decided, parameters."""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from solver.fit.least_squares import PER_PASS, Linearized, MapFit, State
from solver.fit.problem import Problem
from solver.fit.result import FitResult, Parameter

UNITS = {"amplitude": "m^2", "along": "m", "across": "m", "wheelbase": "m", "front_share": "1"}


@dataclass(frozen=True)
class Posterior:
    """Gaussian approximation of the posterior at a state (Laplace).

    Parameters
    ----------
    covariance : [free, free], scaled by the mean squared misfit of data or anchors where that is more than noise
    prior_part : [free, free], the part of `covariance` that priors decide; the rest is data and anchors
    shape_part : [free, free], the part of it that the prior on the route's shape decides
    weight : [sample, channel], of each sample
    model : [sample, channel], 1/s
    chi2 : weighted misfit of the whitened residual
    chi2_per_dof : the same over degrees of freedom
    """

    covariance: Tensor
    prior_part: Tensor
    shape_part: Tensor
    weight: Tensor
    model: Tensor
    chi2: float
    chi2_per_dof: float

    @classmethod
    def at(cls, fit: MapFit, state: State, near: Linearized) -> "Posterior":
        """The posterior of a problem that is linearized `near` its end."""
        matrix, _, weights = fit.normal_of(state, near)
        covariance = torch.linalg.inv(matrix)
        prior_part = covariance @ fit.prior_matrix(state) @ covariance
        shape_part = covariance @ fit.shape_matrix(state.coefficients) @ covariance
        chi2 = near.misfit
        freedom = float((weights.good * weights.soft).sum() - torch.trace((covariance - prior_part) @ matrix))
        per_dof = chi2 / max(freedom, 1.0)
        # Unmodeled physics is at least as wrong as the misfit it leaves in the data or at the anchors (Birge ratio).
        missed = fit.route_rows(state.coefficients)[1].residual
        scale = max(1.0, per_dof, float((missed**2).sum()) / max(len(missed), 1))
        weight = weights.good * weights.soft
        return cls(covariance * scale, prior_part * scale, shape_part * scale, weight, near.model, chi2, per_dof)


def route_covariance(fit: MapFit, covariance: Tensor, distance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Covariance [channel, 3, 3] of route points at `distance` [channel], m, from that of the parameters."""
    size = fit.basis.size
    block = covariance[: 3 * size, : 3 * size].reshape(size, 3, size, 3).numpy()
    basis = fit.basis.at(distance)
    return np.einsum("ci,iajb,cj->cab", basis, block, basis, optimize=True)


def lateral_share(route: NDArray[np.float64], total: NDArray[np.float64], prior: NDArray[np.float64]) -> NDArray:
    """Share [channel] of the variance across the route, in the horizontal plane, that the prior does not decide."""
    tangent = np.gradient(route[:, :2], axis=0)
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], 1) / np.linalg.norm(tangent, axis=1, keepdims=True)
    across = [np.einsum("ca,cab,cb->c", normal, c[:, :2, :2], normal) for c in (total, prior)]
    return np.asarray(1 - across[1] / across[0])


def parameters(problem: Problem, state: State, fit: MapFit, covariance: Tensor) -> dict[str, Parameter]:
    """Every fitted number but the route's, by name."""
    sigma = torch.zeros_like(fit.mean)
    sigma[fit.free] = covariance.diagonal().sqrt()
    names = [(f"{name}[{one.track_id}]", UNITS[name]) for name in PER_PASS for one in problem.passes]
    names.append(("poisson_ratio", "1"))
    for slot in fit.extension.slots:
        name, count = f"{slot.effect.name}.{slot.parameter.name}", slot.where.stop - slot.where.start
        names += [(name if count == 1 else f"{name}[{i}]", slot.parameter.unit) for i in range(count)]
    values = state.vector()
    first = len(values) - len(names)
    return {
        name: Parameter(float(values[first + i]), float(sigma[first + i]), unit, bool(fit.free[first + i]))
        for i, (name, unit) in enumerate(names)
    }


def assemble(
    problem: Problem,
    fit: MapFit,
    state: State,
    *,
    method: str,
    iterations: int,
    seconds: float,
    converged: bool,
    near: Linearized | None = None,
) -> FitResult:
    """What a fit that ended in `state` reports; `near` is the problem linearized there, where that is known."""
    posterior = Posterior.at(fit, state, near or fit.linearized(state))
    channel = problem.route_channel
    distance = problem.distance_of(channel)
    route = fit.basis.at(distance) @ state.coefficients.numpy()
    total = route_covariance(fit, posterior.covariance, distance)
    prior = route_covariance(fit, posterior.prior_part, distance)
    shape = route_covariance(fit, posterior.shape_part, distance)
    share = 1 - np.diagonal(prior, axis1=1, axis2=2) / np.diagonal(total, axis1=1, axis2=2)
    model = torch.where(problem.measured, posterior.model, torch.nan)
    return FitResult(
        method=method,
        channel=channel,
        distance=distance,
        route=route,
        covariance=total,
        constrained=lateral_share(route, total, shape) > 0.5,
        data_share=share,
        parameters=parameters(problem, state, fit, posterior.covariance),
        vector=state.vector().numpy(),
        samples=problem.traffic.samples,
        fitted_channel=problem.channel,
        measured=problem.strain_rate.numpy(),
        model=model.numpy(),
        noise=problem.noise.numpy(),
        weight=posterior.weight.numpy(),
        law=problem.law,
        chi2=posterior.chi2,
        chi2_per_dof=posterior.chi2_per_dof,
        ambiguous_side=False,
        iterations=iterations,
        seconds=seconds,
        converged=converged,
    )
