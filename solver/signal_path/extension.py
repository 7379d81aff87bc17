"""Effects in the model: their parameters as one vector, and the stages they change."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from solver.cable.cable import Cable
from solver.cable.fiber import SplineBasis, between_channels
from solver.effect import BY_ROW, Effect, Parameter, Surroundings
from solver.ground.ground import Ground
from solver.interrogator.interrogator import Interrogator
from solver.load.load import Load
from solver.processing.processing import Processing
from solver.signal_path.observation import BASE, Description
from solver.signal_path.traffic import Traffic
from solver.trajectory.trajectory import Trajectory

#: Effect -> parameter -> value, local to rows and channels.
Values = Mapping[str, Mapping[str, Tensor]]

#: Knot spacing of splines along fiber and road, m (half a usual gauge length), and in time, s.
SMOOTH, SMOOTH_TIME = 5.0, 2.0
#: The same of what changes along a track, s: a camera's slow errors last for a second or longer.
SMOOTH_TRACK = 1.0
#: The same along the road for what shifts tracks, m: a camera's map bends more slowly than a road is uneven.
SMOOTH_BEND = 10.0
#: What an effect's function takes and returns.
STAGE_VALUES: dict[str, type] = {
    "trajectory": Trajectory,
    "load": Load,
    "ground": Ground,
    "cable": Cable,
    "interrogator": Interrogator,
    "processing": Processing,
}


#: The road's splines, which go on straight beyond it.
STRAIGHT_ON = "road, straight on"


@dataclass(frozen=True)
class Scopes:
    """Spline weights that spread the numbers of each scope over rows and channels.

    Parameters
    ----------
    rows, rates : scope -> [row, number], and its time derivative, 1/s
    fiber : [channel, number]
    samples : [sample, number]
    tracks : how many numbers each track has
    """

    rows: Mapping[str, Tensor]
    rates: Mapping[str, Tensor]
    fiber: Tensor
    samples: Tensor
    tracks: tuple[int, ...]

    @classmethod
    def of(
        cls, traffic: Traffic, distance: Tensor, since: Tensor, sampled: Tensor, road: tuple[float, float]
    ) -> "Scopes":
        """Scopes of a survey's traffic, computed channels and times `sampled`, s; the fiber is along `road` in x, m."""
        one_hot = torch.nn.functional.one_hot(traffic.pass_index, traffic.passes).double()
        x, time = traffic.position[:, 0].numpy(), since[:, 0].numpy()
        inside = np.clip(x, *road)
        (at, slope), (bend, turn) = (
            [torch.from_numpy(_smooth(*road, spacing).at(inside, order)) for order in (0, 1)]
            for spacing in (SMOOTH, SMOOTH_BEND)
        )
        speed, beyond = traffic.velocity[:, :1], torch.from_numpy(x - inside)[:, None]
        tracks, faster = list[Tensor](), list[Tensor]()
        for number in range(traffic.passes):
            mine = traffic.pass_index == number
            basis = _smooth(0.0, float(time[mine.numpy()].max(initial=0.0)), SMOOTH_TRACK)
            tracks.append(torch.from_numpy(basis.at(time)) * mine[:, None])
            faster.append(torch.from_numpy(basis.at(time, 1)) * mine[:, None])
        rows = {"pass": one_hot, "road": at, STRAIGHT_ON: bend + beyond * turn, "track": torch.cat(tracks, 1)}
        rates = {"road": speed * (beyond == 0) * slope, STRAIGHT_ON: speed * turn, "track": torch.cat(faster, 1)}
        swings = _spread(sampled, SMOOTH_TIME)
        counts = tuple(one.shape[1] for one in tracks)
        return cls(rows, rates, _spread(distance, SMOOTH), swings[:, swings.any(0)], counts)

    def count(self, scope: str) -> int:
        """Count of numbers of a parameter of that scope."""
        return 1 if scope == "one" else self.along(scope).shape[1]

    def along(self, scope: str) -> Tensor:
        """Spline weights of a scope, [channel or sample or row, number]."""
        return {"fiber": self.fiber, "time": self.samples, **self.rows}[scope]

    def local(self, scope: str, numbers: Tensor) -> Tensor:
        """Local values of one parameter: [] ("one"), [channel] ("fiber"), [sample, 1] ("time") or [row, 1]."""
        if scope == "one":
            return numbers.reshape(())
        value = self.along(scope) @ numbers
        return value if scope == "fiber" else value[:, None]


