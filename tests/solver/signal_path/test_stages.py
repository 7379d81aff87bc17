"""The stages' own methods: moved vehicles, changed loads, filters one after another."""

import math
from dataclasses import replace

import pytest
import torch

from solver.cable.cable import Cable
from solver.catalogue.catalogue import built_in
from solver.catalogue.trial_survey import Trial, trial_survey
from solver.ground.ground import Ground
from solver.ground.tangential import tangential_displacement
from solver.interrogator.interrogator import Interrogator
from solver.load.load import Load
from solver.processing.processing import Processing
from solver.signal_path.ground_motion import motions, total_motion
from solver.trajectory.trajectory import Trajectory


def tensor(*values) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float64)


@pytest.fixture
def driven() -> Trajectory:
    """Two rows: one vehicle along +x, one along -y."""
    return Trajectory(
        time=tensor([0.0], [1.0]),
        since=tensor([0.0], [1.0]),
        position=tensor([[1.0, 2.0]], [[5.0, 6.0]]),
        velocity=tensor([[10.0, 0.0]], [[0.0, -4.0]]),
        heading=tensor([[1.0, 0.0]], [[0.0, -1.0]]),
        pass_index=torch.tensor([0, 1]),
    )


@pytest.fixture
def load(driven) -> Load:
    """Two wheels per row, one before the other."""
    position = driven.position[:, :, None, :] + tensor([1.0], [-1.0]) * driven.heading[:, :, None, :]
    return Load(position, tensor([[0.6, 0.4]], [[0.5, 0.5]]), driven, torch.tensor([1, 2]))


def test_vehicles_move_along_travel_and_to_the_drivers_right(driven):
    # y points to the right of +x, so a driver along -y has +x at the right hand.
    moved = driven.shifted(along=tensor([0.5], [0.5]), across=0.25)
    torch.testing.assert_close(moved.position[:, 0], tensor([1.5, 2.25], [5.25, 5.5]))
    assert torch.equal(moved.velocity, driven.velocity)
    assert driven.speed.flatten().tolist() == [10.0, 4.0]


def test_one_shift_per_channel_is_one_position_per_channel(driven):
    moved = driven.shifted(along=tensor([0.0, 1.0, 2.0], [0.0, 1.0, 2.0]))
    assert moved.position.shape == (2, 3, 2)
    assert moved.position[0, :, 0].tolist() == [1.0, 2.0, 3.0]


def test_modulated_loads_obey_the_product_rule(load):
    """Rates of F(t) g(t) h(t) against finite differences."""

    def g(t):
        return 1 + 0.3 * math.sin(2 * t)

    def h(t):
        return math.exp(-0.5 * t)

    def slope(f, t):
        return (f(t + 1e-6) - f(t - 1e-6)) / 2e-6

    t = 0.7
    once = load.modulated(tensor([g(t)], [g(t)]), tensor([slope(g, t)], [slope(g, t)]))
    twice = once.modulated(tensor([h(t)], [h(t)]), tensor([slope(h, t)], [slope(h, t)]))
    torch.testing.assert_close(twice.share, load.share * g(t) * h(t))
    torch.testing.assert_close(twice.share_rate, load.share * slope(lambda x: g(x) * h(x), t), rtol=1e-8, atol=1e-10)


def test_wheels_push_by_their_share(load):
    pushed = load.pushing(along=tensor([0.1], [0.1]), across=0.02)
    assert pushed.thrust is not None
    torch.testing.assert_close(pushed.thrust[0, 0], tensor([0.06, 0.012], [0.04, 0.008]))
    torch.testing.assert_close(pushed.thrust[1, 0], tensor([0.01, -0.05], [0.01, -0.05]))
    again = pushed.pushing(along=-tensor([0.1], [0.1]), across=-0.02)
    assert again.thrust is not None and again.thrust.abs().max() < 1e-15


def test_a_push_that_changes_moves_the_ground_as_its_displacement_changes():
    """Ground motion under a vehicle that brakes, against finite differences of where the push leaves the ground."""
    point = tensor([3.0, 2.0, 1.2], [-4.0, 5.0, 1.0])
    nu, speed, weight = torch.tensor(0.3, dtype=torch.float64), 9.0, 0.7

    def push(t):
        return 0.3 * math.exp(-(((t - 0.2) / 0.4) ** 2))

    def displaced(t):
        offset = point - tensor(speed * t, 0.0, 0.0)
        return tangential_displacement(offset, nu, tensor(weight * push(t), 0.0))

    t, step = 0.33, 1e-5
    at = Trajectory(
        tensor([t]),
        tensor([t]),
        tensor([[speed * t, 0.0]]),
        tensor([[speed, 0.0]]),
        tensor([[1.0, 0.0]]),
        torch.zeros(1),
    )
    faster = (push(t + step) - push(t - step)) / (2 * step)
    pushing = Load(at.position[..., None, :], tensor([[weight]]), at, torch.zeros(1)).pushing(
        along=tensor([push(t)]), along_rate=tensor([faster])
    )
    alone = replace(pushing, share=torch.zeros_like(pushing.share))
    numeric = (displaced(t + step) - displaced(t - step)) / (2 * step)
    motion = total_motion(motions(alone, Ground(), point[:, None], nu))
    assert motion is not None
    torch.testing.assert_close(motion[0, :, 0], numeric, rtol=1e-7, atol=1e-9)


