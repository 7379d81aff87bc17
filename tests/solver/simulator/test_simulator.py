"""The generator against independent facts: finite differences, end-point displacements, its own promises."""

import numpy as np
import pytest

from solver.simulator import Scenario, read_scenario, simulate
from solver.simulator.buried_route import Route, rounded, spline_route
from solver.simulator.elastic import extension, gauge_nodes, gauge_weights
from solver.simulator.instrument import filtered
from solver.simulator.observe import in_view
from solver.simulator.recorded_noise import Color, noise, unsteady
from solver.simulator.recording import low_pass_decimate
from solver.simulator.strain import Fiber
from solver.simulator.vehicle import Vehicle
from vision.contract import InputError

STILL = ((0.0, 1.0, 0.0),)


def displacement(point, nu):
    """Boussinesq's displacement for F / (4 pi G) = 1, as DESIGN gives it."""
    x, y, z = point
    r = np.sqrt(x**2 + y**2 + z**2)
    radial = (z / r - (1 - 2 * nu) / (1 + z / r)) / r**2
    return np.array([x * radial, y * radial, (z**2 / r**2 + 2 * (1 - nu)) / r])


def point_load(mass=1000.0, speed=10.0):
    return Vehicle("1", "car", mass, 0.0, 0.0, 0.5, 4, 2, 1, 0.0, 10.0, 50.0, speed, STILL, STILL)


@pytest.mark.parametrize("nu", [0.0, 0.25, 0.45])
@pytest.mark.parametrize(
    "point", [(0.0, 0.0, 0.9), (3.0, 4.0, 0.7), (-20.0, 2.0, 1.1), (0.01, 0.0, 2.0), (1.0, -1.0, 0.05)]
)
def test_extension_is_the_gradient_of_boussinesqs_displacement(point, nu):
    step = 1e-4 * np.linalg.norm(point)
    rng = np.random.default_rng(0)
    gradient = np.stack(
        [
            (displacement(point + step * axis, nu) - displacement(point - step * axis, nu)) / (2 * step)
            for axis in np.eye(3)
        ],
        axis=1,
    )
    for tangent in rng.normal(size=(4, 3)):
        tangent /= np.linalg.norm(tangent)
        expected = tangent @ gradient @ tangent
        assert extension(point, tangent, nu) == pytest.approx(expected, rel=1e-6, abs=1e-7 * abs(gradient).max())


@pytest.mark.parametrize("gauge", [3.3, 10.0, 10.7])
def test_gauge_weights_average_polynomials_exactly(gauge):
    center = np.array([7.0, 11.02, 12.041])
    nodes = gauge_nodes(0.0, 20.0, 1.0)
    average = gauge_weights(center, gauge, 0.0, 20.0, 1.0) @ nodes**3
    exact = ((center + gauge / 2) ** 4 - (center - gauge / 2) ** 4) / (4 * gauge)
    np.testing.assert_allclose(average, exact, rtol=1e-12)


def test_strain_of_a_straight_sloping_fiber_is_the_difference_of_end_point_displacements():
    scenario = Scenario(seed=0)
    route = Route.through(np.array([[0.0, 3.0, 0.8], [120.0, 6.0, 1.4]]))
    distance = np.arange(20.0, 80.0, 7.3)
    vehicle = point_load()
    time = np.array([8.0, 10.0, 11.7])
    strain = Fiber(Scenario(seed=0, effects={"point_load": 1.0}), route, distance).strain(vehicle, time)
    tangent = route.tangent([0.0])[0]
    scale = vehicle.mass * 9.81 / (4 * np.pi * scenario.shear_modulus)
    for row, place in enumerate(vehicle.position(time)):
        ends = [
            np.array(
                [tangent @ displacement(point - np.append(place, 0), 0.25) for point in route.position(distance + half)]
            )
            for half in (-5.0, 5.0)
        ]
        np.testing.assert_allclose(strain[row], scale * (ends[1] - ends[0]) / 10.0, rtol=2e-4, atol=1e-12)


