"""How sharply a full fit ends, and so how much of what was plausible before it leaves: Laplace's method.

With H the normal matrix where a fit ends, priors included, the marginal likelihood is the likelihood and the priors
there times |H|^-1/2 (Kass and Raftery 1995, J. Am. Stat. Assoc. 90, 773, section 4.1). Of a candidate's numbers H
leaves I + 1, in plausible sizes, once all else has followed them; what the candidate changes of all else counts too: a
layer of which the route's depth is told less well leaves more depths to choose from.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from solver.criticism.fields import alike
from solver.criticism.marginal import Spectrum
from solver.criticism.sums import load_cost
from solver.effect import Effect
from solver.fit.chain import Chain
from solver.fit.map_fit import MapFit
from solver.fit.visit import Visit
from solver.signal_path.extension import Slot

Array = NDArray[np.float64]

#: Share of a normal matrix's diagonal that rounding may take.
ROUNDING = 1e-12


@dataclass(frozen=True)
class Ending:
    """Where a fit with a candidate ends.

    Parameters
    ----------
    spectrum : what is left of the candidate's numbers, with the score that leads to where they ended
    sharpness : see `solver.criticism.sums.sharpness`, of all else, with `load_cost`
    """

    spectrum: Spectrum
    sharpness: float

    @classmethod
    def of(cls, fit: MapFit, visit: Visit, effect: Effect) -> "Ending":
        """Of a visit with an effect in the model, its shape held where it is."""
        chain = Chain.single(fit)
        matrix, place = normal_matrix(chain, visit)
        slots = [slot for slot in fit.extension.slots if slot.effect is effect]
        amplitudes = [slot for slot in slots if not slot.parameter.is_shape]
        first = chain.layout["numbers"].start
        where, every = (
            np.concatenate([place[numbers_of(slot, first)] for slot in some]) for some in (amplitudes, slots)
        )
        rest = np.setdiff1d(place[place >= 0], every)
        lower = np.linalg.cholesky(matrix[np.ix_(rest, rest)] + np.diag(ROUNDING * np.diagonal(matrix)[rest]))
        across = np.linalg.solve(lower, matrix[np.ix_(rest, where)])
        plausible, ended = sizes(amplitudes, visit.state.numbers)
        left = (matrix[np.ix_(where, where)] - across.T @ across) * plausible[:, None] * plausible - np.eye(len(where))
        # What is fitted with a prior of one plausible size ends at (I + 1)^-1 U, were it linear.
        score = torch.from_numpy(left @ ended + ended)
        counts = [len(numbers_of(slot, 0)) for slot in amplitudes]
        assert fit.extension.scopes is not None
        root = alike(effect, counts, fit.extension.scopes.tracks, passes=True)
        sharp = float(np.log(np.diagonal(lower)).sum()) + load_cost(visit.state.vehicles.amplitude)
        return cls(Spectrum.of_plausible(torch.from_numpy(left), score, root), sharp)


def normal_matrix(chain: Chain, visit: Visit) -> tuple[Array, NDArray[np.int64]]:
    """Normal matrix [free, free] at a visit, and the row in it of each parameter, -1 of those that are not fitted."""
    matrix, _ = visit.normal.dense()
    fitted = torch.cat([torch.arange(chain.size), chain.border, *chain.own_places]).numpy()
    place = np.full(chain.layout.size, -1)
    place[fitted] = np.arange(len(fitted))
    return matrix, place


def numbers_of(slot: Slot, first: int) -> NDArray[np.int64]:
    """Places of a slot's numbers, where the first number of all has that place."""
    return first + np.arange(slot.where.start, slot.where.stop)


def sizes(slots: Sequence[Slot], numbers: Tensor) -> tuple[Array, Array]:
    """Plausible sizes [number] of some slots, and how far `numbers` are from null there, in those."""
    plausible = np.concatenate([np.full(len(numbers_of(slot, 0)), slot.parameter.plausible) for slot in slots])
    null = np.concatenate([np.full(len(numbers_of(slot, 0)), slot.parameter.null) for slot in slots])
    there = np.concatenate([numbers[slot.where].numpy() for slot in slots])
    return plausible, (there - null) / plausible
