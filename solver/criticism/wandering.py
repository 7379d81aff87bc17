"""How far the tracks wander, by what a fit leaves: a camera's tracks are surer of themselves than they are.

A slow error that lasts for seconds leaves no trace in a track, for a vehicle may have moved so; the fiber tells. Before
the data speak any size is as likely as any other, on a scale of logarithms (Jeffreys 1946, Proc. R. Soc. A 186, 453).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from solver.criticism.bench import Bench
from solver.criticism.candidate import fault_candidate
from solver.criticism.fields import alike
from solver.criticism.marginal import Spectrum, mixture
from solver.criticism.policy import POLICY
from solver.criticism.scorer import Scorer
from solver.fit.map_fit import SPLINE_VARIANCE
from solver.trajectory.trajectory_effects import SLOW_ERROR

#: Sizes that tracks may wander by, m.
SIZES = np.geomspace(0.01, 0.3, 11)
#: Sizes, m, that a fit allows for by itself: less does no harm, and more is to be told as an effect.
LEAST, MOST = 0.03, 0.15


@dataclass(frozen=True)
class Wander:
    """How far the tracks of a survey wander.

    Parameters
    ----------
    size : standard deviation, m: the root mean square of what it may be
    evidence : ln of the Bayes factor that they wander, at whatever size
    """

    size: float
    evidence: float

    @classmethod
    def of(cls, spectrum: Callable[[float], Spectrum], variance: float) -> "Wander":
        """By what the fit leaves of slow errors of a size, m, at a noise variance.

        >>> loud = Wander.of(lambda size: Spectrum(1e4 * np.full(9, size**2), 1e8 * np.full(9, size**2 * 0.01)), 1.0)
        >>> round(loud.size, 2), loud.evidence > 10
        (0.11, True)
        """
        logs = np.array([spectrum(float(size)).scaled(variance, 1.0) for size in SIZES])
        likely = np.exp(logs - logs.max())
        return cls(float(np.sqrt((likely * SIZES**2).sum() / likely.sum())), mixture(logs.tolist()))


def wander_of(scorer: Scorer) -> Wander | None:
    """How far tracks wander at the end of a fit; None where the fit has their slow errors in it."""
    left = scorer.slow_left
    if left is None:
        return None
    # Errors last for seconds: those of a track are alike, see `solver.criticism.fields`.
    together = alike(SLOW_ERROR, [sum(scorer.tracks)] * 2, scorer.tracks)
    assert together is not None
    root = SPLINE_VARIANCE**-0.5 * together
    own, score = root.T @ left.information @ root, root.T @ left.score
    return Wander.of(lambda size: Spectrum.of_plausible(size**2 * own, size * score), scorer.variance)


def explains_best(found: Wander, bench: Bench) -> bool:
    """Whether tracks may well wander by more than they say, and nothing else that shows explains more."""
    others = [score.evidence for score in bench.table[:1]]
    others += [fault_candidate(fault, bench.scorer.variance).evidence for fault in bench.faults]
    return LEAST <= found.size <= MOST and max(others, default=0.0) < max(found.evidence, POLICY.found)
