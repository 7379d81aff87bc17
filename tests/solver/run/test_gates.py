"""The checks of a fit, and the sentence that follows from them."""

from dataclasses import asdict, replace

import numpy as np
import pytest

from solver.catalogue.catalogue import built_in
from solver.fit.held_out import HeldOut
from solver.fit.pose import pose
from solver.fit.result import Parameter
from solver.run.floor import Floor, noise_floor
from solver.run.gates import trust_of
from solver.run.strict_json import strict
from solver.run.trust import DIAGNOSE, Gate, Trust
from solver.survey.anchors import Anchor
from solver.survey.das.rounding import Rounding
from solver.trajectory.trajectory_effects import SLOW_ERROR

FLOOR = Floor(value=1.0, samples=50_000, spread=2.0)
SEEN = HeldOut(chi2=50_100.0, freedom=50_000.0, blurred=0.0, blur=0.0)


@pytest.fixture
def trust(survey):
    """Judge the survey's fit, with changes of the result, and of what else is known."""
    size = {"chi2": 50_000.0, "chi2_per_dof": 1.0}

    def judge(problem=survey.problem, floor=FLOOR, held_out=SEEN, disputed=(), **changes):
        return trust_of(replace(survey.result, **size | changes), problem, floor, held_out, disputed)

    return judge


def failed(found) -> list[str]:
    return [gate.name for gate in found.gates if gate.failed]


def with_anchor(survey, aside: float, sigma: float = 0.05):
    x, y, z = survey.result.route[10]
    return replace(survey.problem, anchors=[Anchor("west", 60.0, x, y - aside, z, sigma, sigma)])


def test_a_fit_that_passes_every_check_is_good_and_says_by_which_numbers(trust):
    found = trust()
    assert found.grade == "good"
    assert found.sentence.startswith(
        "No check failed: converged; misfit 1.000 where noise alone leaves 1.000 ± 0.009; "
    )
    assert "1 anchor within 0.0 sigmas" in found.sentence


def test_a_misfit_is_judged_by_its_own_floor(trust):
    """A record whose noise alone would leave .34 was told to be explained down to the noise at .87."""
    assert "misfit" in failed(trust(floor=replace(FLOOR, value=0.34), held_out=None, chi2_per_dof=0.87))
    assert failed(trust(floor=replace(FLOOR, value=1.3), held_out=None, chi2_per_dof=1.3)) == []


@pytest.mark.parametrize(("spread", "names"), [(2.0, ["misfit"]), (50.0, [])])
def test_what_is_chance_follows_from_how_many_samples_are_independent(trust, spread, names):
    assert failed(trust(floor=replace(FLOOR, spread=spread), chi2_per_dof=1.04)) == names


def test_the_alarm_is_false_as_often_as_it_says(trust):
    """Floor and misfit drawn as they scatter: one check in a thousand fails, of 4,000 some 4."""
    rng = np.random.default_rng(1)
    floors, misfits = (1 + rng.normal(size=4000) * (2 / n) ** 0.5 for n in (FLOOR.samples, 50_000))
    alarms = sum(
        misfit > one + 3.09 * replace(FLOOR, value=one).scatter(50_000)
        for one, misfit in zip(floors, misfits, strict=True)
    )
    assert alarms <= 10
    last = int(np.argmax(misfits - floors))
    assert trust(floor=replace(FLOOR, value=floors[last]), chi2_per_dof=misfits[last]).gates[1].scatter < 0.01


def test_held_out_passes_are_judged_by_what_the_others_can_tell(trust):
    assert failed(trust(held_out=replace(SEEN, chi2=56_000.0))) == ["held-out passes"]
    # Two passes that hardly tell the route of two others.
    assert failed(trust(held_out=HeldOut(56_000.0, 50_000.0, 5_000.0, 500.0**2))) == []


def test_what_held_out_passes_show_and_the_fit_does_not_is_what_it_took_up(trust):
    found = trust(chi2_per_dof=1.05, held_out=replace(SEEN, chi2=55_000.0))
    assert found.gates[1].taken_up == pytest.approx(0.5, abs=0.01)


def test_an_anchor_that_the_route_misses_is_named_with_what_to_do(survey, trust):
    found = trust(problem=with_anchor(survey, 0.66))
    assert found.grade == "weak"
    assert "anchor west 0.66 m off the route (13.2 sigmas)" in found.sentence
    # The only one: nothing tells whether it is wrong, or what it is held against.
    assert found.sentence.endswith(
        "check the anchors against what the record's channels count from, and the frame and clock of the tracks."
    )
    x, y, z = survey.result.route[20]
    two = replace(survey.problem, anchors=[*with_anchor(survey, 0.66).anchors, Anchor("b", 70.0, x, y, z, 0.05, 0.05)])
    assert trust(problem=two).sentence.endswith("Next: check the channels and coordinates of the anchors.")
    # Where the model does not explain the record, an anchor is not shown to be wrong.
    assert "see what was read of the record" in trust(problem=two, chi2_per_dof=2.0).sentence


