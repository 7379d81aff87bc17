"""A planned survey as the fitting problem that it would be."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from solver.criticism.planning.planned_drives import BEYOND, EPOCH, HEADWAY, Drive, drives, fixes, times
from solver.criticism.planning.planned_site import PlannedSite
from solver.fit.map_fit import MapFit
from solver.fit.pose import guessed_less, with_slow_errors
from solver.fit.prior import Prior
from solver.fit.problem import Problem
from solver.fit.state import State
from solver.fit.stretches import TAIL, around, nearby
from solver.signal_path.traffic import Traffic
from solver.survey.anchors import Anchor
from solver.survey.das.lowpass import FIT_RATE
from solver.survey.das.record import DASRecord
from solver.survey.limits import vehicle_reach
from solver.survey.plan_section import MASSES, LaneSection, PlanSection
from solver.trajectory.passes import smooth_passes
from solver.trajectory.vehicle_pass import Pass

Array = NDArray[np.float64]

GRAVITY = 9.81  # m/s^2


@dataclass(frozen=True)
class Planned:
    """A planned survey, ready for the linear algebra of a fit.

    Parameters
    ----------
    site : as described
    record : of the right extent, without samples that count
    drives : vehicle by vehicle, in the order of time
    problem : that the fit would be given; its record is what the model says
    state : where the fit would end: the expected route and vehicles
    noise : standard deviation of a sample, 1/s
    """

    site: PlannedSite
    record: DASRecord
    drives: list[Drive]
    problem: Problem
    state: State
    noise: float

    @classmethod
    def of(cls, site: PlannedSite) -> "Planned":
        """The planned survey of a site."""
        plan, made = site.plan, drives(site.plan)
        record = empty_record(site, made)
        route = expected_route(site, record.distance)
        passes = driven(plan, made, record, route)
        anchors = [planned_anchor(site, x, f"anchor at x = {x:g} m") for x in plan.anchors]
        problem = posed(site, record, passes, anchors, route)
        fit = MapFit(problem)
        state = loaded(site, fit, made)
        signal = fit.model(state)
        noise = plan.noise or noise_of(plan, problem, signal)
        problem = replace(problem, noise=torch.full_like(problem.noise, noise), record=heard(problem, signal))
        return cls(site, record, made, problem, state, noise)

    def alone(self, vehicle_class: str, lane: LaneSection, speed: float) -> tuple[Problem, State]:
        """One more vehicle by itself, at a speed in m/s: its problem on the same fiber, and where its fit would end."""
        drive = Drive(vehicle_class, lane, speed)
        record = empty_record(self.site, [drive])
        route = expected_route(self.site, record.distance)
        passes = driven(self.site.plan, [drive], record, route)
        problem = replace(posed(self.site, record, passes, (), route), noise=self.problem.noise)
        problem = replace(problem, effects=self.problem.effects, prior=self.problem.prior)
        fit = MapFit(problem, basis=self.problem.basis)
        state = loaded(self.site, fit, [drive])
        return replace(problem, record=heard(problem, fit.model(state))), state


def empty_record(site: PlannedSite, made: list[Drive]) -> DASRecord:
    """A record of the right extent: channels over the length, and time for every vehicle to come and go by."""
    plan, spacing = site.plan, site.das.channel_spacing
    rate = min(plan.sampling_rate, FIT_RATE)
    count = int(np.floor(plan.length / spacing)) + 1
    ends = [end for _, end in times(plan, made)]
    rows = int(np.ceil((ends[-1] + HEADWAY) * rate)) + 1
    return DASRecord(
        strain_rate=np.broadcast_to(np.zeros(1), (rows, count)),
        time=np.arange(rows) / rate,
        start=EPOCH,
        distance=spacing * np.arange(count, dtype=np.float64),
        channel=np.arange(count),
        gauge_length=site.das.gauge_length,
        channel_spacing=spacing,
        sampling_rate=rate,
        gaps=(),
        provenance={"files": [], "sha256": []},
    )


def expected_route(site: PlannedSite, distance: Array) -> Array:
    """The expected route [channel, 3], m: straight, at the offset and at the mean depth."""
    return np.column_stack([distance, np.full(len(distance), site.plan.offset), np.full(len(distance), depth_of(site))])


def depth_of(site: PlannedSite) -> float:
    """Expected depth, m."""
    return site.ground.depth[0]


def planned_anchor(site: PlannedSite, x: float, name: str) -> Anchor:
    """An anchor on the expected route at x, m."""
    sigma = site.plan.anchor_sigma
    return Anchor(name, x / site.das.channel_spacing, x, site.plan.offset, depth_of(site), sigma, sigma)


def driven(plan: PlanSection, made: list[Drive], record: DASRecord, route: Array) -> list[Pass]:
    """The passes as the smoother would give them, near the fiber, in the order of the drives."""
    import pandas as pd

    both = enumerate(zip(made, times(plan, made), strict=True))
    table = pd.concat([fixes(plan, number, *one) for number, one in both])
    smoothed = {one.track_id: one for one in smooth_passes(table, record, reach=BEYOND)}
    near = [nearby(smoothed[str(number)], route, vehicle_reach(record.gauge_length)) for number in range(len(made))]
    return [guessed_less(one) for one in near if one is not None]


def posed(site: PlannedSite, record: DASRecord, passes: list[Pass], anchors: Any, route: Array) -> Problem:
    """The fitting problem of the planned passes, with unit noise and nothing measured yet."""
    ground, count = site.ground, len(record.channel)
    problem = Problem(
        record=np.zeros((len(record.time), count)),
        noise=torch.ones(count, dtype=torch.float64),
        channel=record.channel,
        recorded=(int(record.channel[0]), int(record.channel[-1])),
        zero_distance=0.0,
        channel_spacing=record.channel_spacing,
        gauge_length=record.gauge_length,
        passes=passes,
        traffic=Traffic.of(passes, around(passes, len(record.time), round(TAIL * record.sampling_rate))),
        anchors=anchors,
        start=route,
        prior=Prior(depth=ground.depth, poisson_ratio=(ground.poisson_ratio, Prior.poisson_ratio[1])),
        sampling_rate=record.sampling_rate,
    )
    return with_slow_errors(problem)


def loaded(site: PlannedSite, fit: MapFit, made: list[Drive]) -> State:
    """The expected route under vehicles as heavy as their classes are."""
    plan = site.plan
    state = fit.start()
    push = GRAVITY / (4 * np.pi * plan.shear_modulus)
    amplitude = torch.tensor([push * MASSES[one.vehicle_class] for one in made], dtype=torch.float64)
    return replace(state, vehicles=replace(state.vehicles, amplitude=amplitude))


def heard(problem: Problem, signal: torch.Tensor) -> Array:
    """The record [row, channel] without noise."""
    record = np.zeros_like(problem.record)
    record[problem.traffic.samples] = signal.numpy()
    return record


def noise_of(plan: PlanSection, problem: Problem, signal: torch.Tensor) -> float:
    """Noise, 1/s, at which the maps of all passes, while each is in view, have the SNR of the plan."""
    rows = np.concatenate([one.rows[one.in_view] for one in problem.passes])
    where = np.searchsorted(problem.traffic.samples, rows)
    power = float((signal[where] ** 2).mean())
    return float(np.sqrt(power / 10 ** (float(plan.snr_db or 0.0) / 10)))