def test_path_integral_on_a_curved_fiber_is_the_integral_of_projected_displacement_gradients():
    """Around a tight bend the end-point difference is wrong; the brute-force integral is not."""
    route = spline_route([[30, 20, 1], [30, 8, 1], [34, 4, 0.8], [50, 4, 1]])
    scenario = Scenario(seed=0, effects={"point_load": 1.0})
    center = np.array([14.0])
    vehicle = point_load()
    strain = Fiber(scenario, route, center).strain(vehicle, np.array([8.2]))[0, 0]
    place = np.append(vehicle.position([8.2])[0], 0)
    arc = center + np.linspace(-5, 5, 4001)
    points, tangents = route.position(arc) - place, route.tangent(arc)
    shifted = [
        np.array([t @ displacement(p + sign * 1e-4 * t, 0.25) for p, t in zip(points, tangents, strict=True)])
        for sign in (1, -1)
    ]
    values = (shifted[0] - shifted[1]) / 2e-4
    expected = np.trapezoid(values, arc) / 10 * vehicle.mass * 9.81 / (4 * np.pi * scenario.shear_modulus)
    assert strain == pytest.approx(expected, rel=1e-4)


def test_strain_rate_is_the_time_derivative_of_strain():
    survey = simulate(Scenario(seed=2, passes=1))
    fiber = Fiber(survey.scenario, *_laid(survey))
    row = int(np.searchsorted(survey.time, survey.vehicles[0].time_at))
    step = 1e-3
    strain = fiber.strain(survey.vehicles[0], survey.time[row] + np.array([-step, step]))
    expected = (strain[1] - strain[0]) / (2 * step)
    assert np.abs(survey.signal[row] - expected).max() < 1e-3 * np.abs(expected).max()


def _laid(survey):
    from solver.simulator.street import lay

    stream = np.random.SeedSequence(survey.scenario.seed).spawn(5)[0]
    return lay(survey.scenario, np.random.default_rng(stream))


@pytest.fixture(scope="module")
def survey():
    return simulate(Scenario(seed=4, passes=4, snr_db=12.0))


def test_snr_is_as_asked_over_the_maps_of_the_passes(survey):
    first, last = survey.active
    rows = in_view(survey.scenario, survey.vehicles, survey.time)
    power = np.mean(survey.signal[rows, first : last + 1] ** 2)
    variance = np.var(survey.strain_rate - survey.signal)
    assert 10 * np.log10(power / variance) == pytest.approx(12.0, abs=0.5)


def test_route_lies_as_described(survey):
    spacing = np.linalg.norm(np.diff(survey.route, axis=0), axis=1)
    assert survey.route.shape == (241, 3)
    assert spacing.max() <= 1.021 + 1e-9 and spacing.min() > 1.01
    first, last = survey.active
    run = survey.route[first : last + 1]
    assert run[0, 0] >= 0 and run[-1, 0] <= 100 and last - first in (96, 97)
    lanes = np.array(survey.scenario.lanes)
    assert (np.abs(run[:, 1:2] - lanes).min(axis=1) > 1.9).all()
    assert ((run[:, 2] > 0.5) & (run[:, 2] < 1.3)).all()


def test_fixes_scatter_about_the_vehicles_by_their_sigma(survey):
    start = np.datetime64(survey.start, "ns")
    for vehicle in survey.vehicles:
        fixes = survey.trajectories[survey.trajectories["track_id"] == vehicle.track_id]
        time = (fixes["time"].dt.tz_localize(None).to_numpy() - start) / np.timedelta64(1, "s")
        error = fixes[["x", "y"]].to_numpy() - vehicle.position(time)
        assert 0.045 < error.std() < 0.075
        assert (np.diff(time) > 0).all()


def test_a_seed_is_a_survey_and_more_passes_leave_the_route(survey):
    again = simulate(survey.scenario)
    np.testing.assert_array_equal(again.strain_rate, survey.strain_rate)
    longer = simulate(Scenario(seed=4, passes=5, snr_db=12.0))
    np.testing.assert_array_equal(longer.route, survey.route)
    other = simulate(Scenario(seed=5, passes=1))
    assert not np.array_equal(other.route, survey.route)