def test_a_route_that_follows_an_anchor_hides_how_far_it_is_off(survey, trust):
    """An error of .16 m at a sigma of .05 may be chance; not where the route took up three quarters of its variance."""
    assert failed(trust(problem=with_anchor(survey, 0.16))) == []
    covariance = np.tile(np.eye(3) * 0.75 * 0.05**2, (61, 1, 1)) * (0.16 / 0.05) ** 2 / 3
    assert failed(trust(problem=with_anchor(survey, 0.16), covariance=covariance)) == ["anchors"]
    # What the tails of the prior add to the corridor was not taken up.
    assert failed(trust(problem=with_anchor(survey, 0.16), covariance=covariance, tails=0.9 * covariance)) == []


def test_a_route_that_follows_an_anchor_all_but_wholly_tells_little_of_the_rest(survey, trust) -> None:
    """An anchor 0.9 sigmas off, whose error the route takes up to 96 %, was told as wrong."""
    covariance = np.tile(np.eye(3) * 0.96 * 0.05**2, (61, 1, 1))
    assert failed(trust(problem=with_anchor(survey, 0.045), covariance=covariance)) == []
    # Covariances have the scale of what anchors miss.
    assert failed(trust(problem=with_anchor(survey, 0.12), covariance=covariance * 2.4**2 / 3)) == ["anchors"]


def test_an_anchor_that_checks_nothing_is_not_counted_as_a_check(survey, trust):
    found = trust(problem=with_anchor(survey, 0.0, sigma=0.3), covariance=np.tile(np.eye(3) * 0.0899, (61, 1, 1)))
    assert found.grade == "fair"
    assert "Not checked: anchors, since the route follows them (100 %)" in found.sentence
    assert "anchors, since there are none" in trust(problem=replace(survey.problem, anchors=[])).sentence


def test_an_anchor_that_was_left_out_is_in_the_first_sentence(trust):
    line = "anchor east is 1.50 m from where the other anchors and the tracks put the fiber; it is left out"
    found = trust(disputed=[line])
    assert failed(found) == ["anchors"] and line.split("; ")[0] in found.sentence


def test_tracks_are_judged_by_what_they_may_be_off(survey, trust):
    shifted = {f"across[{one.track_id}]": Parameter(0.37, 0.02, "m", True) for one in survey.passes}
    found = trust(parameters=survey.result.parameters | shifted)
    assert failed(found) == ["tracks sideways"]
    assert "tracks shifted 0.37 m sideways (rms) where 0.07 m is expected" in found.sentence
    loose = replace(survey.problem, passes=[replace(one, offset=0.4) for one in survey.problem.passes])
    assert failed(trust(problem=loose, parameters=survey.result.parameters | shifted)) == []


@pytest.mark.parametrize(("shape", "first"), [(np.abs, "roadfiber clock"), (np.sign, "check the anchors against")])
def test_what_shifts_all_tracks_is_named_in_the_order_in_which_it_fits(survey, trust, shape, first) -> None:
    """Two passes, one either way: late by as many seconds, or as many meters farther along the road."""
    shifted = {f"along[{one.track_id}]": Parameter(3 * shape(one.speed), 0.02, "m", True) for one in survey.passes}
    found = trust(problem=with_anchor(survey, 0.0), parameters=survey.result.parameters | shifted)
    assert (
        failed(found) == ["tracks along travel"] and first in found.sentence.partition("Next: ")[2].partition("; ")[0]
    )


def test_tracks_that_wander_and_ground_that_is_unlike_the_prior_fail(survey, trust) -> None:
    """Wander of 3 m where .9 is expected, and a ratio of .397 where .25 is, passed every check."""
    problem = replace(survey.problem, effects=(SLOW_ERROR,), prior=replace(survey.problem.prior, jitter=1.3))

    def judged(wander: float, ratio: float):
        slow = {f"track_jitter.along[{i}]": Parameter(wander * (-1) ** i, 0.1, "m", True) for i in range(20)}
        ground = {"poisson_ratio": Parameter(ratio, 0.01, "1", True)}
        return trust(problem=problem, parameters=survey.result.parameters | slow | ground)

    assert failed(judged(1.0, 0.3)) == []
    found = judged(4.33, 0.397)
    assert failed(found) == ["tracks' slow errors", "ground"]
    assert "tracks wander by 3.00 m (rms) where 0.90 m is expected" in found.sentence
    assert "Poisson's ratio 0.397 where 0.25 ± 0.03 is expected" in found.sentence


