"""A tiny made survey that every effect is tried on before it is used: all vehicle classes, both ways, a bent fiber."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np
import torch
from torch import Tensor

from solver.cable.cable import Cable
from solver.cable.fiber import Fiber
from solver.effect import Effect, Surroundings
from solver.fit.map_fit import MapFit
from solver.fit.prior import Prior
from solver.fit.problem import Problem
from solver.fit.state import State
from solver.signal_path.derivatives import derivative
from solver.signal_path.extension import Extension, Values
from solver.signal_path.local import Local, Seen
from solver.signal_path.traffic import Traffic, columns
from solver.trajectory.vehicle_pass import Pass

CHANNELS, SPACING, RATE = 24, 3.0, 2.5
CLASSES = ("vehicle", "car", "van", "truck", "bus")


def drive(number: int, vehicle_class: str) -> Pass:
    """A vehicle that sways a little, every other one against x, each faster than the one before."""
    way, speed = (-1) ** number, 9.0 + 2.5 * number
    half = int(np.ceil(40 / speed * RATE))
    time = np.arange(-half, half + 1) / RATE
    y = (0.0 if way > 0 else -3.5) + 0.2 * np.sin(time)
    return Pass(
        str(number),
        vehicle_class,
        np.arange(len(time)) + 12 * number,
        np.column_stack([way * speed * time, y]),
        np.column_stack([np.full(len(time), way * speed), 0.2 * np.cos(time)]),
        np.full((len(time), 2), 0.05),
        np.ones(len(time), bool),
    )


@cache
def trial_survey() -> tuple[MapFit, State]:
    """One vehicle of each class beside a fiber on an arc; the fit is not run."""
    passes = [drive(number, name) for number, name in enumerate(CLASSES)]
    channel = np.arange(CHANNELS)
    x = (channel - channel.mean()) * SPACING
    start = np.column_stack([x, 4.0 + x**2 / 400, 0.9 + 0.01 * x])
    samples = max(int(one.rows[-1]) for one in passes) + 1
    problem = Problem(
        record=np.zeros((samples, CHANNELS)),
        noise=torch.ones(CHANNELS, dtype=torch.float64),
        channel=channel,
        recorded=(0, CHANNELS - 1),
        zero_distance=0.0,
        channel_spacing=SPACING,
        gauge_length=10.0,
        passes=passes,
        traffic=Traffic.of(passes),
        anchors=[],
        start=start,
        prior=Prior(),
        sampling_rate=RATE,
        curved=False,
    )
    fit = MapFit(problem)
    state = fit.start()
    vehicles = replace(state.vehicles, amplitude=torch.tensor([1.0, 0.8, 1.5, 3.0, 4.0], dtype=torch.float64))
    state = replace(state, vehicles=vehicles)
    # Effects that clip ask how large the record is.
    record = np.zeros_like(problem.record)
    record[problem.traffic.samples] = fit.model(state).numpy()
    return MapFit(replace(problem, record=record)), state


class Trial:
    """One effect in the trial survey.

    Parameters
    ----------
    effect : alone in the model
    fit, state : the survey, see `trial_survey`
    """

    def __init__(self, effect: Effect, fit: MapFit, state: State):
        self.effect, self.fit, self.state = effect, fit, state
        self.extension: Extension = fit.problem.extension([effect])
        self.path = fit.path.with_effects(self.extension)

    def numbers(self, values: Mapping[str, float] | None = None) -> Tensor:
        """All parameters' numbers [number]: at their null, shapes amid their grid, or at `values`."""
        return self.extension.numbers({self.effect.name: dict(values or {})})

    @property
    def around(self) -> Surroundings:
        """What the effect may ask."""
        assert self.extension.surroundings is not None
        return self.extension.surroundings

    def given(self) -> Any:
        """The effect's stage as the base model has it."""
        base, stage = self.fit.path, self.effect.stage
        if stage in ("trajectory", "load"):
            vehicles = columns(self.state.vehicles.rows(base.traffic))
            return base.trajectory(vehicles, {}) if stage == "trajectory" else base.loads(vehicles, {})
        described = base.described({})
        return Cable(self.around.distance) if stage == "cable" else getattr(described, stage)

    def fiber(self, values: Values) -> Fiber:
        """The gauges' ends."""
        return self.fit.fiber_at(self.path, self.state.coefficients, self.path.described(values))

    def map(self, numbers: Tensor) -> Tensor:
        """Strain rate [sample, channel], 1/s, with the effect."""
        values, state = self.extension.local(numbers), self.state
        return self.path.strain_rate(self.fiber(values), state.vehicles, state.poisson_ratio, values)

    def base(self) -> Tensor:
        """Strain rate [sample, channel], 1/s, without it."""
        return self.fit.model(self.state)

    def seen(self, numbers: Tensor) -> Seen:
        """The model with the effect, for derivatives."""
        values, state = self.extension.local(numbers), self.state
        gauges = partial(self.fit.gauges_at, self.path, state.coefficients)
        local = Local(self.path, gauges, state.vehicles.rows(self.path.traffic), state.poisson_ratio, values)
        return Seen(self.path, gauges, local)

    def derivatives(self, numbers: Tensor) -> dict[str, Tensor]:
        """Parameter with a null -> derivative [number, sample, channel] of the map."""
        seen = self.seen(numbers)
        slots = (slot for slot in self.extension.slots if not slot.parameter.is_shape)
        return {slot.parameter.name: derivative(seen, slot, numbers) for slot in slots}
