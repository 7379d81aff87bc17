"""Hidden effects of the generator against independent facts: closed forms, brute force, their own promises."""

import numpy as np
import pytest

from solver.simulator import EFFECTS, Scenario, Vehicle, simulate
from solver.simulator.axle_forces import contact
from solver.simulator.buried_route import Route
from solver.simulator.effects import amount_of
from solver.simulator.elastic import tangential_extension
from solver.simulator.fiber_motion import arc_of, shear_lag, slip
from solver.simulator.instrument import clipped, creep, rate_of
from solver.simulator.known import KNOWN
from solver.simulator.outside import amplified, handled, load_factor
from solver.simulator.recorded_noise import color, damage
from solver.simulator.strain import Fiber
from solver.simulator.tracking import reported, stamps, wander
from solver.simulator.unknown import UNKNOWN
from solver.simulator.vehicle import GRAVITY

STILL = ((0.0, 1.0, 0.0),)
IN_TRACKS = {name for name, effect in EFFECTS.items() if effect.stage == "trajectory"} | {"wheel_layout"}
IN_RECORD = {name for name, effect in EFFECTS.items() if effect.stage == "processing"}
ON_ROUTE = {"slack_spool", "sloping_fiber", "curved_gauge", "channel_stretch", "channel_wander"}


def car(direction=1, **changes):
    facts = {
        "track_id": "1", "vehicle_class": "car", "mass": 1400.0, "wheelbase": 2.6, "track": 1.5, "front_share": 0.6,
        "length": 4.4, "width": 1.8, "direction": direction, "lane": 0.0, "time_at": 10.0, "x_at": 50.0, "speed": 15.0,
        "surge": STILL, "weave": STILL,
    }  # fmt: skip
    return Vehicle(**(facts | changes))


SMALL = {
    "seed": 6, "passes": 2, "channels": 130, "view": (0.0, 40.0), "speeds": (50.0, 70.0), "headway": (6.0, 8.0),
    "classes": {"truck": 1.0},
}  # fmt: skip


@pytest.fixture(scope="module")
def base():
    return simulate(Scenario(**SMALL))


def test_effects_of_no_amount_change_nothing(base):
    null = simulate(Scenario(**SMALL, effects=dict.fromkeys(EFFECTS, 0.0)))
    np.testing.assert_array_equal(null.strain_rate, base.strain_rate)
    assert null.trajectories.equals(base.trajectories)


@pytest.mark.parametrize("name", EFFECTS)
def test_an_effect_changes_its_stage_and_no_other(base, name):
    real = simulate(Scenario(**SMALL, effects={name: float(np.mean(EFFECTS[name].plausible))}))
    first, last = base.active
    rows = min(len(base.time), len(real.time))
    change = (real.signal - base.signal[:rows] if rows == len(real.time) else real.signal[:rows] - base.signal)[
        :, first : last + 1
    ]
    relative = np.linalg.norm(change) / np.linalg.norm(base.signal[:, first : last + 1])
    assert (relative > 0.01) == (name not in IN_TRACKS | IN_RECORD)
    tracks = ["time", "x", "y", "class"]
    assert real.trajectories[tracks].equals(base.trajectories[tracks]) == (
        name not in IN_TRACKS | {"point_load", "braking"}
    )
    assert np.array_equal(real.route, base.route) == (name not in ON_ROUTE)
    recorded = (real.strain_rate - real.signal) / real.noise_sd
    usual = (base.strain_rate - base.signal) / base.noise_sd
    if rows == len(base.time) == len(real.time):
        assert np.allclose(recorded, usual, atol=1e-6) == (name not in IN_RECORD)


def test_a_setting_is_drawn_by_the_seed_within_its_range_unless_given():
    drawn = {amount_of({}, seed, "viscoelastic_lag_tau") for seed in range(20)}
    assert len(drawn) == 20 and min(drawn) >= 0.3 and max(drawn) <= 0.6
    assert amount_of({"viscoelastic_lag_tau": 4.0}, 3, "viscoelastic_lag_tau") == 4.0
    with pytest.raises(KeyError):
        amount_of({}, 0, "viscoelastic_lag_tow")


def cerruti(point, nu):
    """Displacement under a unit load along x, F / (4 pi G) = 1 (Poulos & Davis 1974)."""
    x, y, z = point
    r = np.linalg.norm(point)
    k, s = 1 - 2 * nu, r + z
    return np.array(
        [
            (1 + x**2 / r**2 + k * (r / s - x**2 / s**2)) / r,
            x * y / r**3 * (1 - k * r**2 / s**2),
            x / r**2 * (z / r + k * r / s),
        ]
    )


