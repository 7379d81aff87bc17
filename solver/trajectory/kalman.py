"""Kalman filter and Rauch-Tung-Striebel smoother of vehicle fixes, batched over candidates, tracks and axes.

Motion along each axis (Singer 1970, IEEE Trans. Aerosp. Electron. Syst. 6, 473): the acceleration is an
Ornstein-Uhlenbeck process of standard deviation `acceleration` and time constant `MANEUVER`. Error of the fixes: a
stationary AR(1) of each fix's own sigma and time constant `memory`, since a detector's box, and a GPS receiver, err
the same way for several fixes. State: position, velocity, acceleration and error in units of sigma.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MANEUVER = 2.0  # s; a driver brakes or accelerates for about as long
GATE = 5.0  # sigma; what lies beyond is taken for a mistake of the detector and weighs less
WIDE = 10.0  # times what the first fixes themselves tell: what the prior adds to them is 1 % of their weight


@dataclass(frozen=True)
class Fixes:
    """Fixes of several tracks, padded to the longest.

    Parameters
    ----------
    time : s [track, fix]; the padding repeats the last time
    value : m [track, fix, axis]
    sigma : m [track, fix, axis]
    valid : false in the padding [track, fix]
    prior : position, m, and velocity, m/s, at the first fix [track, axis, 2]
    prior_sigma : their standard deviations [track, axis, 2]
    """

    time: Array
    value: Array
    sigma: Array
    valid: NDArray[np.bool_]
    prior: Array
    prior_sigma: Array


def first_guess(time: Array, value: Array, sigma: Array) -> tuple[Array, Array]:
    """Return position and velocity at the first of `value` [fix, axis], and how far they may be off, [axis, 2] each.

    Theil (1950) and Sen (1968): the median slope, so that a wrong first fix does not lead the filter astray.

    >>> guess, _ = first_guess(np.arange(5.0), np.array([[90.0], [2.0], [4.0], [6.0], [8.0]]), np.full((5, 1), 0.1))
    >>> guess.round(1).tolist()
    [[0.0, 2.0]]
    """
    first, second = np.triu_indices(len(time), 1)
    slope = np.median((value[second] - value[first]) / (time[second] - time[first])[:, None], axis=0)
    place = np.median(value - slope * (time - time[0])[:, None], axis=0)
    span, scatter = time[-1] - time[0], np.median(sigma, axis=0)
    # A driver changes speed by 2 m/s^2 at most times; the rest is the scatter of the fixes.
    place_sigma = np.hypot(WIDE * scatter, span**2)
    slope_sigma = np.hypot(WIDE * scatter / span, 2 * span)
    return np.stack([place, slope], axis=-1), np.stack([place_sigma, slope_sigma], axis=-1)


@dataclass(frozen=True)
class Smoothed:
    """Filtered and smoothed states [fix, track, axis, 4] and covariances [fix, track, axis, 4, 4]."""

    filtered: Array
    filtered_covariance: Array
    mean: Array
    covariance: Array


def transition(step: Array, memory: Array) -> Array:
    """Return the transition matrices [..., 4, 4] over `step`, s, [...]."""
    step, memory = np.broadcast_arrays(step, memory)
    x = step / MANEUVER
    decay = np.exp(-x)
    result = np.zeros((*step.shape, 4, 4))
    result[..., 0, 0] = result[..., 1, 1] = 1.0
    result[..., 0, 1] = step
    result[..., 0, 2] = MANEUVER**2 * (x - 1 + decay)
    result[..., 1, 2] = MANEUVER * (1 - decay)
    result[..., 2, 2] = decay
    result[..., 3, 3] = np.exp(-step / memory)
    return result


def process_noise(step: Array, acceleration: Array, memory: Array) -> Array:
    """Return the covariances [..., 4, 4] of what a step, s, [...] adds (Singer 1970, appendix)."""
    step, acceleration, memory = np.broadcast_arrays(step, acceleration, memory)
    x = step / MANEUVER
    decay, square = np.exp(-x), np.exp(-2 * x)
    entries = {
        (0, 0): MANEUVER**4 * (1 - square + 2 * x + 2 * x**3 / 3 - 2 * x**2 - 4 * x * decay),
        (0, 1): MANEUVER**3 * (square + 1 - 2 * decay + 2 * x * decay - 2 * x + x**2),
        (0, 2): MANEUVER**2 * (1 - square - 2 * x * decay),
        (1, 1): MANEUVER**2 * (4 * decay - 3 - square + 2 * x),
        (1, 2): MANEUVER * (square + 1 - 2 * decay),
        (2, 2): 1 - square,
    }
    result = np.zeros((*step.shape, 4, 4))
    for (row, column), entry in entries.items():
        result[..., row, column] = result[..., column, row] = acceleration**2 * entry
    result[..., 3, 3] = -np.expm1(-2 * step / memory)
    return result


def predicted(mean: Array, covariance: Array, step: Array, acceleration: Array, memory: Array) -> tuple[Array, Array]:
    """Propagate mean [..., 4] and covariance [..., 4, 4] over `step`, s, [...]."""
    move = transition(step, memory)
    forward = move @ covariance @ np.swapaxes(move, -1, -2)
    return (move @ mean[..., None])[..., 0], forward + process_noise(step, acceleration, memory)


@dataclass(frozen=True)
class Step:
    """One fix of the filter.

    Parameters
    ----------
    gain : of log-likelihood [..., track, axis]
    ahead, spread : mean [..., track, axis, 4] and covariance [..., track, axis, 4, 4] before the fix
    mean, covariance : after it
    """

    gain: Array
    ahead: Array
    spread: Array
    mean: Array
    covariance: Array


def filtered(fixes: Fixes, acceleration: Array, memory: Array) -> Iterator[Step]:
    """Filter forward, fix by fix.

    Parameters
    ----------
    fixes : [track, fix, axis]
    acceleration : m/s^2 [..., track, axis]
    memory : s [..., track, axis]

    Notes
    -----
    A fix further than `GATE` sigma from the prediction gets the variance that puts it at `GATE` sigma: it pulls no
    harder than that, and a likelihood of such tails does not buy it a restless vehicle.
    """
    shape = np.broadcast_shapes(acceleration.shape, memory.shape)
    mean = np.zeros((*shape, 4))
    mean[..., :2] = fixes.prior
    covariance = np.zeros((*shape, 4, 4))
    covariance[..., [0, 1], [0, 1]] = fixes.prior_sigma**2
    covariance[..., 2, 2] = acceleration**2
    covariance[..., 3, 3] = 1.0
    intervals = np.diff(fixes.time, axis=1, prepend=fixes.time[:, :1])
    for index, interval in enumerate(intervals.T):
        ahead, spread = predicted(mean, covariance, interval[:, None], acceleration, memory)
        sigma, valid = fixes.sigma[:, index], fixes.valid[:, index, None]
        gain = spread[..., :, 0] + sigma[..., None] * spread[..., :, 3]
        innovation = fixes.value[:, index] - ahead[..., 0] - sigma * ahead[..., 3]
        variance = np.maximum(gain[..., 0] + sigma * gain[..., 3], innovation**2 / GATE**2)
        variance = np.where(valid, variance, np.inf)
        gained = -np.where(valid, np.log(variance) + innovation**2 / variance, 0.0) / 2
        gain_scaled = gain / variance[..., None]
        mean = ahead + gain_scaled * innovation[..., None]
        covariance = spread - gain_scaled[..., :, None] * gain[..., None, :]
        yield Step(gained, ahead, spread, mean, covariance)


def likelihood(fixes: Fixes, acceleration: Array, memory: Array) -> Array:
    """Log-likelihood [..., track, axis] of fixes, but for a constant; parameters as of `filtered`."""
    return np.asarray(sum(step.gain for step in filtered(fixes, acceleration, memory)))


def smooth(fixes: Fixes, acceleration: Array, memory: Array) -> Smoothed:
    """Smooth with one `acceleration`, `memory` [track, axis] per track and axis (Rauch, Tung and Striebel 1965)."""
    steps = list(filtered(fixes, acceleration, memory))
    means, covariances = [steps[-1].mean], [steps[-1].covariance]
    for index in range(len(steps) - 2, -1, -1):
        mean, covariance = steps[index].mean, steps[index].covariance
        ahead, spread = steps[index + 1].ahead, steps[index + 1].spread
        step = (fixes.time[:, index + 1] - fixes.time[:, index])[:, None]
        valid = fixes.valid[:, index + 1, None, None, None]
        back = smoother_gain(covariance, transition(step, memory), np.where(valid, spread, np.eye(4)))
        back = np.where(valid, back, np.eye(4))
        means.append(mean + (back @ (means[-1] - ahead)[..., None])[..., 0])
        covariances.append(covariance + back @ (covariances[-1] - spread) @ np.swapaxes(back, -1, -2))
    return Smoothed(
        filtered=np.stack([step.mean for step in steps]),
        filtered_covariance=np.stack([step.covariance for step in steps]),
        mean=np.stack(means[::-1]),
        covariance=np.stack(covariances[::-1]),
    )


def smoother_gain(covariance: Array, move: Array, spread: Array) -> Array:
    """Return covariance move^T spread^-1, [..., 4, 4]."""
    return np.swapaxes(np.linalg.solve(spread, move @ covariance), -1, -2)


def between(
    smoothed: Smoothed, track: int, times: Array, at: Array, acceleration: Array, memory: Array
) -> tuple[Array, Array]:
    """Return mean [time, axis, 4] and covariance [time, axis, 4, 4] of one track at `at`, s [time], inside `times`.

    The filter's state at the fix before is propagated to the time asked for, and corrected by the smoothed state at
    the fix after, as the smoother does from fix to fix.
    """
    before = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(times) - 2)
    after = before + 1
    mean, spread = predicted(
        smoothed.filtered[before, track],
        smoothed.filtered_covariance[before, track],
        (at - times[before])[:, None],
        acceleration,
        memory,
    )
    rest = (times[after] - at)[:, None]
    ahead, ahead_spread = predicted(mean, spread, rest, acceleration, memory)
    back = smoother_gain(spread, transition(rest, memory), ahead_spread)
    correction = (smoothed.mean[after, track] - ahead)[..., None]
    change = smoothed.covariance[after, track] - ahead_spread
    return mean + (back @ correction)[..., 0], spread + back @ change @ np.swapaxes(back, -1, -2)


def beyond(mean: Array, covariance: Array, step: Array, acceleration: Array, memory: Array) -> tuple[Array, Array]:
    """Extrapolate an edge state [axis, 4] over `step`, s [time]; a negative step goes back in time.

    The motion is reversible: backwards is forwards with the velocity reversed.
    """
    flip = np.array([1.0, -1.0, 1.0, 1.0])
    sign = np.where(step[:, None, None] < 0, flip, 1.0)
    state, spread = predicted(
        sign * mean,
        sign[..., :, None] * covariance * sign[..., None, :],
        np.abs(step)[:, None],
        acceleration,
        memory,
    )
    return sign * state, sign[..., :, None] * spread * sign[..., None, :]
