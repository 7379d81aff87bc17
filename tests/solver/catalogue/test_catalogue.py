"""Every effect of the catalogue keeps the promises of effects, and every row of the catalogue's list is there."""

import math
from dataclasses import replace
from itertools import product
from zlib import crc32

import numpy as np
import pytest
import torch

from solver.catalogue.catalogue import built_in, family, find
from solver.catalogue.trial_survey import Trial, trial_survey
from solver.catalogue.verify import plausible, verify
from solver.effect import FAMILIES, Effect, Parameter, effect
from solver.fit.map_fit import MapFit
from solver.fit.numbers import Numbers
from solver.fit.prior import Prior
from solver.signal_path.derivatives import derivative
from solver.signal_path.observation import BASE
from solver.signal_path.traffic import columns
from vision.contract import InputError

EVERY = pytest.mark.parametrize("name", built_in())

#: Rows of the catalogue as the field names them -> effects that cover them; a "fault" is mended in the survey.
ROWS = {
    "wheel_layout": ["wheel_layout"],
    "front_share": ["front_share"],
    "long_vehicle": ["long_vehicle"],
    "dynamic_load": ["dynamic_load"],
    "road_bump": ["road_bump"],
    "braking": ["braking"],
    "grade_drag": ["grade_drag"],
    "camber": ["camber"],
    "poisson_ratio": ["poisson_ratio"],
    "poisson_gradient": ["poisson_gradient"],
    "stiffness_contrast": ["stiffness_contrast"],
    "layered_ground": ["layered_ground"],
    "pavement": ["pavement"],
    "gibson_soil": ["gibson_soil"],
    "moving_load": ["moving_load"],
    "viscoelastic_lag": ["viscoelastic_lag", "kelvin_voigt_lag", "maxwell_flow"],
    "rayleigh_wave": ["rayleigh_wave"],
    "channel_coupling": ["channel_coupling"],
    "shear_lag": ["shear_lag"],
    "conduit_slip": ["conduit_slip"],
    "slack_spool": ["slack_spool"],
    "sloping_fiber": ["sloping_fiber"],
    "curved_gauge": ["curved_gauge"],
    "channel_stretch": ["channel_stretch"],
    "channel_wander": ["channel_wander"],
    "gauge_length": ["gauge_length"],
    "pulse_width": ["pulse_width"],
    "time_averaging": ["time_averaging"],
    "highpass": ["highpass"],
    "lowpass": ["lowpass", "lowpass_zero_phase"],
    "saturation": ["saturation"],
    "cycle_skips": "fault",
    "common_mode": ["common_mode"],
    "fk_filter, median_filter": ["fk_filter", "median_filter"],
    "clock_offset, clock_drift": ["clock_offset", "clock_drift"],
    "track_bias": ["track_bias"],
    "track_offset, track_rotation, track_scale": ["track_offset", "track_rotation", "track_scale"],
    "track_bend": ["track_bend"],
    "track_jitter": ["track_jitter"],
    "unseen_vehicle": "fault",
}


def trial(name: str) -> Trial:
    return Trial(built_in()[name], *trial_survey())


def shapes(effect: Effect) -> list[dict[str, float]]:
    """All that the search tries; of long grids every third."""
    grids = [p.grid if len(p.grid) < 9 else p.grid[::3] for p in effect.shapes]
    return [dict(zip((p.name for p in effect.shapes), values, strict=True)) for values in product(*grids)]


