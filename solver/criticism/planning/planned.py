"""A planned survey: what a user writes of it, and the fitting problem that it would be."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import ValidationError

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
from solver.survey.plan_section import MASSES, LaneSection, PlanSection, Positive, Table
from solver.survey.site import FrameSection, GroundSection, first_problem
from solver.trajectory.passes import smooth_passes
from solver.trajectory.vehicle_pass import Pass
from vision.contract import InputError, read_toml

Array = NDArray[np.float64]

GRAVITY = 9.81  # m/s^2
#: s between two vehicles: none is near while another is.
HEADWAY = 20.0
#: m; how far beyond the camera's view a vehicle is followed, as `smooth_passes` does.
BEYOND = 40.0
#: How drivers depart from a steady drive: share of the speed, and period, s; sideways m, and wavelength, m.
SURGE, PERIOD, WEAVE, WAVE = 0.02, 15.0, 0.05, 120.0
#: m between channels where the site does not say it.
SPACING = 1.0
EPOCH = np.datetime64("2000-01-01T00:00:00", "ns")


class PlannedDAS(Table):
    """`[das]` of a planned survey: no file is needed yet; what a record's settings would be may stand there already."""

    gauge_length: Positive
    channel_spacing: Positive = SPACING
    files: Any = None
    quantity: Any = None
    scale: Any = None
    channels: Any = None
    exclude: Any = None
    store: Any = None


class PlannedSite(Table):
    """site.toml of a planned survey; sections that only a survey needs may be there, and are not read."""

    name: str = ""
    das: PlannedDAS
    plan: PlanSection
    ground: GroundSection = GroundSection()
    frame: FrameSection | None = None
    camera: Any = None
    trajectories: Any = None
    anchors: Any = None


def read_planned(source: Path | str | Mapping[str, Any]) -> PlannedSite:
    """Read a planned survey: its site.toml, the folder of one, or the same content as a mapping.

    Raises
    ------
    InputError
        If the file is missing or not TOML, a key is unknown or missing, or a value is out of range.

    >>> lane = {"y": 0.0, "toward": "+x", "vehicles": {"car": 4}}
    >>> plan = {"length": 60.0, "offset": 4.0, "snr_db": 15.0, "lanes": [lane]}
    >>> read_planned({"das": {"gauge_length": 10.0}, "plan": plan}).plan.vehicles
    4
    """
    if isinstance(source, Mapping):
        content, where, name = dict(source), "plan", "plan"
    else:
        path = Path(source)
        path = path / "site.toml" if path.is_dir() else path
        content = read_toml(path, "the path of a site.toml with a table [plan]")
        where, name = str(path), path.resolve().parent.name
    try:
        site = PlannedSite.model_validate(content, context={"folder": Path()})
    except ValidationError as error:
        raise InputError(f"{where}: {first_problem(error)}") from error
    return site if site.name else site.model_copy(update={"name": name})


@dataclass(frozen=True)
class Drive:
    """One vehicle of a plan.

    Parameters
    ----------
    vehicle_class : of `MASSES`
    lane : that it drives in
    speed : m/s
    """

    vehicle_class: str
    lane: LaneSection
    speed: float


def drives(plan: PlanSection) -> list[Drive]:
    """The vehicles of a plan; the speeds of each lane are spread evenly over those that it names.

    >>> lane = LaneSection(y=0.0, toward="+x", vehicles={"car": 2, "bus": 1})
    >>> plan = PlanSection(length=60, offset=4, snr_db=15, speeds=(36, 72), lanes=[lane])
    >>> [(one.vehicle_class, one.speed) for one in drives(plan)]
    [('car', 11.666666666666666), ('bus', 15.0), ('car', 18.333333333333332)]
    """
    found = []
    for lane in plan.lanes:
        # Classes by turns, so that none gets the slow or the fast ones alone.
        left, order = {name: count for name, count in lane.vehicles.items() if count}, []
        while left:
            order += list(left)
            left = {name: count - 1 for name, count in left.items() if count > 1}
        low, high = plan.speeds
        for number, name in enumerate(order):
            share = (number + 0.5) / len(order)
            found.append(Drive(name, lane, (low + share * (high - low)) / 3.6))
    return found


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
        """A vehicle more, by itself, at a speed in m/s: its problem on the same fiber, and the state of that."""
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


def times(plan: PlanSection, made: list[Drive]) -> Iterator[tuple[float, float]]:
    """When each vehicle enters and leaves the camera's view, s."""
    now = 0.0
    for one in made:
        begin = now + HEADWAY + BEYOND / one.speed
        now = begin + (plan.length + BEYOND) / one.speed
        yield begin, begin + plan.length / one.speed


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
    near = [nearby(smoothed[str(number)], route) for number in range(len(made))]
    return [guessed_less(one) for one in near if one is not None]


def fixes(plan: PlanSection, number: int, drive: Drive, when: tuple[float, float]) -> Any:
    """Trajectory table of one drive: nearly steady, as drivers are, with noise as large as the plan says."""
    import pandas as pd

    rng = np.random.default_rng(number)
    time = np.arange(np.ceil(when[0] * plan.frame_rate), np.floor(when[1] * plan.frame_rate) + 1) / plan.frame_rate
    since, phase = time - when[0], rng.uniform(0, 2 * np.pi, 2)
    way = drive.speed * (since + SURGE * PERIOD / (2 * np.pi) * np.sin(2 * np.pi * since / PERIOD + phase[0]))
    x = way if drive.lane.direction > 0 else plan.length - way
    y = drive.lane.y + WEAVE * np.sin(2 * np.pi * x / WAVE + phase[1])
    noise = plan.fix_sigma * rng.normal(size=(2, len(time)))
    stamps = EPOCH + np.round(time * 1e9).astype("timedelta64[ns]")
    columns: dict[str, Any] = {
        "time": pd.DatetimeIndex(stamps, tz="UTC"),
        "track_id": str(number),
        "class": drive.vehicle_class,
    }
    columns |= {"x": x + noise[0], "y": y + noise[1], "sigma_x": plan.fix_sigma, "sigma_y": plan.fix_sigma}
    return pd.DataFrame(columns)


def posed(site: PlannedSite, record: DASRecord, passes: list[Pass], anchors: Any, route: Array) -> Problem:
    """The fitting problem of the planned passes, with unit noise and nothing measured yet."""
    ground, count = site.ground, len(record.channel)
    problem = Problem(
        record=np.zeros((len(record.time), count)),
        noise=torch.ones(count, dtype=torch.float64),
        channel=record.channel,
        recorded=count,
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