def test_wheels_stand_around_the_middle_of_the_wheelbase():
    van = Vehicle("1", "van", 2000, 3.4, 1.7, 0.6, 5, 2, -1, -3.5, 5.0, 50.0, 10.0, STILL, STILL)
    place, shares = van.wheels([5.0])
    np.testing.assert_allclose(place[0].mean(axis=0), [50.0, -3.5])
    np.testing.assert_allclose(place[0, :2, 0], 48.3)  # the front axle, driving against x
    assert shares.sum() == pytest.approx(1.0) and shares[:2].sum() == pytest.approx(0.6)


def test_velocity_is_the_derivative_of_position(survey):
    vehicle = survey.vehicles[0]
    time = vehicle.time_at + np.linspace(-4, 4, 9)
    numeric = (vehicle.position(time + 1e-4) - vehicle.position(time - 1e-4)) / 2e-4
    np.testing.assert_allclose(vehicle.velocity(time), numeric, rtol=1e-6, atol=1e-7)


def test_clock_offset_moves_the_stamps_and_wheel_layout_hides_the_class():
    base = simulate(Scenario(seed=6, passes=1))
    late = simulate(Scenario(seed=6, passes=1, effects={"clock_offset": 0.15}))
    hidden = simulate(Scenario(seed=6, passes=1, effects={"wheel_layout": 1.0}))
    shift = late.trajectories["time"] - base.trajectories["time"]
    assert shift.dt.total_seconds().to_numpy() == pytest.approx(-0.15)
    assert set(hidden.trajectories["class"]) == {"vehicle"} and "length" not in hidden.trajectories
    np.testing.assert_array_equal(hidden.strain_rate, base.strain_rate)


def test_filtered_sampling_is_the_instant_one_below_the_cutoff():
    slow = {"seed": 7, "passes": 1, "speeds": (20.0, 20.0), "lateral": (5.5, 5.5)}
    instant = simulate(Scenario(**slow))
    filtered = simulate(Scenario(**slow, sampling="filtered"))
    assert filtered.signal.shape == instant.signal.shape
    first, last = instant.active
    error = (filtered.signal - instant.signal)[:, first : last + 1]
    assert np.linalg.norm(error) < 0.03 * np.linalg.norm(instant.signal[:, first : last + 1])


def test_noise_is_colored_common_and_uneven_as_asked():
    sample = noise(np.random.default_rng(3), (4000, 60), Color(common_share=0.2, channel_spread=0.3))
    assert sample.var() == pytest.approx(1.0, abs=0.1)
    correlation = np.corrcoef(sample.T)[np.triu_indices(60, 1)].mean()
    assert correlation == pytest.approx(0.2, abs=0.05)
    sd = np.log(sample.std(axis=0)).std()
    assert 0.15 < sd < 0.35
    slow = np.corrcoef(sample[:-20, 0], sample[20:, 0])[0, 1]
    assert slow > 0.03  # 1/f noise remembers over seconds


def test_a_level_that_drifts_does_so_in_all_channels_alike_and_slowly():
    level = unsteady(Scenario(noise_drift=0.4), np.ones((40_000, 2)))
    assert (level[:, 0] == level[:, 1]).all()
    assert np.log(level[:, 0]).std() == pytest.approx(0.4, abs=0.06)
    assert (level**2).mean() == pytest.approx(1.0, abs=0.15)
    assert np.abs(np.diff(np.log(level[:, 0]))).max() < 0.25


def test_side_traffic_crosses_the_fiber_in_one_place_and_changes_nothing_else():
    plain = simulate(Scenario(seed=2, passes=2, noise="white"))
    crossed = simulate(Scenario(seed=2, passes=2, noise="white", side_street=4.0))
    added = crossed.strain_rate - plain.strain_rate
    assert plain.trajectories.equals(crossed.trajectories)
    loudest = np.abs(added).max(0)
    # Far from where the fiber lies in the crossing only noise would show.
    here = int(loudest.argmax())
    far = np.linalg.norm(plain.route[:, :2] - plain.route[here, :2], axis=1) > 40
    assert loudest[far].max() < 0.05 * loudest[here]
    assert 25 - 12 < plain.route[here, 0] < 75 + 12