def away(one: Trial) -> torch.Tensor:
    """Numbers [number] off null and off the grid, within bounds; never twice the same for one parameter's numbers."""
    rng = np.random.default_rng(crc32(one.effect.name.encode()))
    numbers = one.numbers()
    for slot in one.extension.slots:
        p, count = slot.parameter, slot.where.stop - slot.where.start
        middle = p.grid[len(p.grid) // 2] if p.is_shape else p.null
        reach = p.plausible if p.is_shape else plausible(p) - p.null
        numbers[slot.where] = middle + reach * torch.from_numpy(rng.uniform(0.2, 0.9, count))
    return Numbers.of(one.extension, Prior()).bounded(numbers)


@EVERY
def test_an_effect_is_absent_at_null_whatever_its_shape(name):
    one = trial(name)
    base = one.base()
    for shape in shapes(one.effect):
        torch.testing.assert_close(one.map(one.numbers(shape)), base, rtol=0, atol=4e-15 * float(base.abs().max()))


@EVERY
@pytest.mark.parametrize("start", ["null", "away"])
def test_derivatives_are_those_of_finite_differences(name, start):
    one = trial(name)
    numbers = one.numbers() if start == "null" else away(one)
    seen = one.seen(numbers)
    rng = np.random.default_rng(1)
    for slot in one.extension.slots:
        if start == "null" and slot.parameter.is_shape:
            continue
        columns = derivative(seen, slot, numbers)
        assert columns.isfinite().all()
        direction = torch.zeros_like(numbers)
        direction[slot.where] = torch.from_numpy(rng.uniform(0.5, 1.5, len(columns)))
        step = 1e-5 * slot.parameter.plausible * direction
        numeric = (one.map(numbers + step) - one.map(numbers - step)) / (2e-5 * slot.parameter.plausible)
        exact = torch.einsum("n,nsc->sc", direction[slot.where], columns)
        if start == "null":
            assert exact.abs().max() > 1e-4 * one.base().abs().max() / slot.parameter.plausible
        assert (exact - numeric).abs().max() < 2e-5 * exact.abs().max() + 1e-9 * one.base().abs().max()


@EVERY
def test_an_effect_changes_one_stage(name):
    one = trial(name)
    values, (fit, state) = one.extension.local(away(one)), trial_survey()
    plain = replace(fit.path, traffic=one.path.traffic)
    vehicles = state.vehicles.rows(plain.traffic)
    per_row = replace(vehicles, **{key: value[:, None] for key, value in vars(vehicles).items()})
    base, changed = plain.loads(per_row, {}), one.path.loads(per_row, values)
    moved = {f for f in ("position", "velocity", "heading") if not same(base.trajectory, changed.trajectory, f)}
    assert bool(moved) == (one.effect.stage == "trajectory")
    if one.effect.stage != "trajectory":
        loaded = {f for f in ("position", "share", "share_rate", "thrust") if not same(base, changed, f)}
        assert bool(loaded) == (one.effect.stage == "load")
    described = one.path.described(values)
    assert (described.ground is not BASE.ground) == (one.effect.stage == "ground")
    assert (described.processing is not BASE.processing) == (one.effect.stage == "processing")
    plain = replace(BASE.cable, counted=one.around.distance)
    assert differ(described.cable, plain) == (one.effect.stage == "cable")
    instrument = replace(BASE.interrogator, gauge_length=fit.problem.gauge_length)
    assert differ(described.interrogator, instrument) == (one.effect.stage == "interrogator")


def differ(one, other) -> bool:
    return any(value is not getattr(other, field) for field, value in vars(one).items())


def same(one, other, field: str) -> bool:
    a, b = getattr(one, field), getattr(other, field)
    return (a is None and b is None) or (a is not None and b is not None and a.shape == b.shape and torch.equal(a, b))


@EVERY
def test_parameters_are_declared_soundly(name):
    one = built_in()[name]
    assert one.physics.endswith(".") and len(one.source) > 10 and one.amplitudes
    for p in one.parameters:
        assert p.unit in ("1", "m", "m^2", "s", "1/s", "Hz", "m/s", "1/m", "s^2/m^2", "g", "degree")
        assert 0 < p.plausible < math.inf and p.lower < p.upper
        if p.is_shape:
            assert list(p.grid) == sorted(set(p.grid)) and p.lower <= p.grid[0] and p.grid[-1] <= p.upper
            steps = np.diff(p.grid)
            assert len(p.grid) == 1 or p.plausible < 8 * steps.max()
        else:
            assert p.lower <= p.null - p.plausible or p.null + p.plausible <= p.upper


def test_built_in_effects_pass_what_users_effects_must():
    for name in ("track_bend", "wheel_layout", "rayleigh_wave", "conduit_slip", "saturation", "median_filter"):
        verify(built_in()[name])


def test_every_row_of_the_list_is_covered():
    covered = {name for names in ROWS.values() if names != "fault" for name in names}
    assert covered == {name for name, one in built_in().items() if not one.generic}


def test_every_row_can_be_hidden_by_the_independent_simulator():
    from solver.simulator.known import KNOWN

    rows = {name.strip() for row in ROWS for name in row.split(",")}
    assert rows - set(KNOWN) <= {"track_offset", "track_rotation", "track_scale"}


def test_families_have_members_that_are_told_apart():
    every = built_in()
    for kind in FAMILIES:
        members = family(kind, every.values())
        assert len(members) > 1 and not any(every[name].generic for name in members)
    assert every["time_averaging"].families == ("blur", "lag")


def test_an_unknown_name_is_answered_with_similar_ones():
    with pytest.raises(InputError, match=r"did you mean .*clock_offset.*lists all"):
        find("clock_ofset", built_in())


def test_effects_add_up():
    """Several effects in one model: each at null leaves the others as they are."""
    fit, state = trial_survey()
    names = ["clock_offset", "braking", "moving_load", "shear_lag", "highpass", "common_mode"]
    together = fit.problem.extension([built_in()[name] for name in names])
    values = together.local(together.numbers({"clock_offset": {"offset": 0.3}}))
    path = fit.path.with_effects(together)
    made = path.strain_rate(
        fit.fiber_at(path, state.coefficients, path.described(values)), state.vehicles, state.poisson_ratio, values
    )
    alone = trial("clock_offset")
    expected = alone.map(alone.numbers({"offset": 0.3}))
    torch.testing.assert_close(made, expected, rtol=0, atol=1e-9 * float(expected.abs().max()))


def test_the_mean_that_is_taken_off_is_that_of_the_whole_record():
    """Most of a long record senses no vehicle."""
    fit, state = trial_survey()
    effect = built_in()["common_mode"]
    long = Trial(effect, MapFit(replace(fit.problem, recorded=(0, 3199))), state)
    short = Trial(effect, MapFit(replace(fit.problem, recorded=(0, 319))), state)
    changes = [one.map(one.numbers({"share": 1.0})) - one.base() for one in (short, long)]
    assert changes[0].abs().max() > 0
    torch.testing.assert_close(changes[0], 10 * changes[1])


def test_a_filter_that_delays_does_what_a_late_clock_does():
    """The samples alone are too far apart for that: between them the model is computed too."""

    @effect("late", "interrogator", [Parameter("delay", "s", 0.1)], physics="-", source="-")
    def late(interrogator, p, survey):
        return interrogator.filtered(lambda s: torch.exp(-s * p["delay"]))

    fit, state = trial_survey()
    shifted = trial("clock_offset")
    delayed = Trial(late, fit, state)
    change = delayed.map(delayed.numbers({"delay": 0.07})) - delayed.base()
    wanted = shifted.map(shifted.numbers({"offset": 0.07})) - shifted.base()
    # Nothing is known of a vehicle before its first sample.
    apart = (change - wanted).norm(dim=1) / wanted.norm(dim=1).max()
    assert float(apart.quantile(0.8)) < 0.01


def test_a_load_that_changes_smoothly_keeps_its_rate():
    """As a bounce of the same frequency does, declared with its own rate."""
    smooth, bounce = trial("generic_load"), trial("dynamic_load")
    rows, since = smooth.extension.scopes.rows["track"], smooth.extension.clock(smooth.path.traffic)[1]
    wave = torch.sin(2 * torch.pi * 0.15 * since[:, 0])
    numbers = smooth.numbers()
    numbers[:] = 0.2 * torch.linalg.lstsq(rows, wave[:, None]).solution[:, 0]
    swung = smooth.map(numbers) - smooth.base()
    named = bounce.map(bounce.numbers({"sine": 0.2, "frequency": 0.15})) - bounce.base()
    assert float((swung - named).norm() / named.norm()) < 0.05


def test_brakes_are_held_over_the_stretch_and_come_and_go_smoothly():
    one, (_, state) = trial("braking"), trial_survey()
    shape = {"place": 5.0, "before": 0.0, "length": 30.0, "later": 0.0, "width": 0.6}
    values = one.extension.local(one.numbers({"deceleration": 0.2, **shape}))
    load = one.path.loads(columns(state.vehicles.rows(one.path.traffic)), values)
    driven = load.trajectory
    push = (load.thrust.sum(-2) * driven.heading).sum(-1) / load.share.sum(-1)
    beyond = (driven.position[..., 0] - one.around.middle[0] - 5.0).abs() - 15.0
    held = beyond < 0
    torch.testing.assert_close(push[held], torch.full_like(push[held], 0.2))
    after = beyond[~held] / driven.speed[~held] / 0.6
    torch.testing.assert_close(push[~held], 0.2 * torch.exp(-0.5 * after**2), rtol=0, atol=0.01)


def test_a_clock_that_drifts_is_off_in_the_middle_too():
    drift, offset = trial("clock_drift"), trial("clock_offset")
    steady = drift.map(drift.numbers({"offset": 0.2}))
    torch.testing.assert_close(steady, offset.map(offset.numbers({"offset": 0.2})), rtol=0, atol=0)


@pytest.mark.parametrize("name", ["channel_stretch", "channel_wander"])
def test_gauges_of_stretched_channels_reach_farther(name):
    """Light that counts the channels' distance wrong counts the gauge wrong as well (1027 of the blind trials)."""
    one = trial(name)
    distance, half = one.around.distance, one.around.gauge_length / 2
    middle = (distance.min() + distance.max()) / 2
    shift = 0.02 * (distance - middle)
    amount = {"stretch": torch.tensor(0.02)} if name == "channel_stretch" else {"shift": shift}
    cable = one.effect.change(one.given(), {**amount, "stretched": torch.tensor(1.0)}, one.around)
    for way in (-half, half):
        reached = cable.distance + way * (1 + cable.slack)
        torch.testing.assert_close(reached, middle + 1.02 * (distance + way - middle), check_dtype=False)