def _smooth(start: float, stop: float, spacing: float) -> SplineBasis:
    """Splines over a stretch of at least one interval."""
    return SplineBasis.even(start, max(stop, start + spacing), spacing)


def _spread(at: Tensor, spacing: float) -> Tensor:
    """Matrix [point, number] of the splines at all points."""
    return torch.from_numpy(_smooth(float(at.min()), float(at.max()), spacing).at(at.numpy()))


@dataclass(frozen=True)
class Slot:
    """Place of a parameter's numbers in the vector of all parameters."""

    effect: Effect
    parameter: Parameter
    where: slice

    @property
    def spread(self) -> str:
        """Scope by whose splines its numbers are spread."""
        return spread_of(self.effect, self.parameter)


def spread_of(effect: Effect, parameter: Parameter) -> str:
    """Scope by whose splines the numbers of an effect's parameter are spread.

    What tracks are off by along the road goes on straight beyond it, as tracks do where nobody saw the vehicle.
    """
    straight_on = parameter.scope == "road" and effect.stage == "trajectory"
    return STRAIGHT_ON if straight_on else parameter.scope


def spacing_of(effect: Effect, parameter: Parameter) -> float | None:
    """How far apart the numbers of an effect's parameter are along fiber or road, m, or a track, s; None of others.

    >>> from solver.catalogue.catalogue import built_in
    >>> effects = [built_in()[name] for name in ("channel_coupling", "track_bend", "track_jitter", "clock_offset")]
    >>> [spacing_of(one, one.parameters[0]) for one in effects]
    [5.0, 10.0, 1.0, None]
    """
    spacing = {"fiber": SMOOTH, "road": SMOOTH, STRAIGHT_ON: SMOOTH_BEND, "track": SMOOTH_TRACK}
    return spacing.get(spread_of(effect, parameter))


