"""Which channels are fitted, and which ends are left out."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from solver.fit.map_fit import MapFit
from solver.fit.pose import bent_ends, pose, with_common_errors, with_slow_errors
from solver.fit.problem import Problem
from solver.fit.result import FitResult
from solver.fit.spline import fit_spline
from solver.signal_path.traffic import Traffic
from solver.simulator import Scenario, simulate
from solver.start.rough_route import silent
from solver.survey.anchors import Anchor
from solver.survey.das import DASRecord
from solver.survey.dead_channels import dead_channels
from solver.trajectory.vehicle_pass import track_sigma
from tests.solver.simulated import case_of
from vision.contract import InputError

GAUGE, COUNT = 10, 60
#: Samples at which a vehicle is near.
NEAR = slice(0, 40)


@pytest.fixture
def straight(survey) -> FitResult:
    """A straight route of 60 channels that explains its data down to the noise."""
    channel = np.arange(COUNT)
    noise = np.random.default_rng(0).normal(size=(200, COUNT))
    return replace(
        survey.result,
        channel=channel,
        fitted_channel=channel,
        route=np.column_stack([channel * 1.0, np.full(COUNT, 4.0), np.full(COUNT, 0.9)]),
        measured=noise,
        model=np.zeros_like(noise),
        noise=np.ones(COUNT),
        weight=np.ones_like(noise),
    )


def turned(result: FitResult) -> FitResult:
    """The last seven channels turn off by 45 degrees."""
    route = result.route.copy()
    route[-7:, 1] += np.arange(1, 8)
    return replace(result, route=route)


def failing(result: FitResult) -> FitResult:
    """The model misses the last ten channels while a vehicle is near: too little to show over all samples."""
    measured = result.measured.copy()
    measured[NEAR, -10:] *= 1.3
    return replace(result, measured=measured)


def kept(result: FitResult, gauge: int = GAUGE) -> slice:
    """Channels that are kept of a record with one vehicle, which is near all channels at some samples."""
    place = np.tile([COUNT / 2, 0.0], (200, 1))
    place[NEAR.stop :] += 1e3
    one = SimpleNamespace(position=place, rows=np.arange(200))
    problem: Any = SimpleNamespace(record=result.measured, passes=[one], gauge_length=float(gauge))
    return bent_ends(replace(result, samples=np.arange(200)), problem, gauge)


def test_a_straight_route_keeps_all_channels(straight: FitResult) -> None:
    assert kept(straight) == slice(0, COUNT)


def test_an_end_that_turns_and_fails_where_vehicles_are_is_left_out(straight: FitResult) -> None:
    assert kept(failing(turned(straight))) == slice(0, COUNT - GAUGE)


def test_neither_a_turn_nor_a_misfit_alone_is_a_bend(straight: FitResult) -> None:
    assert kept(turned(straight)) == slice(0, COUNT)
    assert kept(failing(straight)) == slice(0, COUNT)


def test_a_fiber_of_two_gauge_lengths_is_not_shortened(straight: FitResult) -> None:
    assert kept(failing(turned(straight)), COUNT // 2) == slice(0, COUNT)


def uncertain(problem, sigma: float):
    """The problem with tracks of that sigma, m."""
    passes = [replace(one, sigma=np.full_like(one.sigma, sigma)) for one in problem.passes]
    return replace(problem, passes=passes, traffic=Traffic.of(passes, problem.traffic.samples))


def test_slow_errors_of_tracks_are_fitted_where_these_are_uncertain(case) -> None:
    sure, unsure = uncertain(case.problem, 0.02), uncertain(case.problem, 0.2)
    assert track_sigma(unsure.passes) == pytest.approx(0.2)
    assert with_slow_errors(sure) is sure
    more = with_slow_errors(unsure)
    assert [one.name for one in more.effects] == ["track_jitter"]
    assert with_slow_errors(more) is more
    fit = MapFit(more)
    slow = fit.sd[len(fit.sd) - fit.extension.size :]
    # The spline that the coefficients make has the tracks' own sigma, and none of it is counted as noise again.
    spread = fit.extension.scopes.rows["track"] ** 2 @ slow[: fit.extension.size // 2] ** 2
    assert float(spread.median()) == pytest.approx(0.04, rel=0.1)
    state = fit.start()
    local = fit.path.sensitivities(
        fit.fiber(state, fit.values(state)), state.vehicles, state.poisson_ratio, fit.values(state)
    )
    assert float(fit.track_variance(local).max()) < 1e-9
    assert float(MapFit(unsure).track_variance(local).max()) > 1


def record_of(problem: Problem) -> DASRecord:
    """The record of a problem."""
    return DASRecord(
        strain_rate=problem.record,
        time=np.arange(len(problem.record)) / problem.sampling_rate,
        start=np.datetime64(0, "ns"),
        distance=problem.distance,
        channel=problem.channel,
        gauge_length=problem.gauge_length,
        channel_spacing=problem.channel_spacing,
        sampling_rate=problem.sampling_rate,
        gaps=(),
        provenance={},
    )


def test_a_few_channels_are_not_a_route(case) -> None:
    """The spline of the start was singular: a traceback."""
    problem, few = case.problem, slice(40, 43)
    with pytest.raises(InputError, match="in 3 channels only, too few for a route"):
        pose(record_of(problem), problem.passes, [], problem.start[few], problem.channel[few], problem.prior)


def test_no_vehicle_near_the_channels_is_said(case) -> None:
    problem = case.problem
    away = [replace(one, position=one.position + 400.0) for one in problem.passes]
    record = record_of(problem)
    with pytest.raises(InputError, match=r"no vehicle comes within 25 m of channels .* check the frame"):
        pose(record, away, [], problem.start, problem.channel, problem.prior)


def test_a_gap_is_not_channels_that_record_nothing(survey) -> None:
    """In a gap of 10 min amid 3 of record, every channel "recorded nothing", and half of them were left out."""
    strain_rate = np.full((2000, survey.record.strain_rate.shape[1]), np.nan)
    strain_rate[:300], strain_rate[-100:] = survey.record.strain_rate[:300], survey.record.strain_rate[300:]
    record = replace(survey.record, strain_rate=strain_rate, time=np.arange(2000) / 5)
    fitted = survey.result.fitted_channel
    assert silent(record, fitted[[0, -1]]) == silent(survey.record, fitted[[0, -1]])
    assert "one value most of the time on channel 70;" in str(silent(record, fitted[[0, -1]]))
    assert not len(dead_channels(record, fitted))


def test_the_record_is_not_copied_and_what_is_fitted_of_it_is_in_double_precision(survey):
    problem = survey.problem
    single = problem.record.astype(np.float32)
    record = replace(survey.record, strain_rate=single, channel=problem.channel, distance=problem.distance)
    given = problem.passes, problem.anchors, problem.start, problem.channel, problem.prior
    posed, double = pose(record, *given), pose(replace(record, strain_rate=single.astype(float)), *given)
    assert np.shares_memory(posed.record, single)
    assert posed.strain_rate.dtype == double.strain_rate.dtype == torch.float64
    assert torch.equal(posed.strain_rate.nan_to_num(), double.strain_rate.nan_to_num())
    assert np.allclose(posed.law.own, double.law.own, rtol=1e-5)


def test_the_route_has_no_channel_that_the_record_lacks(survey) -> None:
    """Half a gauge beyond the last fitted channel route.csv had one more, unless an anchor is out there."""
    problem = replace(survey.problem, recorded=(52, 107), anchors=[])
    assert problem.route_channel[[0, -1]].tolist() == [52, 107] != survey.problem.route_channel[[0, -1]].tolist()
    out = replace(problem, anchors=[Anchor("a", 115, 60.0, 4.0, 0.9, 0.05, 0.05)])
    assert out.route_channel[[0, -1]].tolist() == [52, 115]


def test_what_a_camera_puts_off_alike_is_told_from_anchors() -> None:
    """Tracks that are all turned by 1.15 degrees took the route along, against two anchors."""
    turned = Scenario(seed=3, passes=4, snr_db=15.0, view=(0.0, 40.0), channels=101, effects={"track_rotation": 1.15})
    case = case_of(simulate(turned))
    # A camera's tracks say that they may be off by so much.
    unsure = [replace(one, sigma=np.full_like(one.sigma, 0.3)) for one in case.problem.passes]
    filmed = replace(with_common_errors(replace(case.problem, passes=unsure)), passes=case.problem.passes)

    def off(result: FitResult) -> float:
        seen = np.isin(result.channel, case.problem.channel)
        return float(np.linalg.norm((result.route[seen] - case.truth)[:, :2], axis=1).max())

    found = fit_spline(filmed)
    assert off(found) < 0.15 < 0.3 < off(fit_spline(case.problem))
    angle = found.parameters["track_rotation.angle"]
    assert abs(angle.value - 1.15) < 3 * angle.sigma < 0.6
