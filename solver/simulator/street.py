"""Lay the fiber and let the vehicles drive: all that is random about a street."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from solver.simulator.buried_route import Route, spline_route, street_route
from solver.simulator.ducts import duct_route
from solver.simulator.effects import effect_rng
from solver.simulator.fiber_motion import bend
from solver.simulator.scenario import Scenario
from solver.simulator.vehicle import FLEET, GRAVITY, Vehicle, draw_class, draw_vehicle

Array = NDArray[np.float64]
MARGIN = 12.0  # s of quiet before the first and after the last vehicle in view
RAMP = 0.5  # s in which brakes that are held over a stretch come, and go


def lay(scenario: Scenario, rng: np.random.Generator) -> tuple[Route, Array]:
    """Lay the fiber; return it and the distance [channel] along it, m, of the middle of each gauge."""
    if scenario.route is not None:
        route = bend(scenario, spline_route(scenario.route))
        return route, scenario.channel_spacing * np.arange(
            int(route.length / scenario.channel_spacing) + 1, dtype=np.float64
        )
    right = {"right": True, "left": False, "either": bool(rng.random() < 0.5)}[scenario.side]
    offset, length = rng.uniform(*scenario.lateral), (scenario.channels - 1) * scenario.channel_spacing
    lateral = max(scenario.lanes) + offset if right else min(scenario.lanes) - offset
    depth, side = rng.uniform(*scenario.depth), 1.0 if right else -1.0
    if scenario.laid != "winding":
        across = sum(scenario.lanes) - lateral  # the same verge on the other side
        route = duct_route(rng, scenario.laid, lateral, across, depth, length=length, view=scenario.view, side=side)
        count = min(scenario.channels, int(route.length / scenario.channel_spacing) + 1)
        return bend(scenario, route), scenario.channel_spacing * np.arange(count, dtype=np.float64)
    route = street_route(
        rng,
        lateral,
        depth,
        length=length,
        view=scenario.view,
        side=side,
        undulation=rng.uniform(*scenario.undulation),
        depth_undulation=rng.uniform(*scenario.depth_undulation),
    )
    return bend(scenario, route), scenario.channel_spacing * np.arange(scenario.channels, dtype=np.float64)


def drive(scenario: Scenario, rng: np.random.Generator) -> tuple[Vehicle, ...]:
    """One vehicle per pass."""
    middle = sum(scenario.view) / 2
    # As evenly as can be, whatever the share.
    count = np.arange(int(np.max(scenario.passes)) + 1)
    directions = rng.permutation(np.where(np.diff(np.ceil(scenario.ahead * count)) > 0, 1, -1))
    vehicles, time_at = [], 0.0
    for number, direction in enumerate(directions.tolist(), 1):
        speed = rng.uniform(*scenario.speeds) / 3.6
        half = (scenario.view[1] - scenario.view[0]) / 2 / speed
        time_at = max(time_at + rng.uniform(*scenario.headway), MARGIN + half)
        vehicles.append(
            draw_vehicle(
                rng,
                str(number),
                draw_class(rng, scenario.classes),
                direction=direction,
                lane=scenario.lanes[0 if direction > 0 else 1],
                time_at=time_at,
                x_at=middle,
                speed=speed,
            )
        )
    return tuple(_driven(scenario, vehicle, number) for number, vehicle in enumerate(vehicles))


def _driven(scenario: Scenario, vehicle: Vehicle, number: int) -> Vehicle:
    """Apply the hidden effects that belong to a vehicle and its driver."""
    vehicle = replace(vehicle, front_share=vehicle.front_share + scenario.effect("front_share"))
    if (length := scenario.effect("long_vehicle")) and number % 3 == 0:
        count = max(2, round(scenario.effect("long_vehicle_axles")))
        axles = tuple((ahead, 1 / count) for ahead in np.linspace(length / 2, -length / 2, count).tolist())
        vehicle = replace(
            vehicle,
            vehicle_class="truck",
            mass=FLEET["truck"].mass[0] * count / 2,
            wheelbase=length,
            track=FLEET["truck"].track,
            length=round(length + 2.0, 1),
            width=FLEET["truck"].width,
            axles=axles,
        )
    return replace(vehicle, brakes=_brakes(scenario, vehicle, number)) if scenario.effect("braking") else vehicle


def _brakes(scenario: Scenario, vehicle: Vehicle, number: int) -> tuple[tuple[float, float, float, float], ...]:
    """When a vehicle brakes: braking vehicles are spread over the traffic; none loses over 60 % of its speed.

    All brake for the same time, or over the same stretch.
    """
    share = scenario.effect("braking_share")
    start = effect_rng(scenario.seed, "braking").random()
    if int((number + 1) * share + start) == int(number * share + start):
        return ()
    first, last = scenario.view[:: vehicle.direction]
    begin = vehicle.time_when_at(first + scenario.effect("braking_at") * (last - first))
    most, speed = scenario.effect("braking") * GRAVITY, vehicle.speed
    if length := scenario.effect("braking_length"):
        most = min(most, 0.42 * speed**2 / length)
        duration = (speed - np.sqrt(speed**2 - 2 * most * length)) / most
        return ((begin - RAMP / 2, float(duration) + RAMP, most, RAMP),)
    duration = min(scenario.effect("braking_time"), 1.2 * speed / most)
    return ((begin, duration, most, duration / 2),)


def unseen(scenario: Scenario, vehicles: tuple[Vehicle, ...], rng: np.random.Generator) -> Vehicle:
    """Draw a vehicle that goes the other way during one of the passes."""
    host = vehicles[int(rng.integers(len(vehicles)))]
    ghost = draw_vehicle(
        rng,
        "unseen",
        "car",
        direction=-host.direction,
        lane=scenario.lanes[1 if host.direction > 0 else 0],
        time_at=host.time_at + rng.uniform(-2, 2),
        x_at=host.x_at + rng.uniform(-20, 20),
        speed=rng.uniform(*scenario.speeds) / 3.6,
    )
    return replace(ghost, mass=FLEET["car"].mass[0] * scenario.effect("unseen_vehicle"))
