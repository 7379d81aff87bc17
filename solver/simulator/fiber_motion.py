"""The cable between ground and light: where its channels are, and how it transfers the ground's strain.

The *light path* is the distance that the interrogator measures; the *arc* is the distance along the route. They differ
where channels lie closer than the file says, wander, or where fiber lies coiled.
"""

import numpy as np
from numpy.typing import NDArray

from solver.simulator.buried_route import Route
from solver.simulator.effects import effect_rng
from solver.simulator.scenario import Scenario

Array = NDArray[np.float64]


def arc_of(scenario: Scenario, light: Array, channels: Array) -> Array:
    """Arc [n], m, at `light` [n], m along the light path of a cable with `channels` [channel], m along it.

    >>> import numpy as np
    >>> scenario = Scenario(effects={"slack_spool": 4.0, "slack_spool_at": 0.5})
    >>> arc_of(scenario, np.array([10.0, 52.0, 60.0]), np.array([0.0, 100.0]))
    array([10., 50., 56.])
    """
    arc = light - np.clip(light - _spool_begins(scenario, channels), 0.0, scenario.effect("slack_spool"))
    arc = arc * (1.0 + scenario.effect("channel_stretch"))
    rng = effect_rng(scenario.seed, "channel_wander")
    return arc + scenario.effect("channel_wander") * smooth(rng, light, (30, 120), span=channels)


def coiled(scenario: Scenario, light: Array, channels: Array) -> NDArray[np.bool_]:
    """Where along `light` [n], m, the fiber lies coiled."""
    begin = _spool_begins(scenario, channels)
    return (light >= begin) & (light < begin + scenario.effect("slack_spool"))


def _spool_begins(scenario: Scenario, channels: Array) -> float:
    return float(channels[0] + scenario.effect("slack_spool_at") * (channels[-1] - channels[0]))


def smooth(rng: np.random.Generator, distance: Array, wavelengths: tuple[float, float], span: Array) -> Array:
    """Sum of 12 sines of such wavelengths, m, at `distance` [n]; mean 0 and sd 1 over `span` [k].

    >>> import numpy as np
    >>> x = np.arange(0.0, 200.0)
    >>> bool(abs(smooth(np.random.default_rng(0), x, (20, 80), span=x).std() - 1) < 1e-9)
    True
    """
    wavelength, phase = rng.uniform(*wavelengths, 12), rng.uniform(0, 2 * np.pi, 12)

    def waves(at: Array) -> Array:
        return np.sin(2 * np.pi * at[:, None] / wavelength + phase).sum(1)

    known = waves(span)
    return np.asarray((waves(distance) - known.mean()) / (known.std() or 1.0))


def gain(scenario: Scenario, light: Array, channels: Array) -> Array:
    """Share exp(g) [node] of the ground's strain that the fiber takes, g smooth along it (sines of 20 to 80 m)."""
    rng = effect_rng(scenario.seed, "channel_coupling")
    return np.exp(scenario.effect("channel_coupling") * smooth(rng, light, (20, 80), span=channels))


def shear_lag(average: Array, nodes: Array, length: float) -> Array:
    """Transfer the ground's strain to a fiber in a soft coating: e - L^2 e'' = g along it, by linear finite elements.

    Parameters
    ----------
    average : [channel, node]; weights on the fiber's strain e
    nodes : [node] m along the fiber
    length : L, m

    Returns
    -------
    [channel, node]; weights on the ground's strain g.
    """
    from scipy.linalg import solveh_banded

    h = np.diff(nodes)
    mass, stiff = np.zeros((2, len(nodes))), np.zeros((2, len(nodes)))
    for matrix, own, shared in ((mass, h / 3, h / 6), (stiff, length**2 / h, -(length**2) / h)):
        matrix[1, :-1] += own
        matrix[1, 1:] += own
        matrix[0, 1:] = shared
    solved = solveh_banded(mass + stiff, average.T)
    below = mass[0, 1:, None]
    out = mass[1, :, None] * solved
    out[:-1] += below * solved[1:]
    out[1:] += below * solved[:-1]
    return np.asarray(out.T)


def slip(average: Array, nodes: Array, measure: Array, first: float, last: float) -> Array:
    """Let the fiber slip between `first` and `last`, m: there it takes the mean of the ground's strain.

    Parameters
    ----------
    average : [channel, node]; weights on the fiber's strain
    nodes, measure : [node] m along the fiber, and m that each stands for
    """
    free = (nodes >= first) & (nodes <= last)
    out = average.copy()
    out[:, free] = average[:, free].sum(1, keepdims=True) * (measure[free] / measure[free].sum())
    return out


def sense(scenario: Scenario, average: Array, light: Array, measure: Array, channels: Array, seen: Array) -> Array:
    """Apply the cable's transfer from the ground's strain at the nodes to the fiber's strain.

    Parameters
    ----------
    average : [channel, node]; the interrogator's average of the fiber's strain
    light, measure : [node] m along the light path, and m that each node stands for
    channels : [channel] m; middle of each gauge
    seen : [channel] m; those in view
    """
    average = np.where(coiled(scenario, light, channels), 0.0, average)
    if free := scenario.effect("conduit_slip"):
        middle = seen[0] + scenario.effect("conduit_slip_at") * (seen[-1] - seen[0])
        average = slip(average, light, measure, middle - free / 2, middle + free / 2)
    if length := scenario.effect("shear_lag"):
        average = shear_lag(average, light, length)
    return average * gain(scenario, light, channels)


def bend(scenario: Scenario, route: Route) -> Route:
    """Undulate the route within the view: to `sloping_fiber`, the steepest slope, or to `curved_gauge`, 1/m."""
    slope, curvature = scenario.effect("sloping_fiber"), scenario.effect("curved_gauge")
    if not slope and not curvature:
        return route
    x = route.points[:, 0]
    edge = 0.05 * (scenario.view[1] - scenario.view[0])
    rise = np.clip((x - scenario.view[0] + edge) / (2 * edge), 0, 1) * np.clip(
        (scenario.view[1] + edge - x) / (2 * edge), 0, 1
    )
    taper = rise**2 * (3 - 2 * rise)
    points = route.points.copy()
    for axis, name, order, amount in ((2, "sloping_fiber", 1, slope), (1, "curved_gauge", 2, curvature)):
        k = 2 * np.pi / scenario.effect(f"{name}_wavelength")
        phase = effect_rng(scenario.seed, name).uniform(0, 2 * np.pi)
        points[:, axis] += amount / k**order * taper * np.sin(k * x + phase)
    return Route.through(points, route.bends, route.chambers)
