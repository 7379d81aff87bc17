"""Fibers in ducts: what turns where, and that the answer of a survey says so."""

import numpy as np
import pytest

from solver.simulator import BUILT_IN, Scenario, read_scenario, simulate
from solver.simulator.ducts import SHAPES
from solver.simulator.street import lay
from solver.simulator.survey_files import laid
from vision.contract import InputError

#: Corners in view that turn by more than 15 degrees, steps in depth, risers.
IN_VIEW = {
    "straight": (0, 0, 0),
    "crossing": (2, 2, 0),
    "slanting": (2, 2, 0),
    "jog": (4, 0, 0),
    "culvert": (0, 2, 0),
    "step": (0, 1, 0),
    "dent": (4, 0, 0),
    "side-street": (1, 0, 0),
    "riser": (1, 0, 1),
    "coil": (0, 0, 0),
}


@pytest.mark.parametrize("shape", SHAPES)
def test_a_street_as_it_is_built(shape):
    survey = simulate(Scenario(seed=3, laid=shape, view=(0.0, 60.0), passes=1, channels=181, depth=(0.6, 0.7)))
    said, fiber = laid(survey), survey.fiber
    seen = [one for one in said["corners"] if 0 <= one["x"] <= 60]
    sharp = sum(abs(one["turn"]) > 15 for one in seen)
    assert (sharp, len(said["depth_steps"]), int(said["riser"] is not None)) == IN_VIEW[shape]
    assert said["chambers"] and (said["coil"] is not None) == (shape == "coil")
    # Smooth, and by length along the fiber: a channel lies where the distance to it says, detours included.
    way = np.diff(fiber.points, axis=0)
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    assert np.degrees(np.arccos(np.clip((way[1:] * way[:-1]).sum(1), -1, 1))).max() < 5
    chord = np.linalg.norm(np.diff(survey.route, axis=0), axis=1)
    uncoiled = 1.0 if shape != "coil" else 1 - survey.scenario.effect("slack_spool") / survey.distance[-1]
    assert chord.max() <= survey.scenario.channel_spacing + 1e-6 and chord.sum() > 0.96 * uncoiled * survey.distance[-1]
    for one in said["corners"]:
        channel = int(np.argmin(np.abs(survey.distance - one["distance"])))
        assert np.linalg.norm(survey.route[channel] - [one["x"], one["y"], one["z"]]) < 0.6


def test_nothing_stretches_a_fiber_above_the_ground():
    survey = simulate(Scenario(seed=1, laid="riser", view=(0.0, 40.0), passes=1, gauge_length=1.0))
    above = survey.route[:, 2] < -0.6
    assert above.any() and not survey.signal[:, above].any()


def test_as_built_draws_a_shape_and_says_which():
    drawn = {Scenario(seed=seed, laid="as-built").drawn().laid for seed in range(60)}
    assert drawn == {shape for shape, share in SHAPES.items() if share}
    assert {read_scenario(name).laid for name in BUILT_IN} == {"as-built"} and Scenario().laid == "winding"
    with pytest.raises(InputError, match="laid: one of winding, as-built, straight"):
        Scenario(laid="bent")


def test_share_of_vehicles_ahead():
    scenario = Scenario(passes=9, ahead=0.0)
    assert all(vehicle.direction < 0 for vehicle in simulate(scenario).vehicles)
    assert lay(scenario, np.random.default_rng(0))[0].bends
