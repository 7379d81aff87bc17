"""How much wider a route's corridor is with what its model may lack.

An explanation moves the route by d with probability p: about the fitted route that adds p d d' to the covariance (law
of total covariance, with the fit's own for each). Effects too small to show may still move it, by their posterior size:
Schmidt's consider covariance (Schmidt 1966, Adv. Control Syst. 3, 293), with the probability that they are there.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from solver.criticism.explanations import Posterior, priors
from solver.criticism.policy import POLICY
from solver.criticism.route_change import moves
from solver.criticism.score import Score

if TYPE_CHECKING:
    from solver.criticism.bench import Bench
    from solver.criticism.refit import Refit

Array = NDArray[np.float64]

#: Probability below which an explanation does not show.
LEAST = 1e-6


@dataclass(frozen=True)
class Corridor:
    """What is added to a route's covariance.

    Parameters
    ----------
    channel : [channel]
    covariance : [channel, 3, 3], m^2, to be added to the fit's
    widest : name of the effect that adds most; "" where nothing does
    share : of what is added, by that effect
    """

    channel: NDArray[np.int64]
    covariance: Array
    widest: str
    share: float

    @classmethod
    def of(cls, bench: "Bench", tried: Mapping[str, "Refit"], posterior: Posterior) -> "Corridor":
        """What the explanations of a fit add, as fitted in full, else as the score test predicts."""
        scorer = bench.scorer
        known = sum(not score.effect.generic for score in bench.table)
        prior = priors(POLICY, known, 1, 1)["effect"]
        shown = {one.effects[0]: one.probability for one in posterior.weighed if one.effects}
        parts: dict[str, Array] = {}
        for score in bench.table:
            name, probability = score.effect.name, shown.get(score.effect.name, 0.0)
            if probability < LEAST and score.effect.generic:
                continue
            move = moves(bench, name, tried)
            if move is None or not np.isfinite(move).all():
                continue
            weight = probability if probability > LEAST else prior * hidden_size(score)
            parts[name] = weight * move[:, :, None] * move[:, None, :]
        channel = scorer.fit.problem.channel
        none = np.zeros((len(channel), 3, 3))
        total = sum(parts.values(), none)
        sizes = {name: float(np.trace(part, axis1=1, axis2=2).mean()) for name, part in parts.items()}
        widest = max(sizes, key=lambda name: sizes[name], default="")
        whole = sum(sizes.values())
        return cls(channel, total, widest if whole > 0 else "", sizes[widest] / whole if whole > 0 else 0.0)

    def with_move(self, name: str, move: Array) -> "Corridor":
        """The same about a route that moves [channel, 3], m, once a fault of that name is mended."""
        more = move[:, :, None] * move[:, None, :]
        mine, others = (float(np.trace(one, axis1=1, axis2=2).mean()) for one in (more, self.covariance))
        if mine > others * self.share:
            return Corridor(self.channel, self.covariance + more, name, mine / (mine + others))
        share = others * self.share / (mine + others) if others > 0 else 0.0
        return Corridor(self.channel, self.covariance + more, self.widest, share)

    def at(self, channel: NDArray[np.int64]) -> Array:
        """What is added [channel, 3, 3] at channels; where one was not fitted, as at the nearest that was."""
        near = np.abs(self.channel[None] - np.asarray(channel)[:, None]).argmin(1)
        return np.asarray(self.covariance[near])


def hidden_size(score: Score) -> float:
    """Mean square of an effect's size where it does not show, in squares of what it came out as.

    Noise leaves open, of a plausible size squared, its variance over that and the information; summed over numbers.
    """
    sizes = np.repeat([p.plausible for p in score.effect.amplitudes], score.counts)
    heard = np.isfinite(score.sigma)
    found = float(np.sum((score.estimate[heard] / sizes[heard]) ** 2))
    left = score.variance / (score.variance + score.spectrum.information)
    return float(left.sum() / found) if found > 0 else 0.0
