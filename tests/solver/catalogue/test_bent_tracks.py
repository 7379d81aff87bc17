"""Vehicles on tracks that an effect has bent."""

import torch

from solver.catalogue.catalogue import built_in
from solver.catalogue.trial_survey import Trial, columns, trial_survey


def test_those_on_a_track_that_bends_drive_along_it() -> None:
    """Velocity is the time derivative of position, by central differences, where both neighbors are on the road."""
    one = Trial(built_in()["track_bend"], *trial_survey())
    numbers = torch.linspace(-1, 1, one.extension.size, dtype=torch.float64).square()
    vehicles = columns(one.state.vehicles.rows(one.path.traffic))
    driven = one.path.trajectory(vehicles, one.extension.local(numbers))
    lengths = [int((driven.pass_index == number).sum()) for number in range(int(driven.pass_index.max()) + 1)]
    bent = 0.0
    for y, speed, time in zip(
        driven.position[:, 0, 1].split(lengths),
        driven.velocity[:, 0, 1].split(lengths),
        driven.time[:, 0].split(lengths),
        strict=True,
    ):
        by_differences = (y[2:] - y[:-2]) / (time[2:] - time[:-2])
        inner = slice(len(y) // 4, -len(y) // 4)
        torch.testing.assert_close(speed[1:-1][inner], by_differences[inner], rtol=0, atol=0.05)
        bent = max(bent, float(speed.abs().max()))
    assert bent > 0.3
