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
    torch.testing.assert_close(driven.heading, driven.velocity / driven.speed[..., None], rtol=0, atol=1e-3)


def test_beyond_the_road_a_track_goes_on_straight_as_it_does_without() -> None:
    """There nobody saw the vehicle: its track is the tangent of what was seen, and so is what that is off by."""
    one = Trial(built_in()["track_bend"], *trial_survey())
    numbers = torch.linspace(-1, 1, one.extension.size, dtype=torch.float64).square()
    here, place = one.extension.local(numbers)["track_bend"], one.path.traffic.position[:, 0]
    low = place < one.fit.problem.start[:, 0].min()
    x, y, slope = place[low], here["y"][low, 0], here["y_rate"][low, 0] / one.path.traffic.velocity[low, 0]
    assert low.sum() > 2 and slope.abs().min() > 1e-3
    torch.testing.assert_close(slope, slope[0].expand_as(slope))
    torch.testing.assert_close(y - y[0], slope * (x - x[0]))