def test_a_record_is_rounded_to_steps_of_the_noise():
    survey = simulate(Scenario(seed=2, passes=1, rounding=2.0))
    steps = survey.strain_rate / (2 * survey.noise_sd)
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-9)


def test_filters_pass_and_stop_what_they_should():
    time = np.arange(4000) / 100
    rate = np.stack([np.sin(2 * np.pi * f * time) for f in (0.5, 4.0)], axis=1)
    kept = low_pass_decimate(rate, 20)
    inner = slice(20, -20)
    np.testing.assert_allclose(kept[inner, 0], rate[::20][inner, 0], atol=0.01)
    assert np.abs(kept[inner, 1]).max() < 0.01
    wave = np.sin(2 * np.pi * 0.1 * np.arange(2000) / 5)[:, None]
    for name in ("highpass", "lowpass"):
        passed = filtered(Scenario(effects={name: 0.1}), wave, 0.2)
        assert np.abs(passed[1000:]).max() == pytest.approx(np.sqrt(0.5), abs=0.01)


def test_a_spline_route_goes_through_its_points_by_arc_length():
    knots = np.array([[0.0, 4, 1], [20, 5, 1.1], [45, 4, 0.9], [60, -2, 1]])
    curve = spline_route(knots)
    gap = np.linalg.norm(curve.points[:, None] - knots, axis=2).min(axis=0)
    assert gap.max() < 0.02
    arc = np.linspace(1, curve.length - 1, 50)
    moved = np.linalg.norm(curve.position(arc + 0.05) - curve.position(arc - 0.05), axis=1)
    np.testing.assert_allclose(moved, 0.1, rtol=1e-3)
    survey = simulate(Scenario(seed=1, passes=1, view=(5.0, 55.0), route=tuple(map(tuple, knots.tolist()))))
    assert survey.route.shape == (int(curve.length / 1.021) + 1, 3)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("passes = 0", "passes: at least 1"),
        ("passes = 2.5", "passes: must be a whole number"),
        ("passes = [9, 8]", "passes: the first number"),
        ("passes = [8, 9.5]", "passes: must be a whole number"),
        ("noise = 'brown'", "noise: one of white, colored, street"),
        ("track_noise = 'gps'", "track_noise: one of white, camera"),
        ("noise_freedom = 1.5", "noise_freedom: above 2"),
        ("side_street = -1", "side_street: 0 or above"),
        ("bad_channels = 500", "fewer than the channels"),
        ("pases = 3", "no setting `pases`"),
        ("snr_db = 'high'", "snr_db: must be a number"),
        ("speeds = [80, 30]", "speeds: the first number"),
        ("depth = [0.05, 0.1]", "below the ground"),
        ("side = 'under'", "side: left, right or either"),
        ("route = [[0, 1, 1]]", "at least two points"),
        ("route = [[0, 1, 1], [50, 1]]", "at least two points"),
        ("route = [[0, 1, 1], [50, 1, -1]]", "z is depth"),
        ("route = [[200, 4, 1], [250, 4, 1]]", "no channel lies within the view"),
        ("[effects]\nwheels = 1", "effects: known are"),
        ("[effects]\nlowpass_ordre = 1", "effects: known are"),
        ("[effects]\nshear_lag = -1", "shear_lag: must not be negative"),
        ("[effects]\npoisson_ratio = 0.3", "between 0 and 0.5"),
        ("[effects]\nmoving_load = 0.6", "as fast as surface waves"),
        ("[classes]\ntank = 1", "classes: known are"),
        ("start = 'noon'", "ISO 8601"),
        ("base = 'moon'", "no built-in scenario"),
        ("passes = ", "invalid TOML"),
    ],
)
def test_a_bad_scenario_is_one_clear_line(tmp_path, text, message):
    path = tmp_path / "scenario.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        simulate(read_scenario(path))
    assert "\n" not in str(caught.value)


