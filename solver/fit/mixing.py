"""Steps that learn from the step before: where each leaves a share of the last one, that share is taken at once.

What Gauss-Newton leaves out, the curvature of a model that explains its record badly and weights that change with the
residual, makes a step too long or too short by a like share each time; so does damping. Anderson's mixing of two steps
finds the share (Anderson 1965, J. ACM 12, 547; Walker and Ni 2011, SIAM J. Numer. Anal. 49, 1715), here in the metric
of the normal equations.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solver.fit.normal import Normal

Array = NDArray[Any]
Step = tuple[Array, list[Array]]

#: Share of a step that the next one repeats, or takes back, from which on steps are mixed; below, they converge fast.
SLOW = 0.25
#: Largest of those shares that is believed.
MOST = 0.8


@dataclass(frozen=True)
class Taken:
    """A step that was taken.

    Parameters
    ----------
    given : by the normal equations where it began, [free]
    made : the same, or mixed with the one before
    gain : of the misfit, as the equations predicted for `given`
    """

    given: Array
    made: Array
    gain: float

    @classmethod
    def of(cls, at: Normal, given: Step, made: Step) -> "Taken":
        """The step from where the equations are those."""
        whole = joined(given)
        return cls(whole, joined(made), float(pull(at) @ whole))


def joined(step: Step) -> Array:
    """A step as one vector."""
    shared, own = step
    return np.concatenate([shared, *own])


def pull(at: Normal) -> Array:
    """Right-hand side of normal equations as one vector."""
    return joined((at.right, [part.right for part in at.parts]))


def mixed(at: Normal, step: Step, before: Taken | None) -> Step | None:
    """A step mixed with the one before; None where that would change little, or nothing is known of one before.

    >>> def equations(slope: float) -> Normal:
    ...     return Normal(0, 1, [], [], [], np.array([slope]))
    >>> before = Taken.of(equations(1.0), (np.array([1.0]), []), (np.array([1.0]), []))
    >>> overshot = np.array([-0.9]), []
    >>> mixed(equations(-0.9), overshot, before)[0].round(3).tolist()
    [-0.474]
    >>> mixed(equations(-0.1), (np.array([-0.1]), []), before)
    """
    given = joined(step)
    if before is None or len(before.given) != len(given):
        return None
    right = pull(at)
    now, repeated = float(right @ given), float(right @ before.given)
    if abs(repeated) < SLOW * before.gain:
        return None
    apart = now - 2 * repeated + before.gain
    if apart <= 0:
        return None
    share = max((now - repeated) / apart, MOST / (MOST - 1))
    whole = given - share * (before.made + given - before.given)
    ends = np.cumsum([len(step[0]), *map(len, step[1])])
    shared, *own = np.split(whole, ends[:-1])
    return shared, own