def test_a_camera_that_puts_all_tracks_off_by_more_than_they_say_is_named(survey, trust) -> None:
    problem = replace(survey.problem, prior=replace(survey.problem.prior, effect_sd={"track_rotation.angle": 0.2}))

    def judged(angle: float):
        turned = {"track_rotation.angle": Parameter(angle, 0.1, "degree", True)}
        return trust(problem=problem, parameters=survey.result.parameters | turned)

    assert failed(judged(0.5)) == [] and "all tracks off alike by 2.5 sigmas at most." in judged(0.5).sentence
    assert failed(found := judged(1.2)) == ["tracks together"]
    assert "all tracks off alike by 6.0 sigmas at most (turned tracks, angle: 1.2 degree)" in found.sentence


def test_what_did_not_converge_is_poor_whatever_its_misfit(trust):
    found = trust(converged=False)
    assert (found.grade, failed(found)) == ("poor", ["converged"])
    assert trust(chi2_per_dof=4.0).grade == trust(chi2_per_dof=float("nan")).grade == "poor"


def test_an_open_side_and_a_discrepancy_model_fail(survey, trust):
    assert failed(trust(ambiguous_side=True)) == ["side of the road"]
    name, generic = next((name, one) for name, one in built_in().items() if one.generic)
    found = trust(problem=replace(survey.problem, effects=(generic,)))
    assert failed(found) == ["named effects"] and f"{name} is a discrepancy model" in found.sentence


def test_without_quiet_samples_no_misfit_is_judged(trust):
    found = trust(floor=None)
    assert found.grade == "fair"
    assert "too few samples without a vehicle near" in found.sentence


def test_floor_and_its_scatter_are_measured_on_quiet_samples(survey):
    floor = noise_floor(survey.problem)
    assert floor is not None
    assert floor.value == pytest.approx(1.0, abs=0.03)
    assert 1.5 < floor.spread < 4.0
    # Every sample twice over: as many, but half as many that tell something.
    twice = replace(survey.problem, record=np.repeat(survey.problem.record, 2, axis=0)[: len(survey.problem.record)])
    assert noise_floor(twice).spread > 1.3 * floor.spread


@pytest.mark.parametrize("steps", [1.0, 4.0, 6.0])
def test_the_floor_of_a_rounded_record_has_the_errors_that_rounding_leaves_beside_vehicles(survey, steps):
    """Quiet below half a step is rounded to zero: it leaves less than what is fitted."""
    problem, step = survey.problem, steps * 2e-8
    coarse, of_all = step * np.rint(problem.record / step), Rounding(np.full(len(problem.channel), step), np.ones(1))
    record = replace(survey.record, strain_rate=coarse, channel=problem.channel, distance=problem.distance)
    given = problem.passes, problem.anchors, problem.start, problem.channel, problem.prior
    posed = pose(replace(record, rounding=of_all), *given)
    floor = noise_floor(posed)
    assert floor.value == pytest.approx(1.0, abs=0.06)
    assert floor.bound


def test_a_floor_of_rounded_noise_is_said_to_be_an_upper_bound(survey, trust):
    assert not noise_floor(survey.problem).bound
    assert (
        "misfit 1.000 where noise alone leaves at most 1.000 ± 0.009"
        in trust(floor=replace(FLOOR, bound=True)).sentence
    )


def test_a_check_of_a_part_of_the_fiber_leaves_the_rest_as_it_is() -> None:
    fine, bend = (
        Gate("misfit", "passed", "misfit 1.0"),
        Gate("places", "failed", "a bend", ("look",), where="at channel 7"),
    )
    told = Trust.of([fine, bend])
    assert told.grade == "fair"
    assert told.sentence == (
        "Do not rely on this route at channel 7: a bend. Next: look. Elsewhere no check failed: misfit 1.0."
    )
    both = Trust.of([replace(fine, verdict="failed"), bend])
    assert both.grade != "fair" and both.sentence.startswith(
        "Do not rely on this route as it stands: misfit 1.0; a bend"
    )
    assert Trust.stored(strict(asdict(told))).sentence == told.sentence


def test_who_has_diagnosed_is_not_told_to_diagnose() -> None:
    gates = [Gate("misfit", "failed", "misfit 2", (DIAGNOSE,)), Gate("diagnosis", "open", "what it may lack")]
    assert DIAGNOSE not in Trust.of(gates).sentence and DIAGNOSE in Trust.of(gates[:1]).sentence
