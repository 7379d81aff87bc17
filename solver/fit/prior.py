"""What is known of a route before the data speak, as least-squares rows."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from solver.cable.fiber import SplineBasis
from solver.survey.anchors import Anchor


@dataclass(frozen=True)
class Prior:
    """What is known before the data speak; a standard deviation of 0 fixes a value.

    Parameters
    ----------
    depth : mean and standard deviation of the fiber's mean depth, m
    depth_slope : sd of the fiber's slope along the road
    curvature, depth_curvature : sd of horizontal and vertical curvature over `PATCH`, 1/m
    stretch : sd of the route's length per meter of fiber
    poisson_ratio : mean and sd
    along, across : size of a whole track's errors along travel and sideways, m; the passes themselves correct it, see
        `track_precision`
    track_freedom : degrees of freedom of the priors on `along` and `across`
    jitter : sd of the coefficients of each track's slow error, where that is in the model (`track_jitter`), m
    effect_sd : sd of effects' numbers as the survey itself states them, by effect and parameter, as "track_offset.x"
    """

    depth: tuple[float, float] = (0.9, 0.3)
    depth_slope: float = 0.03
    curvature: float = 0.02
    depth_curvature: float = 0.005
    stretch: float = 0.001
    poisson_ratio: tuple[float, float] = (0.25, 0.03)
    along: float = 0.5
    across: float = 0.05
    track_freedom: float = 2.0
    jitter: float = 0.3
    effect_sd: Mapping[str, float] = field(default_factory=dict)


#: Length over which slope and curvature of a route are one independent value, m.
PATCH = 10.0
#: Degrees of freedom of the priors on slope and curvature: ducts lie straight and turn at corners, so that most of a
#: route bends little and some places much.
FREEDOM = 2.0
#: Least depth that a route is expected to have, and sd of that limit, m.
SHALLOW, SHALLOW_SD = 0.2, 0.02


def track_precision(errors: Tensor, size: float, freedom: float) -> Tensor:
    """Precision [], 1/m^2, of the prior on every pass's error, given the errors [pass], m, of all.

    The size of the errors is not known, only expected: scaled-inverse-chi-square with `freedom` degrees of freedom.
    Integrated over it the passes' errors are jointly Student-t (O'Hagan 1979, J. R. Stat. Soc. B 41, 358), which pulls
    on each as a Gaussian of this precision does: tracks that are all off loosen each other.

    >>> none, far = torch.zeros(6, dtype=torch.float64), torch.ones(6, dtype=torch.float64)
    >>> [round(float(track_precision(errors, 0.05, 2.0)) ** -0.5, 3) for errors in (none, far)]
    [0.025, 0.866]
    """
    return (freedom + len(errors)) / (freedom * size**2 + (errors**2).sum())


def track_cost(errors: Tensor, size: float, freedom: float) -> float:
    """-2 ln of that Student-t density of errors [pass], m, but for a constant."""
    return float((freedom + len(errors)) * torch.log1p((errors**2).sum() / (freedom * size**2)))


@dataclass(frozen=True)
class Rows:
    """Residuals [row], in their standard deviations, and their derivative [row, 3 * coefficients]."""

    residual: Tensor
    jacobian: Tensor

    @classmethod
    def linear(
        cls, matrix: Tensor, coefficients: Tensor, axis: int, target: Tensor | float, sd: Tensor | float
    ) -> "Rows":
        """(matrix @ coefficients[:, axis] - target) / sd."""
        jacobian = torch.zeros(len(matrix), *coefficients.shape, dtype=torch.float64)
        jacobian[:, :, axis] = matrix / torch.as_tensor(sd, dtype=torch.float64).reshape(-1, 1)
        return cls((matrix @ coefficients[:, axis] - target) / sd, jacobian.flatten(1))

    @classmethod
    def heavy_tailed(cls, matrix: Tensor, coefficients: Tensor, axes: list[int]) -> "Rows":
        """Vectors matrix @ coefficients[:, axes] [place, axis] of a Student t density of `FREEDOM` degrees of freedom.

        -2 ln of it is rho(q) = (FREEDOM + axes) ln(1 + q / FREEDOM) of the square q of a vector v. The rows are
        v (rho(q) / q)^(1/2), whose squares sum to rho.
        """
        value, dims = matrix @ coefficients[:, axes], len(axes)
        q = (value**2).sum(1, keepdim=True).clamp_min(1e-12)
        rho, slope = (FREEDOM + dims) * torch.log1p(q / FREEDOM), (FREEDOM + dims) / (FREEDOM + q)
        gain = (rho / q).sqrt()
        # d gain / dq = (rho' - rho / q) / (2 q gain)
        bent = (slope - rho / q) / (q * gain)
        by = gain[..., None] * torch.eye(dims, dtype=value.dtype) + bent[..., None] * value[:, :, None] * value[:, None]
        jacobian = torch.zeros(len(matrix), dims, matrix.shape[1], 3, dtype=value.dtype)
        jacobian[..., axes] = by[:, :, None, :] * matrix[:, None, :, None]
        return cls((gain * value).flatten(), jacobian.flatten(0, 1).flatten(1))

    @classmethod
    def stack(cls, rows: Sequence["Rows"]) -> "Rows":
        """All rows, one after the other."""
        return cls(torch.cat([r.residual for r in rows]), torch.cat([r.jacobian for r in rows]))


def shape_grid(basis: SplineBasis) -> NDArray[np.float64]:
    """Distances [place], m, along a route at which its shape is compared with the prior: twice per interval."""
    breaks = basis.breaks
    return np.interp(np.arange(2 * basis.intervals + 1) / 2, np.arange(len(breaks)), breaks)


def shape_rows(basis: SplineBasis, prior: Prior, coefficients: Tensor) -> Rows:
    """Mean depth, slope, curvature, length and burial of a spline route against the prior.

    Slope and curvature are white along the fiber with one independent value per `PATCH`; the length rows hold
    |dr/ds| = 1, so that distance along the route is distance along the fiber. The burial rows, softplus of
    (SHALLOW / z - 1) SHALLOW / SHALLOW_SD, keep a route below the surface: 0 where it is deep and without bound toward
    z = 0, as a hard limit would stop a fit before it converges.

    Parameters
    ----------
    coefficients : [coefficient, 3], m
    """
    grid = shape_grid(basis)
    value, slope, bend = (torch.from_numpy(basis.at(grid, order)) for order in range(3))
    # The grid samples each interval twice; this keeps the weight of one value per patch.
    edges = np.concatenate([grid[:1], (grid[1:] + grid[:-1]) / 2, grid[-1:]])
    density = torch.from_numpy(np.diff(edges) / PATCH)[:, None] ** 0.5
    tangent = slope @ coefficients
    length = tangent.norm(dim=1)
    stretch = prior.stretch / density
    length_rows = (tangent / length[:, None])[:, None, :] * slope[:, :, None] / stretch[..., None]
    depth = value @ coefficients[:, 2]
    short_of = (SHALLOW / depth - 1) * SHALLOW / SHALLOW_SD
    burial_rows = torch.zeros_like(length_rows)
    burial_rows[:, :, 2] = -(torch.sigmoid(short_of) * (SHALLOW / depth) ** 2)[:, None] * value / SHALLOW_SD
    return Rows.stack(
        [
            Rows.linear(value.mean(0, keepdim=True), coefficients, 2, *prior.depth),
            Rows.heavy_tailed(slope * density / prior.depth_slope, coefficients, [2]),
            Rows.heavy_tailed(bend * density / prior.curvature, coefficients, [0, 1]),
            Rows.heavy_tailed(bend * density / prior.depth_curvature, coefficients, [2]),
            Rows((length - 1) / stretch[:, 0], length_rows.flatten(1)),
            Rows(torch.nn.functional.softplus(short_of), burial_rows.flatten(1)),
        ]
    )


def anchor_rows(
    basis: SplineBasis, anchors: Sequence[Anchor], distance: Tensor, by_number: Tensor, coefficients: Tensor
) -> Rows:
    """Route at the anchors' distances [anchor], m, against the anchors.

    Parameters
    ----------
    by_number : [anchor, number], derivatives of the distances by numbers of effects, columns after the coefficients'
    """
    matrix, slope = basis.weights(distance), basis.weights(distance, 1) @ coefficients
    found = []
    for axis, name, sigma in zip(range(3), "xyz", ("sigma_xy", "sigma_xy", "sigma_z"), strict=True):
        target, sd = (torch.tensor([getattr(a, of) for a in anchors], dtype=torch.float64) for of in (name, sigma))
        rows = Rows.linear(matrix, coefficients, axis, target, sd)
        moved = slope[:, axis, None] * by_number / sd[:, None]
        found.append(Rows(rows.residual, torch.cat([rows.jacobian, moved], 1)))
    return Rows.stack(found)
