"""Effects hidden by other code than their own are found; what is in no catalogue is called unknown."""

import numpy as np
import pytest
from hidden import diagnosed, posed

from solver.catalogue.catalogue import built_in
from solver.criticism.diagnosis import converged, knots_beside
from solver.criticism.policy import POLICY
from solver.criticism.race import race
from solver.criticism.refit import Refit
from solver.criticism.scorer import Scorer, score_all
from solver.fit.least_squares import solve
from solver.fit.map_fit import MapFit
from solver.fit.refinement import on_knots

IN_TIME = ("generic_time_filter", "generic_delay")
IN_SPACE = ("generic_neighbors", "generic_kernel", "generic_softening")
IN_PLACE = ("generic_track", "generic_shift")
IN_SIZE = ("generic_gain", "generic_road", "generic_nonlinearity")

#: Hidden effect, amounts, and what comes nearest to it in a diagnosis by the whole catalogue.
HIDDEN = {
    "clock_offset": ({"clock_offset": 0.2}, ("track_bias", "time_averaging", "lowpass", "generic_shift", *IN_TIME)),
    "clocks far apart": ({"clock_offset": -0.45}, ("track_bias", "front_share", "clock_drift", "generic_shift")),
    "clock_drift": ({"clock_drift": 0.004}, ("clock_offset", "generic_shift")),
    "braking": (
        {"braking": 0.2, "braking_share": 1.0, "braking_length": 20.0, "braking_at": 0.15},
        ("grade_drag", "generic_road"),
    ),
    "lowpass": ({"lowpass": 1.1}, ("time_averaging", "lowpass_zero_phase", "viscoelastic_lag", *IN_TIME)),
    "shear_lag": ({"shear_lag": 2.4}, ("pulse_width", "gauge_length", "layered_ground", *IN_SPACE)),
    "channel_wander": ({"channel_wander": 0.6}, ("channel_stretch", "slack_spool", "sloping_fiber", *IN_PLACE)),
    "track_bias": ({"track_bias": 2.0}, ("clock_offset", "track_offset", "track_jitter", "generic_delay", *IN_PLACE)),
    "highpass": ({"highpass": 0.1}, ("viscoelastic_lag", "maxwell_flow", "grade_drag", *IN_TIME)),
    "saturation": ({"saturation": 0.5}, ("dynamic_load", "pulse_width", "generic_load", *IN_SIZE)),
    "channel_coupling": ({"channel_coupling": 0.3}, ("stiffness_contrast", "poisson_gradient", *IN_SIZE)),
    "stiffness_contrast": ({"stiffness_contrast": 0.6}, ("channel_coupling", "poisson_gradient", *IN_SIZE)),
    "conduit_slip": ({"conduit_slip": 12.0}, ("channel_coupling", "slack_spool", "shear_lag", "generic_gain")),
    "viscoelastic_lag": ({"viscoelastic_lag": 0.35}, ("highpass", "maxwell_flow", "kelvin_voigt_lag", *IN_TIME)),
    "road_bump": ({"road_bump": 0.35}, ("dynamic_load", "stiffness_contrast", "generic_road", "generic_load")),
    "unseen_vehicle": ({"unseen_vehicle": 0.8}, ("common_mode", "dynamic_load", "generic_load")),
    "cycle_skips": ({"cycle_skips": 0.01}, ("saturation", "common_mode", "generic_nonlinearity")),
}
#: What shows, or is told from what is like it, only in more than two passes.
PASSES = {"track_bias": 4, "clock_drift": 3}


@pytest.mark.parametrize("name", HIDDEN)
def test_a_hidden_effect_is_named_before_what_is_most_like_it(name: str) -> None:
    effects, rivals = HIDDEN[name]
    right = next(iter(effects))
    found = diagnosed(posed(effects, passes=PASSES.get(name, 2)), (right, *rivals))
    first = found.candidates[0]
    assert found.verdict == "missing-effect", found.words
    assert right in {first.effect, *first.confounded_with}, found.words
    assert first.evidence > POLICY.found


