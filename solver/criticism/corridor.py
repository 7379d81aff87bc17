"""How much wider a route's corridor is with what its model may lack.

An explanation moves the route by d with probability p: about the fitted route that adds p d d' to the covariance (law
of total covariance, with the fit's own for each). Effects too small to show may still move it, by their posterior size:
Schmidt's consider covariance (Schmidt 1966, Adv. Control Syst. 3, 293), with the probability that they are there. What
moves the route another way at each pass shows as a disagreement, and adds what that is beyond noise.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from solver.criticism.directions import Directions
from solver.criticism.disagreement import Disagreement
from solver.criticism.explanations import Posterior, priors
from solver.criticism.policy import POLICY
from solver.criticism.route_change import moves, route_of
from solver.criticism.score import Score
from solver.run.geojson import normals
from solver.run.run_corridor import DISAGREEMENT, TOLD

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
    across : [channel, 2, 3], unit vectors across the route: sideways and down
    widest : name of the effect that adds most across the route, or `DISAGREEMENT`; "" where nothing does
    share : of what is added, by that
    """

    channel: NDArray[np.int64]
    covariance: Array
    across: Array
    widest: str
    share: float

    @classmethod
    def of(
        cls, bench: "Bench", tried: Mapping[str, "Refit"], posterior: Posterior, away: Array | None = None
    ) -> "Corridor":
        """What the explanations of a fit add, as fitted in full, else as the score test predicts.

        Parameters
        ----------
        away : how far the fit's route is from that which the corridor is of, [channel, 3], m; nowhere where None
        """
        scorer = bench.scorer
        route = route_of(scorer.fit, scorer.state)
        away = np.zeros_like(route) if away is None else away
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
            if probability > LEAST:
                parts[name] = probability * square(away + move)
            else:
                parts[name] = prior * hidden_size(score) * square(move)
        still = 1 - sum(probability for name, probability in shown.items() if name in parts)
        total = sum(parts.values(), max(still, 0.0) * square(away))
        channel, across = scorer.fit.problem.channel, sideways(route)
        sizes = {name: width(part, across) for name, part in parts.items()}
        widest = max(sizes, key=lambda name: sizes[name], default="")
        whole = sum(sizes.values())
        return cls(channel, total, across, widest if whole > 0 else "", sizes[widest] / whole if whole > 0 else 0.0)

    @classmethod
    def own(cls, scorer: Directions) -> "Corridor":
        """What is added where nothing is known but the fit: nothing."""
        channel, across = scorer.fit.problem.channel, sideways(route_of(scorer.fit, scorer.state))
        return cls(channel, np.zeros((len(channel), 3, 3)), across, "", 0.0)

    def with_disagreement(self, bench: "Bench", tried: Mapping[str, "Refit"], posterior: Posterior) -> "Corridor":
        """The same with how far parts of the record disagree beyond noise, with each model as probable as that is.

        An effect that is missing may be why they disagree: they need not where it is in the model.
        """
        scorer, scores = bench.scorer, {score.effect.name: score for score in bench.table}
        total = posterior.unmoved * Disagreement.of(scorer).added
        for one in posterior.weighed:
            if one.kind != "effect" or one.probability < TOLD:
                continue
            name = one.effects[0]
            if name in tried:
                fit, state = tried[name].fit, tried[name].solution.state
                left = Disagreement.of(Directions(fit, state, variance=scorer.variance))
            else:
                left = Disagreement.of(scorer, scores[name])
            total = total + one.probability * left.added
        return self.with_part(DISAGREEMENT, total)

    def with_move(self, name: str, move: Array, probability: float = 1.0) -> "Corridor":
        """The same about a route that moves [channel, 3], m, once a fault of that name, as probable, is mended."""
        return self.with_part(name, probability * square(move))

    def with_part(self, name: str, more: Array) -> "Corridor":
        """The same with a further covariance [channel, 3, 3], m^2, for what that name may be off by."""
        mine, others = (width(one, self.across) for one in (more, self.covariance))
        if mine > others * self.share:
            return replace(self, covariance=self.covariance + more, widest=name, share=mine / (mine + others))
        share = others * self.share / (mine + others) if others > 0 else 0.0
        return replace(self, covariance=self.covariance + more, share=share)

    def at(self, channel: NDArray[np.int64]) -> Array:
        """What is added [channel, 3, 3] at channels; where one was not fitted, as at the nearest that was."""
        near = np.abs(self.channel[None] - np.asarray(channel)[:, None]).argmin(1)
        return np.asarray(self.covariance[near])


def square(move: Array) -> Array:
    """What a move [point, 3], m, adds to a covariance [point, 3, 3] where it is certain."""
    return np.asarray(move[:, :, None] * move[:, None, :])


def sideways(route: Array) -> Array:
    """Unit vectors [point, 2, 3] across a route [point, 3]: sideways and down.

    >>> sideways(np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 1.0]]))[0].tolist()
    [[-0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    flat = np.column_stack([normals(route), np.zeros(len(route))])
    return np.stack([flat, np.broadcast_to([0.0, 0.0, 1.0], flat.shape)], 1)


def width(covariance: Array, across: Array) -> float:
    """Mean variance of covariances [point, 3, 3] across a route: along it no corridor shows."""
    return float(np.einsum("pwa,pab,pwb->p", across, covariance, across).mean())


def hidden_size(score: Score) -> float:
    """Mean square of an effect's size where it does not show, in squares of what it came out as.

    Noise leaves open, of a plausible size squared, its variance over that and the information; summed over numbers that
    leave a trace, as those of vehicles that did not pass move nothing.
    """
    sizes = np.repeat([p.plausible for p in score.effect.amplitudes], score.counts)
    heard = np.isfinite(score.sigma)
    found = float(np.sum((score.estimate[heard] / sizes[heard]) ** 2))
    traced = np.sort(score.spectrum.information)[np.sum(~heard) :]
    left = score.variance / (score.variance + traced)
    return float(left.sum() / found) if found > 0 else 0.0