def test_a_scenario_file_starts_from_a_built_in_one_and_options_win(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text('base = "street-gps"\nseed = 5\nside = "left"\nlateral = [3, 4]\n[effects]\nhighpass = 0.08\n')
    scenario = read_scenario(path, seed=9, passes=None)
    assert (scenario.name, scenario.seed, scenario.gps, scenario.side) == ("mine", 9, True, "left")
    assert scenario.effect("highpass") == 0.08 and scenario.lateral == (3, 4)
    with pytest.raises(InputError, match="neither a file nor a built-in"):
        read_scenario(tmp_path / "absent.toml")


def test_the_practice_surveys_are_such_streets(shared_data):
    """Surveys by another author: with their route and tracks, our strain rate leaves only their noise."""
    import json

    from solver.survey.das import read_das
    from solver.survey.site import read_site
    from vision.contract import read_trajectories

    folder = shared_data / "practice"
    known = json.loads((folder / "answers.json").read_text())["survey-01"]
    site = read_site(folder / "survey-01" / "site.toml")
    record = read_das(site.das.files, gauge_length=10.0, channel_spacing=1.021, quantity="strain_rate")
    route = Route.through(np.array(known["route_xyz"]))
    seen = slice(80, 160)
    fiber = Fiber(Scenario(), route, route.arc[seen])
    fixes = read_trajectories(site.trajectories.files).query("`class` == 'bus'")
    time = (fixes["time"].dt.tz_localize(None).to_numpy() - record.start) / np.timedelta64(1, "s")
    path = np.polynomial.Polynomial.fit(time, fixes["x"], 4)
    middle = time.mean()
    bus = Vehicle(
        "5", "bus", 1e4, 5.9, 2.05, 0.38, 12, 2.5, 1, fixes["y"].mean(), middle, path(middle), path.deriv()(middle),
        STILL, STILL,
    )  # fmt: skip
    rows = np.flatnonzero(np.abs(record.time - middle) < 2.5)
    measured = record.strain_rate[rows, seen]
    model = (fiber.strain(bus, record.time[rows] + 0.01) - fiber.strain(bus, record.time[rows] - 0.01)) / 0.02
    scale = (model * measured).sum() / (model**2).sum()
    assert scale > 0
    assert ((measured - scale * model) ** 2).sum() < 0.05 * (measured**2).sum()


@pytest.mark.parametrize("radius", [0.3, 0.8, 3.0, 10.0])
def test_strain_around_a_bend_is_its_path_integral(radius):
    """Against a quadrature every millimeter along an exact circle between two straight parts; 0.2 % of the peak."""
    curve, _ = rounded(np.array([[0.0, 2], [60, 2], [60, 60]]), [radius])
    route = Route.through(np.column_stack([curve, np.full(len(curve), 0.7)]))
    vehicle, time = point_load(), np.array([9.9, 10.8])
    begin = 60 - radius
    arc = np.arange(begin - 60, begin + 80, 0.001)
    angle = np.clip((arc - begin) / radius, 0, np.pi / 2)
    x = np.minimum(arc, begin) + radius * np.sin(angle)
    y = 2 + radius * (1 - np.cos(angle)) + np.maximum(arc - begin - radius * np.pi / 2, 0)
    for gauge in (2.0, 10.0, 50.0):
        scenario = Scenario(gauge_length=gauge, effects={"point_load": 1.0})
        center = begin + np.linspace(-gauge / 2, gauge / 2, 9)
        strain = Fiber(scenario, route, center).strain(vehicle, time)
        expected = np.empty_like(strain)
        for row, (ahead, aside) in enumerate(vehicle.position(time)):
            field = extension((x - ahead, y - aside, 0.7), (np.cos(angle), np.sin(angle), 0 * angle), 0.25)
            summed = np.cumsum(field) * 0.001
            ends = [np.interp(center + half, arc, summed) for half in (gauge / 2, -gauge / 2)]
            expected[row] = (ends[0] - ends[1]) / gauge
        expected *= vehicle.mass * 9.81 / (4 * np.pi * scenario.shear_modulus)
        assert np.abs(strain - expected).max() < 2e-3 * np.abs(expected).max()
