"""Corners and steps in depth of a located fiber, as numbers with standard deviations."""

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from solver.fit.parameter_layout import AXES
from solver.fit.result import Corner

if TYPE_CHECKING:
    from solver.fit.posterior import Posterior

Array = NDArray[np.float64]

#: Curvature, 1/m, from which a route turns a corner, and slope from which it goes deeper or less deep: winding ducts
#: bend and slope less.
SHARP, STEEP = 1 / 15, 0.12
#: Least turn of a corner, degrees, and least step in depth, m; and how many standard deviations it must be.
TURN, STEP, SHOWN = 25.0, 0.25, 3.0
#: m of fiber before and after a corner whose direction counts: a spline swings a little beside a bend.
LEG = 3.0
#: m between the places that are looked at, and between which two parts of one corner lie.
EVERY, APART = 0.1, 1.0


def stretches_of(there: NDArray[np.bool_], sign: Array) -> Iterator[slice]:
    """Places, `EVERY` m apart, that are there, with one sign; those that lie less than `APART` from another are one.

    >>> there = np.array([1, 1, 0, 1, 0, 1], bool)
    >>> [(one.start, one.stop) for one in stretches_of(there, np.array([1, 1, 1, 1, 1, -1.0]))]
    [(0, 4), (5, 6)]
    """
    at = np.flatnonzero(there)
    cuts = np.flatnonzero((np.diff(at) > APART / EVERY) | (np.diff(np.sign(sign[at])) != 0)) + 1
    yield from (slice(int(one[0]), int(one[-1]) + 1) for one in np.split(at, cuts) if len(one))


def find_corners(posterior: "Posterior", first: float, last: float) -> tuple[Corner, ...]:
    """Corners and steps in depth of a fit between two distances along the fiber, m, in their order.

    What is told of a route is linear near the fit: a turn is the difference of two headings, a step that of two depths,
    so that their variances are those of the spline's coefficients, which the scale of all covariances multiplies.
    """
    basis, problem = posterior.chain.basis, posterior.chain.problem
    coefficients = posterior.visit.state.coefficients.numpy()
    s = np.arange(first, last, EVERY)
    place, slope, bend = (basis.along(coefficients, s, order) for order in range(3))
    curvature = (slope[:, 0] * bend[:, 1] - slope[:, 1] * bend[:, 0]) / np.linalg.norm(slope[:, :2], axis=1) ** 3
    steep = slope[:, 2] / np.linalg.norm(slope, axis=1)

    def way(begin: int, end: int) -> tuple[Array, Array]:
        """Way [3] between two places, and its derivative [3, coefficient x axis]."""
        return place[end] - place[begin], np.asarray(
            np.kron(basis.at(s[end]) - basis.at(s[begin]), np.eye(AXES)), float
        )

    def turn(parts: Sequence[slice], number: int) -> tuple[float, Array]:
        """Angle between the fiber before and after a corner, as far as the next ones, degrees."""
        leg, part = round(LEG / EVERY), parts[number]
        begin = max([part.start - leg, 0, *(one.stop for one in parts[:number])])
        end = min([part.stop + leg, len(s) - 1, *(one.start for one in parts[number + 1 :])])
        before = way(min(begin, part.start - 1), part.start) if part.start else (slope[0], 0 * way(0, 1)[1])
        after = way(part.stop - 1, max(end, part.stop)) if part.stop < len(s) else (slope[-1], 0 * way(0, 1)[1])
        angle, by = 0.0, np.zeros(before[1].shape[1])
        for sign, ((x, y, _), change) in ((-1, before), (1, after)):
            angle += sign * np.arctan2(y, x)
            by += sign * (x * change[1] - y * change[0]) / (x**2 + y**2)
        return float(np.degrees((angle + np.pi) % (2 * np.pi) - np.pi)), 180 / np.pi * by

    def step(parts: Sequence[slice], number: int) -> tuple[float, Array]:
        """How much deeper the fiber is after a step than before, m."""
        path, change = way(parts[number].start, parts[number].stop - 1)
        return float(path[2]), change[2]

    found = list[Corner]()
    kinds: Sequence[
        tuple[Literal["corner", "step"], Array, float, float, float, Callable[..., tuple[float, Array]]]
    ] = (
        ("corner", curvature, SHARP, TURN, 180 / np.pi, turn),
        ("step", steep, STEEP, STEP, 1.0, step),
    )
    for kind, rate, sharp, least, unit, measured in kinds:
        every = stretches_of(np.abs(rate) > sharp, rate)
        parts = [one for one in every if unit * abs(float(rate[one].sum())) * EVERY > least / 2]
        for number, part in enumerate(parts):
            amount, by = measured(parts, number)
            if abs(amount) < least:
                continue
            weights = np.abs(rate[part])
            middle = part.start + round(float(np.average(np.arange(len(weights)), weights=weights)))
            where = np.kron(basis.at(s[middle]), np.eye(AXES))[:2]
            those = np.flatnonzero((by != 0) | where.any(0))
            covariance = posterior.scale * posterior.columns(those)[those]
            sigma = float(np.sqrt(by[those] @ covariance @ by[those]))
            if abs(amount) < SHOWN * sigma:
                continue
            spread = float(np.sqrt(np.trace(where[:, those] @ covariance @ where[:, those].T) / 2))
            channel = round(float((s[middle] - problem.zero_distance) / problem.channel_spacing))
            x, y, z = place[middle].tolist()
            length = len(weights) * EVERY
            found.append(Corner(kind, amount, sigma, length, float(s[middle]), channel, x, y, z, spread))
    return tuple(sorted(found, key=lambda one: one.distance))