@pytest.mark.parametrize(("seed", "idle"), [(11, {"long_vehicle"}), (12, set())])
def test_nothing_hidden_is_adequate_and_says_what_could_have_hidden(seed: int, idle: set[str]) -> None:
    """Where no truck drives, trucks' length is among what could not have shown."""
    found = diagnosed(posed({}, seed=seed, passes=4, end=45.0))
    assert found.verdict == "adequate", found.words
    assert all(c.verdict != "present" for c in found.candidates)
    gauge = next(c for c in found.candidates if c.effect == "gauge_length")
    assert gauge.verdict == "excluded"
    assert 0 < gauge.detectable_size < 0.05
    assert {c.effect for c in found.candidates if c.numbers == 0} == idle
    blind = found.words.split("It could not have shown: ")[1].rstrip(".").split(", ")
    assert set(blind) == {c.effect for c in found.candidates if c.verdict == "inconclusive" and not c.generic}
    assert idle <= set(blind)
    assert all(abs(c.estimate) < 1e6 for c in found.candidates)
    assert found.audit.faults == ()


#: What is in no catalogue, its amount, known effects that explain most of it, and how else it may be told.
UNKNOWN = {
    "unknown_echo": (0.2, ("clock_offset", "time_averaging", "viscoelastic_lag", "generic_echo", *IN_TIME)),
    "unknown_quadratic": (0.4, ("saturation", "dynamic_load", "gauge_length", "generic_load", *IN_SIZE)),
    "unknown_equalized": (0.6, ("saturation", "channel_coupling", "common_mode", "generic_load", *IN_SIZE)),
    "unknown_twin_path": (0.5, ("shear_lag", "gauge_length", "pulse_width", "generic_twin", *IN_SPACE)),
}


@pytest.mark.parametrize("name", UNKNOWN)
def test_what_is_in_no_catalogue_is_called_unknown(name: str) -> None:
    amount, rivals = UNKNOWN[name]
    found = diagnosed(posed({name: amount}, passes=3), rivals)
    assert found.verdict in ("unknown-effect", "inconclusive"), found.words
    assert not any(c.verdict == "present" and not c.generic for c in found.candidates), found.words


PLACED = {
    "unknown_hysteresis": (0.35, "ground", ("viscoelastic_lag", "saturation", "generic_friction", "generic_load")),
    "unknown_wave_packet": (0.15, "ground", ("rayleigh_wave", "moving_load", "generic_wave", "generic_wake")),
    "unknown_exhaustion": (
        0.5,
        "interrogator",
        ("maxwell_flow", "grade_drag", "generic_nonlinearity", "generic_memory"),
    ),
    "unknown_skewed_kernel": (0.4, "interrogator", ("gauge_length", "pulse_width", "channel_stretch", *IN_SPACE)),
}


@pytest.mark.parametrize("name", PLACED)
def test_the_unknown_is_placed_at_its_stage(name: str) -> None:
    """The ground's friction and waves are told from curves and loads, what is fixed to the fiber from vehicles."""
    amount, stage, rivals = PLACED[name]
    found = diagnosed(posed({name: amount}), (*rivals, *IN_TIME))
    assert (found.verdict, found.candidates[0].stage) == ("unknown-effect", stage), found.words


def test_a_vehicle_that_the_camera_missed_hides_no_other_effect() -> None:
    rivals = ("pulse_width", "dynamic_load", "generic_load", *IN_SPACE)
    found = diagnosed(posed({"unseen_vehicle": 0.8, "gauge_length": 0.15}, passes=3), ("gauge_length", *rivals))
    assert found.verdict == "missing-effect", found.words
    present = {c.effect for c in found.candidates if c.verdict == "present"}
    assert present == {"unseen_vehicle", "gauge_length"}, found.words


def test_a_bias_of_all_tracks_is_told_from_chance() -> None:
    rivals = ("clock_offset", "track_offset", "generic_shift", "generic_delay")
    found = diagnosed(posed({"track_bias": 1.0}, passes=8, seed=5, end=45.0), ("track_bias", *rivals))
    first = found.candidates[0]
    assert found.verdict == "missing-effect", found.words
    assert "track_bias" in {first.effect, *first.confounded_with}, found.words


def test_an_effect_is_tried_on_the_knots_that_corners_ask_for_beside_it() -> None:
    """A dent beside a chamber, of a route that begins too stiff, is no coil of slack."""
    fit, state = converged(posed({"highpass": 0.1}, passes=4, seed=5, end=40.0, laid="dent"), None)
    names = ("highpass", "slack_spool")

    def raced(scorer: Scorer) -> dict[str, Refit]:
        return race(scorer, score_all(scorer, [built_in()[name] for name in names]))

    basis = knots_beside(raced(Scorer(fit, state)))
    assert basis is not None and np.isin(fit.basis.breaks, basis.breaks).all()
    bent, begun = on_knots(fit.problem, state, basis)
    found = raced(Scorer(MapFit(bent), solve(MapFit(bent), begun).state))
    assert found["highpass"].evidence > POLICY.found > found["slack_spool"].evidence
