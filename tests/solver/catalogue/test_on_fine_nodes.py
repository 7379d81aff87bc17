"""Effects at points of the fiber, which gauges average afterwards, against a fiber of fine nodes."""

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from solver.cable.cable import Cable
from solver.cable.cable_effects import channel_coupling, conduit_slip
from solver.effect import Surroundings
from solver.ground.boussinesq import displacement
from solver.simulator.fiber_motion import slip

GAUGE, SPACING = 10.0, 1.02
CHANNEL = 50 + SPACING * np.arange(90)
STEP = 0.02
NODES = np.arange(CHANNEL[0] - 10, CHANNEL[-1] + 10, STEP)
SURVEY = Surroundings(torch.from_numpy(CHANNEL), 90, GAUGE, SPACING, 10.0, 1, torch.zeros(2), 1.0)
#: Weights of the nodes in each gauge [channel, node].
AVERAGE = (np.abs(CHANNEL[:, None] - NODES) <= GAUGE / 2) * (STEP / GAUGE)


def moved(place: NDArray[np.float64], aside: float) -> torch.Tensor:
    """Motion [place, load] along a straight fiber 0.9 m deep, of loads so far aside."""
    loads = np.arange(CHANNEL[0], CHANNEL[-1], 3.0)
    offset = np.stack(np.broadcast_arrays(place[:, None] - loads, aside, 0.9), -1)
    return displacement(torch.from_numpy(offset), 0.25)[..., 0]


def strains(aside: float) -> NDArray[np.float64]:
    """Strain [node, load] there."""
    return np.asarray(np.gradient(moved(NODES, aside).numpy(), STEP, axis=0))


def heard(cable: Cable, strain: NDArray[np.float64]) -> NDArray[np.float64]:
    """What channels [channel, load] hear with a cable's one matrix."""
    (matrix,) = cable.mixing
    return np.asarray(matrix.numpy() @ (AVERAGE @ strain))


def relative(found: NDArray[np.float64], true: NDArray[np.float64]) -> float:
    """Error, of the true signal's size."""
    return float(np.linalg.norm(found - true) / np.linalg.norm(true))


@pytest.mark.parametrize(
    ("length", "place", "aside"), [(8.3, -7.1, 3.75), (13.7, 4.4, 2.5), (29.0, 2.2, 3.0), (47.5, 0, 5)]
)
def test_a_fiber_that_slips_records_the_mean_between_what_holds_it(length: float, place: float, aside: float) -> None:
    numbers = {"share": 1.0, "place": place, "length": length}
    values = {name: torch.tensor(value, dtype=torch.float64) for name, value in numbers.items()}
    middle = (CHANNEL[0] + CHANNEL[-1]) / 2 + place
    ends = np.array([middle - length / 2, middle + length / 2])
    true = slip(AVERAGE, NODES, np.full(len(NODES), STEP), *ends) @ strains(aside)
    loose = conduit_slip.change(Cable(SURVEY.distance), values, SURVEY).loose
    ahead, behind = (
        sum(
            share[:, None] * motion
            for share, motion in zip(
                loose.shares(torch.from_numpy(at)), (moved(at, aside), *moved(ends, aside)), strict=True
            )
        )
        for at in (CHANNEL + GAUGE / 2, CHANNEL - GAUGE / 2)
    )
    assert relative(((ahead - behind) / GAUGE).numpy(), true) < 0.003  # nodes are 2 cm apart


def test_grip_that_changes_within_a_gauge() -> None:
    strain = strains(3.0)
    log_gain = 0.4 * np.sin(2 * np.pi * CHANNEL / 25)
    values = {"log_gain": torch.from_numpy(log_gain)}
    true = (AVERAGE * np.exp(0.4 * np.sin(2 * np.pi * NODES / 25))) @ strain
    found = heard(channel_coupling.change(Cable(SURVEY.distance), values, SURVEY), strain)
    assert relative(found[5:-5], true[5:-5]) < 0.02