@pytest.mark.parametrize("nu", [0.0, 0.25, 0.45])
def test_tangential_extension_is_that_of_cerruti_for_a_push_in_any_direction(nu):
    rng = np.random.default_rng(1)
    point, tangent = np.array([1.3, -2.0, 0.9]), rng.normal(size=3)
    tangent /= np.linalg.norm(tangent)
    for angle in (0.0, 0.7, np.pi / 2, 2.5):
        turn = np.array([[np.cos(angle), np.sin(angle), 0], [-np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        step = 1e-4
        along = [turn.T @ cerruti(turn @ (point + sign * step * tangent), nu) @ tangent for sign in (1, -1)]
        force = (np.array(np.cos(angle)), np.array(np.sin(angle)))
        found = tangential_extension(point, tangent, force, nu)
        assert found == pytest.approx((along[0] - along[1]) / (2 * step), rel=1e-5)


def test_cerruti_is_in_equilibrium_with_its_load():
    """Navier's equation holds in the ground: (1 - 2 nu) laplace u + grad div u = 0."""
    nu, h = 0.3, 1e-2
    point, eye = np.array([0.8, -0.5, 1.1]), np.eye(3)
    hessian = np.array(
        [
            [
                sum(
                    a * b * cerruti(point + h * (a * eye[i] + b * eye[j]), nu) for a in (-1, 1) for b in (-1, 1)
                ) / (4 * h * h)
                for j in range(3)
            ]
            for i in range(3)
        ]
    )  # fmt: skip
    laplace = np.einsum("iik->k", hessian)
    divergence = np.einsum("ikk->i", hessian)
    assert np.abs((1 - 2 * nu) * laplace + divergence).max() < 1e-2 * np.abs(hessian).max()


@pytest.mark.parametrize("brakes", [(9.0, 2.0, 3.0, 1.0), (9.0, 2.0, 2.0, 0.5)])
def test_braking_is_the_derivative_of_the_way_and_the_dip_its_moment(brakes):
    braking, most = car(brakes=(brakes,), direction=-1), brakes[2]
    time = np.linspace(8, 13, 201)
    numeric = (braking.position(time + 1e-4) - braking.position(time - 1e-4)) / 2e-4
    np.testing.assert_allclose(braking.velocity(time), numeric, atol=1e-6)
    slowing = -np.gradient(np.linalg.norm(braking.velocity(time), axis=1), time)
    np.testing.assert_allclose(slowing[1:-1], braking.deceleration(time)[1:-1], atol=2e-2)
    assert braking.velocity([20.0])[0, 0] == pytest.approx(-12.0)
    scenario = Scenario(effects={"braking": 0.3})
    place, force = contact(scenario, braking, np.array([10.0]))
    weight = 1400 * GRAVITY
    assert force[0, :, 2].sum() == pytest.approx(weight)
    assert force[0, :, 0].sum() == pytest.approx(-1400 * most)  # pushed ahead: against x
    moment = (force[0, :, 2] * (place[0, :, 0] - place[0, :, 0].mean())).sum()
    still = contact(scenario, car(direction=-1), np.array([10.0]))
    before = (still[1][0, :, 2] * (still[0][0, :, 0] - still[0][0, :, 0].mean())).sum()
    assert moment - before == pytest.approx(-1400 * most * 0.6)


def test_vehicles_brake_over_one_stretch_as_hard_as_they_can_without_losing_more_than_three_fifths_of_their_speed():
    effects = {"braking": 0.2, "braking_share": 1.0, "braking_length": 30.0, "braking_at": 0.2}
    street = simulate(Scenario(**SMALL | {"view": (0.0, 60.0), "speeds": (25.0, 70.0), "passes": 3}, effects=effects))
    for one in street.vehicles:
        time = np.linspace(one.time_at - 6, one.time_at + 9, 3001)
        held = one.deceleration(time) > 0.5 * one.deceleration(time).max()
        place = one.position(time[held])[:, 0]
        assert np.ptp(place) == pytest.approx(30.0, rel=0.1)
        assert (place[0] - (12.0 if one.direction > 0 else 48.0)) == pytest.approx(0.0, abs=1.0)
        assert np.abs(one.velocity(time)[:, 0]).min() > 0.35 * one.speed
        assert one.deceleration(time).max() <= 0.2 * GRAVITY


def test_drag_pushes_back_and_camber_to_the_right():
    for direction in (1, -1):
        _, force = contact(Scenario(effects={"grade_drag": 0.05, "camber": 0.02}), car(direction), np.array([10.0]))
        share = force[0].sum(0) / (1400 * GRAVITY)
        np.testing.assert_allclose(share, [-0.05 * direction, 0.02 * direction, 1.0], atol=1e-12)


def test_the_load_swings_after_a_bump_and_always_by_dynamic_load():
    bump = Scenario(effects={"road_bump": 0.4, "road_bump_at": 0.6})
    time = np.linspace(9, 16, 7001)
    load = contact(bump, car(), time)[1][:, :, 2].sum(1) / (1400 * GRAVITY) - 1
    crossing = car().time_when_at(60.0)
    assert crossing == pytest.approx(10 + 10 / 15, abs=1e-3)
    assert np.abs(load[time < crossing]).max() < 1e-12
    assert load.max() == pytest.approx(0.4, abs=1e-3) and abs(load[-1]) < 0.05
    dynamic = Scenario(effects={"dynamic_load": 0.2, "dynamic_load_frequency": 2.0})
    load = contact(dynamic, car(), time)[1][:, :, 2].sum(1) / (1400 * GRAVITY) - 1
    assert load.std() == pytest.approx(0.2 / np.sqrt(2), rel=0.01)
    np.testing.assert_allclose(load[500:], load[:-500], atol=1e-9)  # 0.5 s


def test_a_long_vehicle_stands_on_its_axles():
    survey = simulate(Scenario(**SMALL, effects={"long_vehicle": 12.0}))
    long = survey.vehicles[0]
    place, shares = long.wheels([long.time_at])
    assert shares.sum() == pytest.approx(1.0) and place.shape == (1, 10, 2)
    assert np.ptp(place[0, :, 0]) == pytest.approx(12.0, abs=0.2)
    assert long.axles and survey.vehicles[1].axles == ()


def test_creep_is_what_the_models_say_of_a_load_that_comes_and_stays():
    step, time = 0.01, np.arange(0, 6, 0.01)
    load = np.minimum(time / 0.01, 1.0)[:, None]
    solid = {"viscoelastic_lag": 0.4, "viscoelastic_lag_tau": 0.5}
    expected = 1 + 0.4 * (1 - np.exp(-(time - 0.005) / 0.5))
    np.testing.assert_allclose(creep(Scenario(effects=solid), load, step)[5:, 0], expected[5:], atol=1e-4)
    voigt = {"viscoelastic_lag": 0.3, "viscoelastic_lag_model": 1.0}
    expected = 1 - np.exp(-(time - 0.005) / 0.3)
    np.testing.assert_allclose(creep(Scenario(effects=voigt), load, step)[5:, 0], expected[5:], atol=1e-3)
    maxwell = {"viscoelastic_lag": 0.2, "viscoelastic_lag_model": 2.0}
    np.testing.assert_allclose(creep(Scenario(effects=maxwell), load, step)[-1, 0], 1 + 0.2 * 5.985, atol=1e-3)


def test_time_averaging_is_the_difference_over_its_window():
    strain = np.sin(np.arange(0, 10, 0.01))[:, None]
    middle = np.arange(0, 9.99, 0.01) + 0.005
    rate = rate_of(Scenario(effects={"time_averaging": 0.237}), strain, 0.01)
    expected = (np.sin(middle) - np.sin(middle - 0.237)) / 0.237
    np.testing.assert_allclose(rate[50:, 0], expected[50:], atol=2e-4)


def test_shear_lag_passes_waves_by_its_transfer_and_keeps_the_mean():
    nodes = np.sort(np.random.default_rng(0).uniform(0, 200, 4000))
    nodes[[0, -1]] = 0, 200
    picks = np.zeros((1, 4000))
    at = int(np.searchsorted(nodes, 100.0))
    picks[0, at] = 1.0
    weights = shear_lag(picks, nodes, 1.5)
    assert weights.sum() == pytest.approx(1.0)
    for k in (0.3, 1.0):
        passed = (weights @ np.cos(k * (nodes - nodes[at])))[0]
        assert passed == pytest.approx(1 / (1 + k**2 * 1.5**2), abs=2e-3)


def test_fiber_that_slips_feels_the_mean_only():
    nodes = np.arange(0.5, 40)
    strain = nodes**2
    sensed = slip(np.eye(40), nodes, np.ones(40), 10.0, 20.0) @ strain
    np.testing.assert_allclose(sensed[10:20], strain[10:20].mean())
    np.testing.assert_array_equal(sensed[:10], strain[:10])
    np.testing.assert_array_equal(sensed[20:], strain[20:])


def test_a_spool_shifts_the_channels_beyond_and_feels_nothing():
    scenario = Scenario(effects={"slack_spool": 20.0, "slack_spool_at": 0.5})
    route = Route.through(np.array([[0.0, 3, 1], [120, 3, 1]]))
    distance = np.arange(0.0, 101.0)
    arc = arc_of(scenario, distance, distance)
    assert arc[40] == 40 and arc[60] == 50 and arc[90] == 70
    strain = Fiber(scenario, route, distance).strain(car(), np.array([10.0]))[0]
    plain = Fiber(Scenario(), route, distance).strain(car(), np.array([10.0]))[0]
    assert abs(strain[60]) < 1e-15  # its gauge lies in the coil
    np.testing.assert_allclose(strain[80:], plain[60:81], atol=1e-3 * np.abs(plain).max())


def test_pulse_width_is_a_running_mean_of_channels():
    route = Route.through(np.array([[0.0, 3, 1], [120, 3, 1]]))
    distance, time = np.arange(30.0, 70.0, 0.5), np.array([9.8, 10.3])
    wide = Fiber(Scenario(effects={"pulse_width": 4.0}), route, distance).strain(car(), time)
    fine = np.arange(28.0, 72.01, 0.05)
    plain = Fiber(Scenario(), route, fine).strain(car(), time)
    expected = np.array([plain[:, np.abs(fine - d) <= 2.0].mean(1) for d in distance]).T
    np.testing.assert_allclose(wide, expected, atol=6e-3 * np.abs(plain).max())


def test_saturation_clips_and_skips_jump_where_the_rate_is_large():
    rate = np.outer(np.linspace(-1, 1, 400), np.ones(50))
    assert np.abs(clipped(Scenario(effects={"saturation": 0.4}), rate)).max() == pytest.approx(0.4)
    skipped = clipped(Scenario(effects={"cycle_skips": 0.05, "cycle_skips_size": 1.0}), rate) - rate
    hit = skipped != 0
    assert np.abs(rate[hit]).min() > 0.1 and hit.mean() == pytest.approx(0.045, abs=0.01)
    np.testing.assert_allclose(np.abs(skipped[hit]), 1.0)


@pytest.mark.parametrize(
    ("name", "amount", "mend"),
    [
        ("track_offset", 0.4, lambda p: p + np.array([0, 0.4])),
        ("track_bias", 0.7, lambda p: p + np.array([-0.7, 0])),
        ("track_bend", 0.5, lambda p: p + np.stack([0 * p[:, 0], 0.5 * ((p[:, 0] - 50) / 50) ** 2], 1)),
        ("track_scale", 0.02, lambda p: (p - [50, -1.75]) * 1.02 + [50, -1.75]),
        (
            "track_rotation", 1.0,
            lambda p: (p - [50, -1.75]) @ np.array([[np.cos(np.pi / 180), np.sin(np.pi / 180)],
                                                    [-np.sin(np.pi / 180), np.cos(np.pi / 180)]]) + [50, -1.75],
        ),
    ],
)  # fmt: skip
def test_adding_the_amount_mends_the_track(name, amount, mend):
    scenario = Scenario(fix_sigma=0.0, effects={name: amount})
    time = np.linspace(7.5, 12.5, 20)
    told = reported(scenario, car(direction=-1), time, np.random.default_rng(0))
    np.testing.assert_allclose(mend(told), car(direction=-1).position(time), atol=1e-9)


@pytest.mark.parametrize("name", UNKNOWN)
def test_a_survey_with_an_unknown_effect_has_no_known_one(name):
    assert name.startswith("unknown_") and name not in KNOWN
    assert UNKNOWN[name].stage in {"load", "ground", "cable", "interrogator", "processing", "trajectory"}


def test_an_echo_is_of_the_channel_farther_on_and_an_equalized_record_is_flatter():
    rate = np.zeros((3, 50))
    rate[:, 30] = 2.0
    echoed = amplified(Scenario(effects={"unknown_echo": 0.1}), rate, np.arange(3.0))
    assert echoed[0, 10] == pytest.approx(0.2) and echoed[0, 30] == 2.0
    record = np.random.default_rng(0).normal(size=(200, 50)) * np.linspace(1, 10, 200)[:, None]
    flat = handled(Scenario(effects={"unknown_equalized": 1.0}), record)
    rms = np.sqrt((flat**2).mean(1))
    assert rms.std() < 1e-9


def test_a_skewed_kernel_looks_ahead_only():
    route = Route.through(np.array([[0.0, 3, 1], [120, 3, 1]]))
    distance, time = np.arange(30.0, 70.0, 0.5), np.array([9.8])
    scenario = Scenario(effects={"unknown_skewed_kernel": 0.4, "unknown_skewed_kernel_tail": 5.0})
    skewed = Fiber(scenario, route, distance).strain(car(), time)[0]
    fine = np.arange(30.0, 119.0, 0.1)
    plain = Fiber(Scenario(), route, fine).strain(car(), time)[0]
    ahead = np.arange(0, 40, 0.1)
    bell = np.exp(-ahead / 5.0)
    expected = [
        0.6 * np.interp(d, fine, plain) + 0.4 * (bell * np.interp(d + ahead, fine, plain)).sum() / bell.sum()
        for d in distance
    ]
    np.testing.assert_allclose(skewed, expected, atol=0.03 * np.abs(plain).max())


def test_the_wake_pulls_behind_large_vehicles_only():
    scenario = Scenario(effects={"unknown_wake": 0.3, "unknown_wake_length": 12.0})
    bus = car(length=12.0)
    place, force = contact(scenario, bus, np.array([10.0]))
    assert force[0, 4:, 2].sum() == pytest.approx(-0.3 * 1400 * GRAVITY)
    assert place[0, 4:, 0].max() < 50 - 6 and place[0, 4:, 0].min() > 50 - 18
    assert contact(scenario, car(), np.array([10.0]))[1].shape == (1, 4, 3)


def test_the_road_profile_is_the_same_for_both_directions():
    scenario = Scenario(effects={"unknown_road_profile": 0.2})
    there, back = car(), car(direction=-1)
    x = np.linspace(10, 90, 50)
    load = [
        load_factor(scenario, vehicle, np.array([vehicle.time_when_at(place) for place in x]))
        for vehicle in (there, back)
    ]
    np.testing.assert_allclose(load[0], load[1], atol=1e-3)
    assert 0.1 < load[0].std() < 0.4


def test_slow_track_errors_have_their_sd_and_correlation():
    time = np.arange(0, 4000, 0.2)
    error = wander(np.random.default_rng(5), time, 2.0)
    assert error.std() == pytest.approx(1.0, abs=0.1)
    lag = [np.corrcoef(error[k:], error[:-k])[0, 1] for k in (1, 10, 50)]
    assert lag[0] > 0.97 and lag[1] == pytest.approx(3 * np.exp(-2), abs=0.1) and abs(lag[2]) < 0.1
    survey = simulate(Scenario(seed=3, passes=1, effects={"track_jitter": 0.4}))
    plain = simulate(Scenario(seed=3, passes=1))
    departure = (survey.trajectories[["x", "y"]] - plain.trajectories[["x", "y"]]).to_numpy()
    assert 0.1 < departure.std() < 0.8 and np.abs(np.diff(departure, axis=0)).max() < 0.15


def test_a_clock_that_drifts_and_is_off():
    scenario = Scenario(effects={"clock_drift": 1e-3, "clock_offset": 0.2})
    np.testing.assert_allclose(stamps(scenario, np.array([0.0, 100.0])), [-0.2, 99.7])


def test_street_noise_is_drawn_and_white_is_white():
    kinds = [color(Scenario(seed=seed, noise="street")) for seed in range(30)]
    shares = np.array([kind.common_share for kind in kinds])
    assert 0 <= shares.min() < 0.05 and 0.15 < shares.max() <= 0.2
    survey = simulate(Scenario(seed=4, passes=1, noise="white"))
    sample = (survey.strain_rate - survey.signal) / survey.noise_sd
    assert sample.std() == pytest.approx(1.0, abs=0.02)
    assert abs((sample[1:] * sample[:-1]).mean()) < 0.02
    assert abs((sample[:, 1:] * sample[:, :-1]).mean()) < 0.02
    assert np.log(sample.std(0)).std() < 0.06


def test_damage_is_where_and_what_was_asked():
    quiet = np.zeros((500, 40))
    assert not damage(Scenario(), quiet, 1.0).any()
    hurt = damage(Scenario(bad_channels=3, spikes=0.01, gaps=2), quiet, 1.0)
    assert (np.nanstd(hurt, axis=0) > 10).sum() == 3
    lost = np.isnan(hurt)
    assert lost.any() and (lost.all(axis=1) == lost.any(axis=1)).all()
    usual = np.nanstd(hurt, axis=0) < 10
    assert (hurt[:, usual][~lost[:, usual]] != 0).mean() == pytest.approx(0.01, abs=0.003)


def test_a_range_of_passes_and_snr_is_drawn():
    survey = simulate(Scenario(seed=2, passes=(1, 2), snr_db=(15.0, 20.0)))
    assert survey.scenario.passes == len(survey.vehicles) <= 2
    assert 15 <= survey.scenario.snr_db <= 20