def test_a_push_grows_with_the_force_that_it_is_a_share_of(load):
    swinging = load.modulated(tensor([1.0], [1.0]), tensor([0.5], [0.5]))
    pushed = swinging.pushing(along=tensor([0.1], [0.1]))
    assert load.pushing(along=0.1).thrust_rate is None
    assert pushed.thrust_rate is not None
    torch.testing.assert_close(pushed.thrust_rate[0, 0], tensor([0.03, 0.0], [0.02, 0.0]))


def test_time_since_a_place_is_right_for_vehicles_that_brake():
    # The first slows from 20 to 10 m/s in 2 s, the second comes the other way, the third never gets there.
    time = torch.arange(0.0, 2.01, 0.1, dtype=torch.float64)
    along = [20 * time - 2.5 * time**2, 50 - 12 * time, -40 + 10 * time]
    speed = [20 - 5 * time, torch.full_like(time, 12.0), torch.full_like(time, 10.0)]
    way = [1.0, -1.0, 1.0]
    forward = torch.cat([sign * one for sign, one in zip(way, speed, strict=True)])
    none = torch.zeros_like(forward)
    driven = Trajectory(
        time.repeat(3)[:, None],
        time.repeat(3)[:, None],
        torch.stack([torch.cat(along), none], -1)[:, None],
        torch.stack([forward, none], -1)[:, None],
        torch.stack([forward.sign(), none], -1)[:, None],
        torch.arange(3).repeat_interleave(len(time)),
    )
    place = torch.tensor(30.0, dtype=torch.float64, requires_grad=True)
    since = driven.since_passing((driven.position[..., 0] - place) * driven.heading[..., 0])
    passed = torch.tensor([2.0, 20 / 12, 7.0]).repeat_interleave(len(time))
    assert (since[:, 0] - (driven.time[:, 0] - passed)).abs().max() < 1e-6
    (slope,) = torch.autograd.grad(since.sum(), place)
    assert float(slope) == pytest.approx(len(time) * (-1 / 10 + 1 / 12 - 1 / 10), rel=1e-6)


def test_a_share_of_all_forces_on_more_wheels_leaves_their_sum(load):
    rich = load.modulated(tensor([2.0], [2.0]), tensor([1.0], [1.0])).pushing(along=0.1)
    share, where = tensor([[0.3]], [[0.0]]), tensor([[[0.0, 0.0], [1.0, 0.0]]]).expand(2, 1, 2, 2)
    moved = rich.scaled(1 - share).joined(rich.whole_at(where).scaled(share / 2))
    assert moved.position.shape == (2, 1, 4, 2)
    torch.testing.assert_close(moved.share[0, 0], tensor(0.84, 0.56, 0.3, 0.3))
    torch.testing.assert_close(moved.share[1, 0], tensor(1.0, 1.0, 0.0, 0.0))
    for name in ("share", "share_rate", "thrust", "thrust_rate"):
        torch.testing.assert_close(getattr(moved, name).sum(2), getattr(rich, name).sum(2))


def test_joined_wheels_may_stand_elsewhere_for_each_channel(load):
    joined = load.joined(load.whole_at(torch.zeros(2, 5, 1, 2, dtype=torch.float64)))
    assert joined.position.shape == (2, 5, 3, 2) and joined.share.shape == (2, 1, 3)


@pytest.mark.parametrize("name", ["layered_ground", "pavement", "gibson_soil"])
def test_ground_moves_under_a_load_that_changes_as_under_one_that_comes_closer(name):
    """Both laws of a ground are of one displacement: what a vehicle that bounces moves is in the same unit."""
    known = built_in()[name]
    survey = Trial(known, *trial_survey()).around
    values = {p.name: tensor(p.grid[0] if p.is_shape else p.plausible)[0] for p in known.parameters}
    ground = known.change(Ground(), values, survey)
    point, velocity, nu = tensor([3.0, 2.0, 1.2], [-4.0, 5.0, 1.0]), tensor(9.0, -1.0), 0.3
    step = 1e-5 * torch.nn.functional.pad(velocity, (0, 1))
    before, after = (ground.displacement(point + sign * step, nu) for sign in (1, -1))
    rate = ground.displacement_rate(point, velocity, nu)
    torch.testing.assert_close((after - before) / 2e-5, rate, rtol=1e-5, atol=1e-7)
    assert (ground.displacement(point, nu) / Ground().displacement(point, nu) - 1).abs().max() > 0.1


def test_a_load_has_all_its_forces_on_all_its_wheels(load):
    with pytest.raises(ValueError, match="share_rate is of 1 wheels, and there are 2"):
        replace(load, share_rate=load.share[..., :1])


def test_what_is_added_to_a_stage_comes_last():
    def one(x):
        return x

    def two(x):
        return 2 * x

    matrix = torch.eye(3, dtype=torch.float64)
    assert Ground().filtered(one).filtered(two).transfers == (one, two)
    cable = Cable(tensor(0.0, 1.0, 2.0)).filtered(one).mixed(matrix)
    assert cable.transfers == (one,) and cable.mixing == (matrix,)
    told = Interrogator(10.0).filtered(one).blurred(two).through(two).through(one)
    assert (told.transfers, told.fiber_transfers, told.pointwise) == ((one,), (two,), (two, one))
    assert Processing().then(two).then(one).steps == (two, one)
