"""Effects' numbers: how they spread over rows and channels, where they are in the vector, and their bounds."""

import numpy as np
import pytest
import torch

from solver.catalogue.catalogue import built_in
from solver.catalogue.trial_survey import Trial, trial_survey
from solver.effect import Parameter, effect
from solver.fit.numbers import Numbers
from solver.fit.prior import Prior
from solver.signal_path.extension import NONE, SMOOTH, SMOOTH_TRACK


def extension(*names: str):
    return trial_survey()[0].problem.extension([built_in()[name] for name in names])


@pytest.fixture(scope="module")
def traffic():
    return trial_survey()[0].problem.traffic


def test_one_number_is_the_same_everywhere():
    one = extension("clock_offset")
    assert one.size == 1 and one.local(torch.tensor([0.3]).double())["clock_offset"]["offset"].shape == ()


def test_a_number_per_pass_is_that_of_each_row_s_pass(traffic):
    one = extension("dynamic_load")
    numbers = one.numbers()
    assert one.size == 2 * traffic.passes + 1
    numbers[: traffic.passes] = torch.arange(traffic.passes) + 1.0
    local = one.local(numbers)["dynamic_load"]
    assert torch.equal(local["sine"], traffic.pass_index.double()[:, None] + 1)
    assert not local["cosine"].any() and local["frequency"].ndim == 0


def test_smooth_numbers_are_splines_that_can_be_constant_and_straight(traffic):
    one = extension("channel_coupling")
    assert one.scopes is not None and one.surroundings is not None
    basis, s = one.scopes.fiber, one.surroundings.distance
    torch.testing.assert_close(basis.sum(1), torch.ones(len(s), dtype=torch.float64))
    assert basis.shape[1] == round(float(s.max() - s.min()) / SMOOTH) + 3
    straight = torch.linalg.lstsq(basis, s[:, None]).solution
    torch.testing.assert_close(basis @ straight, s[:, None])


def test_road_numbers_depend_on_the_place_alone(traffic):
    one = extension("generic_road")
    numbers = torch.from_numpy(np.random.default_rng(0).normal(size=one.size))
    y = one.local(numbers)["generic_road"]["change"][:, 0].numpy()
    x = traffic.position[:, 0].numpy()
    order = np.argsort(x)
    # Vehicles that pass one another are given one value there, and beyond the fiber that at its end.
    assert np.abs(np.diff(y[order])).max() < 1.5 * np.diff(x[order]).max()
    low = x < trial_survey()[0].problem.start[:, 0].min()
    assert low.sum() > 2 and np.ptp(y[low]) < 1e-12


def test_track_numbers_are_each_pass_s_own(traffic):
    one = extension("generic_load")
    assert one.scopes is not None
    spread = one.scopes.rows["track"]
    torch.testing.assert_close(spread.sum(1), torch.ones(len(spread), dtype=torch.float64))
    for column in spread.T:
        assert len(traffic.pass_index[column != 0].unique()) <= 1
    since = one.clock(traffic)[1]
    wanted = tuple(round(float(since[traffic.pass_index == k].max()) / SMOOTH_TRACK) + 3 for k in range(5))
    assert one.scopes.tracks == wanted
    assert one.size == one.scopes.count("track") == sum(wanted)


def test_numbers_in_time_are_the_same_for_all_vehicles(traffic):
    one = extension("generic_gain")
    assert one.scopes is not None
    change = one.local(torch.ones(one.size, dtype=torch.float64))["generic_gain"]["change"]
    torch.testing.assert_close(change, torch.ones(len(traffic.samples), 1, dtype=torch.float64))
    assert (one.scopes.samples != 0).any(0).all()


def test_what_is_rated_comes_with_its_time_derivative(traffic):
    for name in ("generic_load", "generic_road"):
        one = extension(name)
        # Smooth enough for differences between samples, which are some meters apart.
        numbers = torch.sin(0.5 * torch.arange(one.size).double())
        value, rate = (one.local(numbers)[name][key][:, 0] for key in ("change", "change_rate"))
        mine = traffic.pass_index == 1
        step = (value[mine][2:] - value[mine][:-2]) / 2 * trial_survey()[0].problem.sampling_rate
        assert float((step - rate[mine][1:-1]).abs().median()) < 0.05 * float(rate[mine].abs().max())


def test_clocks_run_from_the_record_s_start_and_from_each_pass_s(traffic):
    problem = trial_survey()[0].problem
    time, since = extension("clock_drift").clock(traffic)
    first = problem.passes[2].rows[0] / problem.sampling_rate
    mine = traffic.pass_index == 2
    assert float(time[mine][0]) == first and float(since[mine][0]) == 0
    torch.testing.assert_close(time[mine] - first, since[mine])


def test_the_vector_begins_at_null_and_holds_what_it_is_given():
    one = extension("sloping_fiber", "viscoelastic_lag", "clock_offset")
    assert one.numbers().tolist() == [1.0, 0.0, 0.8, 0.0]
    given = one.numbers({"viscoelastic_lag": {"time": 3.2, "creep": 0.1}, "clock_offset": {"offset": -0.2}})
    assert given.tolist() == [1.0, 0.1, 3.2, -0.2]
    assert [slot.parameter.name for slot in one.slots] == ["vertical_share", "creep", "time", "offset"]


