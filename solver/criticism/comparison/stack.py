"""The residual as each vehicle carries it along: stacked by the distance ahead of it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.criticism.comparison.cells import Cells, strength
from solver.run.run import Run

Array = NDArray[np.float64]

#: Reach and width of the stack's bins, m, and into how many groups of channels it is cut.
REACH, WIDTH, GROUPS = 40.0, 1.0, 4


@dataclass(frozen=True)
class Stack:
    """Residual and model in the vehicle's frame, in units of the stacked model's peak.

    Parameters
    ----------
    ahead : [bin], m ahead of the vehicle along the fiber; the bins are symmetric about 0
    channels : [group, 2], first and last channel; the first group is all of them
    measured, model, residual : [group, bin]; NaN where no channel was at that distance
    symmetric, antisymmetric : [group, bin], parts of the residual
    sigma : [group, bin], of the residual if the noise were white
    """

    ahead: Array
    channels: NDArray[np.int64]
    measured: Array
    model: Array
    residual: Array
    symmetric: Array
    antisymmetric: Array
    sigma: Array


def stack_of(run: Run, cells: Cells) -> Stack:
    """Stack measured, model and residual in the vehicle's frame, by least squares over cells of unequal strength.

    Bin k holds sum(A d / s^2) / sum(A^2 / s^2) over its cells, with the strength A of the vehicle (`strength`) and the
    noise s of the channel.
    """
    result = run.result
    edges = np.arange(-REACH - WIDTH / 2, REACH + WIDTH, WIDTH)
    inside = cells.there & (np.abs(cells.approach.ahead) < edges[-1])
    place = np.floor((cells.approach.ahead[inside] - edges[0]) / WIDTH).astype(int)
    group = np.broadcast_to(np.arange(len(result.fitted_channel)) * GROUPS // len(result.fitted_channel), inside.shape)
    drive = strength(run, cells)
    scaled = result.weight / result.noise**2
    size = len(edges) - 1

    def sums(values: Array) -> Array:
        flat = np.bincount(group[inside] * size + place, values[inside], GROUPS * size).reshape(GROUPS, size)
        return np.vstack([flat.sum(0), flat])

    norm = sums(scaled * drive**2)
    measured, model = (
        np.divide(
            sums(np.where(inside, scaled * drive * part, 0.0)), norm, out=np.full_like(norm, np.nan), where=norm > 0
        )
        for part in (result.measured, result.model)
    )
    peak = float(np.nanmax(np.abs(model[0]))) if np.isfinite(model[0]).any() else 1.0
    measured, model = measured / (peak or 1.0), model / (peak or 1.0)
    sigma = np.divide(1 / (peak or 1.0), np.sqrt(norm), out=np.full_like(norm, np.nan), where=norm > 0)
    residual = measured - model
    first = [int(result.fitted_channel[group[0] == g][0]) for g in range(GROUPS) if (group[0] == g).any()]
    last = [int(result.fitted_channel[group[0] == g][-1]) for g in range(GROUPS) if (group[0] == g).any()]
    kept = [0, *(g + 1 for g in range(GROUPS) if (group[0] == g).any())]
    return Stack(
        ahead=(edges[1:] + edges[:-1]) / 2,
        channels=np.array([(first[0], last[-1]), *zip(first, last, strict=True)]),
        measured=measured[kept],
        model=model[kept],
        residual=residual[kept],
        symmetric=((residual + residual[:, ::-1]) / 2)[kept],
        antisymmetric=((residual - residual[:, ::-1]) / 2)[kept],
        sigma=sigma[kept],
    )
