"""Traffic on a side street: vehicles that cross the fiber at a right angle to the road, and that no camera sees."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from solver.simulator.buried_route import Route
from solver.simulator.effects import effect_rng
from solver.simulator.scenario import Scenario
from solver.simulator.strain import listen
from solver.simulator.vehicle import Vehicle, draw_class, draw_vehicle

Array = NDArray[np.float64]
LANE = 1.75  # m from the middle of the side street


def side_signal(scenario: Scenario, route: Route, distance: Array, time: Array) -> Array:
    """Strain rate [time, channel], 1/s, of `scenario.side_street` vehicles a minute; zeros without any.

    The side street crosses the road in the middle half of the view. Seen along it, the fiber lies turned by 90 degrees:
    strain does not depend on the frame.

    Parameters
    ----------
    distance : [channel] m along the light path
    time : [time] s
    """
    rng = effect_rng(scenario.seed, "side_street")
    count = int(rng.poisson(scenario.side_street * (time[-1] - time[0]) / 60))
    if not count:
        return np.zeros((len(time), len(distance)))
    first, last = scenario.view
    crossing = first + rng.uniform(0.25, 0.75) * (last - first)
    points = route.points - [crossing, np.mean(scenario.lanes), 0.0]
    turned = np.stack([points[:, 1] + (first + last) / 2, -points[:, 0], points[:, 2]], axis=1)
    vehicles = tuple(_drawn(scenario, rng, time, number) for number in range(count))
    seen_along = replace(scenario, lanes=(LANE, -LANE))
    return listen(seen_along, Route.through(turned), distance, vehicles, time, distance)


def _drawn(scenario: Scenario, rng: np.random.Generator, time: Array, number: int) -> Vehicle:
    """A vehicle of the side street, in the frame turned to it."""
    direction = int(rng.choice([1, -1]))
    return draw_vehicle(
        rng,
        f"side {number}",
        draw_class(rng, scenario.classes),
        direction=direction,
        lane=direction * LANE,
        time_at=float(rng.uniform(time[0], time[-1])),
        x_at=sum(scenario.view) / 2,
        speed=rng.uniform(20, 40) / 3.6,
    )