@dataclass(frozen=True)
class Extension:
    """Effects beyond the base model in one survey.

    Parameters
    ----------
    effects : in the model
    surroundings : what effects may ask of the survey; None without effects
    scopes : spline weights of their parameters
    chosen : which of the computed channels were measured: [channel], or a stretch of them; all where None
    time : [row], s since the record's start, of the traffic's rows
    traffic : sampled finer than the record, if filters in time need it; None: unchanged
    """

    effects: Sequence[Effect] = ()
    surroundings: Surroundings | None = None
    scopes: Scopes | None = None
    chosen: Tensor | slice | None = None
    time: Tensor | None = None
    traffic: Traffic | None = None
    slots: tuple[Slot, ...] = field(init=False)

    def __post_init__(self) -> None:
        slots, first = [], 0
        for one in self.effects:
            for parameter in one.parameters:
                assert self.scopes is not None
                count = self.scopes.count(spread_of(one, parameter))
                slots.append(Slot(one, parameter, slice(first, first + count)))
                first += count
        object.__setattr__(self, "slots", tuple(slots))

    @property
    def size(self) -> int:
        """Count of numbers of all parameters."""
        return self.slots[-1].where.stop if self.slots else 0

    def numbers(self, value: Mapping[str, Mapping[str, float]] | None = None) -> Tensor:
        """Vector [number] of all parameters: at their null (a shape in the middle of its grid), or at `value`."""
        out = torch.zeros(self.size, dtype=torch.float64)
        for slot in self.slots:
            p = slot.parameter
            null = p.grid[len(p.grid) // 2] if p.is_shape else p.null
            out[slot.where] = (value or {}).get(slot.effect.name, {}).get(p.name, null)
        return out

    def local(self, numbers: Tensor) -> dict[str, dict[str, Tensor]]:
        """Values by effect and parameter, local to rows and channels."""
        values: dict[str, dict[str, Tensor]] = {one.name: {} for one in self.effects}
        for slot in self.slots:
            assert self.scopes is not None
            p, here = slot.parameter, values[slot.effect.name]
            here[p.name] = self.scopes.local(slot.spread, numbers[slot.where])
            if p.rated:
                here[p.rate_name] = (self.scopes.rates[slot.spread] @ numbers[slot.where])[:, None]
        return values

    def part(self, values: Values, rows: slice | Tensor) -> Values:
        """Values at some rows."""
        part = {name: dict(mine) for name, mine in values.items()}
        for slot in self.slots:
            if slot.parameter.scope in BY_ROW:
                mine = part[slot.effect.name]
                for name in {slot.parameter.name, slot.parameter.rate_name} & set(mine):
                    mine[name] = mine[name][rows]
        return part

    def within(self, values: Values, samples: slice) -> Values:
        """Values at some samples."""
        part = {name: dict(mine) for name, mine in values.items()}
        for slot in self.slots:
            if slot.parameter.scope == "time":
                mine = part[slot.effect.name]
                mine[slot.parameter.name] = mine[slot.parameter.name][samples]
        return part

    def changed(self, stage: str, value: Any, values: Values) -> Any:
        """A stage as its effects change it, in their order.

        Raises
        ------
        ValueError
            If an effect returns something other than its stage.
        """
        for one in sorted(self.effects, key=lambda one: one.order):
            if one.stage == stage:
                assert self.surroundings is not None
                value = one.change(value, values[one.name], self.surroundings)
                if type(value) is not STAGE_VALUES[stage]:
                    raise ValueError(
                        f"effect {one.name}: its function must return the {stage} stage it was given, changed; "
                        f"it returned {type(value).__name__}"
                    )
        return value

    @property
    def moving(self) -> list[Slot]:
        """Parameters of the whole cable, which may move its channels."""
        return [s for s in self.slots if s.effect.stage == "cable" and s.parameter.scope in ("one", "fiber")]

    def places(self, numbers: Tensor, distance: Tensor) -> Tensor:
        """Place along the route, m, of the fiber at `distance` [place], m, along the fiber.

        Beyond the channels, the offset is that at their ends.
        """
        if self.surroundings is None or not self.moving:
            return distance
        counted = self.surroundings.distance
        cable = self.changed("cable", Cable(counted), self.local(numbers))
        moved = cable.distance + cable.middle - counted
        return distance + between_channels(moved, counted, distance)

    def moves(self, numbers: Tensor, distance: Tensor) -> tuple[Tensor, Tensor]:
        """`places` [place] and their derivatives [place, number] with respect to the numbers of `moving`."""
        mine = [numbers[slot.where] for slot in self.moving]
        if not mine or not len(distance):
            return distance, distance.new_zeros(len(distance), sum(len(one) for one in mine))
        with torch.no_grad():
            at = self.places(numbers, distance)

        def placed(values: Tensor) -> Tensor:
            whole = numbers.clone()
            for slot, value in zip(self.moving, values.split([len(one) for one in mine]), strict=True):
                whole[slot.where] = value
            return self.places(whole, distance)

        by = torch.autograd.functional.jacobian(placed, torch.cat(mine))
        assert isinstance(by, Tensor)
        return at, by

    def clock(self, traffic: Traffic) -> tuple[Tensor, Tensor]:
        """Time since the record's start and since each pass's first row, [row, 1], s."""
        time = self.time if self.time is not None else traffic.sample_index.double()
        first = torch.full((traffic.passes,), torch.inf, dtype=torch.float64)
        first = first.scatter_reduce(0, traffic.pass_index, time, "amin")
        return time[:, None], (time - first[traffic.pass_index])[:, None]

    def described(self, values: Values, gauge_length: float) -> Description:
        """Ground, cable, interrogator and processing with the effects at `values`."""
        if self.surroundings is None:
            return replace(BASE, interrogator=Interrogator(gauge_length))
        around = self.surroundings
        return Description(
            ground=self.changed("ground", BASE.ground, values),
            cable=self.changed("cable", Cable(around.distance), values),
            interrogator=self.changed("interrogator", Interrogator(gauge_length), values),
            processing=self.changed("processing", BASE.processing, values),
            sampling_rate=around.sampling_rate,
            over=1 if self.traffic is None else self.traffic.over,
            channel_spacing=around.channel_spacing,
            chosen=self.chosen,
        )


NONE = Extension()