def test_effects_of_a_stage_act_in_turn():
    def doubled(name):
        return effect(name, "load", [Parameter("a", "1", 1.0)], physics="-", source="-")

    first = doubled("first")(lambda load, p, survey: load.modulated(1 + p["a"], 0 * p["a"]))
    second = doubled("second")(lambda load, p, survey: load.modulated(2 + p["a"], 0 * p["a"]))
    one = trial_survey()[0].problem.extension([first, second])
    load = Trial(first, *trial_survey()).given()
    values = one.local(torch.tensor([2.0, 1.0], dtype=torch.float64))
    torch.testing.assert_close(one.changed("load", load, values).share, 9 * load.share)
    assert one.changed("cable", 5, values) == 5


def test_what_is_not_a_stage_is_refused():
    wrong = effect("wrong", "load", [Parameter("a", "1", 1.0)], physics="-", source="-")(lambda load, p, survey: 3)
    one = trial_survey()[0].problem.extension([wrong])
    with pytest.raises(ValueError, match=r"effect wrong: its function must return the load stage .* returned int"):
        one.changed("load", None, one.local(one.numbers()))


def test_neighbors_beyond_the_ends_are_computed_where_channels_mix():
    plain, mixing = extension("channel_wander"), extension("shear_lag")
    assert plain.surroundings is not None and mixing.surroundings is not None and mixing.chosen is not None
    assert plain.chosen is None and len(plain.surroundings.distance) == 24
    assert len(mixing.surroundings.distance) == 32
    torch.testing.assert_close(mixing.surroundings.distance[mixing.chosen], plain.surroundings.distance)


def test_no_effect_has_no_numbers():
    assert NONE.size == 0 and NONE.local(NONE.numbers()) == {}
    assert NONE.described({}, 8.0).interrogator.gauge_length == 8.0
    assert extension().surroundings is None


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"stage": "fibre"}, "stage 'fibre' is none of trajectory"),
        ({"parameters": [Parameter("a", "1", 1.0, scope="lane")]}, "scope 'lane' is none of one"),
        ({"parameters": [Parameter("a", "1", 1.0, scope="pass")]}, "scope 'pass' is for effects on trajectory"),
        ({"parameters": [Parameter("a", "1", 1.0, scope="time")]}, "scope 'time' is for effects on the interrogator"),
        ({"parameters": [Parameter("a", "1", 1.0, rated=True)]}, "only what is smooth along the road or a track"),
        ({"parameters": [Parameter("a", "1", 1.0, null=2.0, upper=1.0)]}, "the null 2 is outside -inf to 1"),
        ({"parameters": [Parameter("a", "1", 1.0, grid=(1.0,))]}, "at least one parameter with a null"),
    ],
)
def test_declarations_that_cannot_hold_are_refused(changes, words):
    told = {"name": "mine", "stage": "cable", "parameters": [Parameter("a", "1", 1.0)], "physics": "-", "source": "-"}
    with pytest.raises(ValueError, match=f"effect mine.*{words}"):
        effect(**(told | changes))


@pytest.mark.parametrize("name", ["dynamic_load", "rayleigh_wave", "generic_load", "layered_ground"])
def test_rows_differentiated_in_blocks_are_as_those_differentiated_at_once(name, monkeypatch):
    one = Trial(built_in()[name], *trial_survey())
    moved = torch.from_numpy(np.random.default_rng(0).uniform(0, 0.1, one.extension.size))
    numbers = Numbers.of(one.extension, Prior()).bounded(one.numbers() + moved)
    whole = one.seen(numbers).local.by
    assert len(one.path.traffic.pass_index) * whole.rate.shape[1] > 3 * 500
    monkeypatch.setattr("solver.signal_path.signal_path.BLOCK", 500)
    parts = one.seen(numbers).local.by
    torch.testing.assert_close(parts.rate, whole.rate)
    for kind in ("by_load", "by_vehicle"):
        torch.testing.assert_close(getattr(parts, kind), getattr(whole, kind))
    for kind in ("by_point", "by_weight", "by_ratio"):
        torch.testing.assert_close(getattr(parts, kind), getattr(whole, kind))


def test_a_coil_leads_the_fiber_beyond_it_back_along_the_route():
    coil = extension("slack_spool")
    assert coil.surroundings is not None
    numbers, counted = coil.numbers(), coil.surroundings.distance
    numbers[:2] = torch.tensor([6.0, 1.3])
    middle = float(counted[0] + counted[-1]) / 2 + 1.3
    told = torch.tensor([float(counted[0]) - 20, middle - 15, middle, middle + 15, float(counted[-1]) + 20]).double()
    place, by_number = coil.moves(numbers, told)
    assert (place - told).tolist() == pytest.approx([3.0, 3.0, 0.0, -3.0, -3.0], abs=0.05)
    for number in range(2):
        step = torch.zeros(2, dtype=torch.float64)
        step[number] = 1e-5
        numeric = (coil.places(numbers + step, told) - coil.places(numbers - step, told)) / 2e-5
        torch.testing.assert_close(by_number[:, number], numeric, atol=1e-6, rtol=1e-5)


def test_what_does_not_move_channels_leaves_anchors_where_they_are():
    told = torch.tensor([0.0, 40.0], dtype=torch.float64)
    place, by_number = extension("clock_offset", "shear_lag").moves(torch.zeros(2, dtype=torch.float64), told)
    assert torch.equal(place, told) and not by_number.any()
