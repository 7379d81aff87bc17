"""Response of single gauges to single vehicles at a state, at all samples or some: what derivatives share."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from solver.ground.ground import Ground
from solver.load.load import Load
from solver.signal_path.autodiff import pushed_all
from solver.signal_path.extension import Values
from solver.signal_path.gauges import Gauges
from solver.signal_path.observation import Description
from solver.signal_path.sensitivities import ByLoad, Sensitivities
from solver.signal_path.traffic import Traffic, Vehicles, columns

if TYPE_CHECKING:
    from solver.signal_path.signal_path import SignalPath

#: Numbers of the cable that a parameter may change: per channel, common to all, and of a loose length.
EACH, ALIKE, LOOSE = ("shift", "slack", "gain"), ("vertical", "path_integral"), ("begin", "end", "share")


@dataclass(frozen=True)
class Section:
    """Some samples of a survey, and the rows of vehicles at them.

    Parameters
    ----------
    samples : of the traffic's
    rows : [row], of the traffic's
    """

    samples: slice
    rows: Tensor

    @classmethod
    def of(cls, traffic: Traffic, samples: slice) -> "Section":
        """With the rows at those samples."""
        at = traffic.sample_index
        return cls(samples, ((at >= samples.start) & (at < samples.stop)).nonzero()[:, 0])


@dataclass(frozen=True)
class Local:
    """Response of single gauges to single vehicles at a state: what all derivatives share.

    Parameters
    ----------
    path : with the effects
    gauges : as the stages describe them, on the route of the state
    vehicles : per row
    poisson_ratio : of the state
    values : of the effects
    section : the samples that it is of; all where None
    known : sensitivities at the state, where they are computed already
    loads : of all rows, if they are not as the path has them
    """

    path: "SignalPath"
    gauges: Callable[[Description], Gauges]
    vehicles: Vehicles
    poisson_ratio: Tensor
    values: Values
    section: Section | None = None
    known: Sensitivities | None = None
    loads: Load | None = None
    _by_load: list[tuple[Load, ByLoad]] = field(default_factory=list, init=False)
    _by_number: dict[tuple[object, ...], Tensor] = field(default_factory=dict, init=False)
    _law: list[tuple["SignalPath", Tensor, Tensor]] = field(default_factory=list, init=False)

    @cached_property
    def every_load(self) -> Load:
        """Forces on the road, at all rows."""
        return self.loads or self.path.loads(columns(self.vehicles), self.values)

    @cached_property
    def load(self) -> Load:
        """The same at its rows."""
        loads = self.every_load
        return loads if self.section is None else loads.with_tensors(self.at_rows(loads.tensors))

    @cached_property
    def here(self) -> Gauges:
        """The gauges at the state."""
        return self.gauges(self.path.described(self.values))

    @cached_property
    def amplitude(self) -> Tensor:
        """That of the vehicle of each row [row, 1]."""
        return self.at_rows({"": self.vehicles.amplitude})[""][:, None]

    @cached_property
    def by(self) -> Sensitivities:
        """Sensitivities at the state."""
        return self.known or self.path.by_gauges_and_loads(
            self.load, self.here, self.amplitude[:, 0], self.poisson_ratio, self.grounds(self.path.grounds(self.values))
        )

    @cached_property
    def alone(self) -> Tensor:
        """Map [sample, computed channel], 1/s, before stages that act on the whole map."""
        if self.known is not None or "by" in self.__dict__:
            return self.superposed(self.by.rate)
        ground = self.grounds(self.path.grounds(self.values))
        return self.superposed(self.amplitude * self.path.alone(self.load, self.here, self.poisson_ratio, ground))

    @property
    def shape(self) -> tuple[int, int]:
        """How many rows and channels it is of."""
        return len(self.amplitude), len(self.here.points)

    def at_rows(self, tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """Of tensors [row, ...] of all rows those that it is of."""
        return dict(tensors) if self.section is None else {name: x[self.section.rows] for name, x in tensors.items()}

    def grounds(self, ground: Callable[[slice | Tensor], Ground]) -> Callable[[slice | Tensor], Ground]:
        """A function from its rows to their ground, from one of all rows."""
        section = self.section
        return ground if section is None else lambda rows: ground(section.rows[rows])

    def superposed(self, rows: Tensor) -> Tensor:
        """Responses [row, ...] of its rows summed at their samples [sample, ...]."""
        traffic, section = self.path.traffic, self.section
        if section is None:
            return traffic.superpose(rows)
        total = rows.new_zeros((section.samples.stop - section.samples.start, *rows.shape[1:]))
        return total.index_add_(0, traffic.sample_index[section.rows] - section.samples.start, rows)

    def by_load(self, load: Load) -> ByLoad:
        """Derivatives with respect to a load that may have other wheels than `by`, or further forces that are zero."""
        for known, by in ((self.by.load, self.by.by_load), *self._by_load):
            if known.alike(load):
                return by
        if self._by_load and self.bytes > 2 * self.by.bytes:
            self._by_load.pop(0)
        ground = self.grounds(self.path.grounds(self.values))
        by = self.path.by_load(load, self.here, self.poisson_ratio, ground)
        self._by_load.append((load, by))
        return by

    @property
    def bytes(self) -> int:
        """Their size in memory."""
        every = [one for _, by in self._by_load for one in by.values()] + list(self._by_number.values())
        own = self.by.bytes if "by" in self.__dict__ else 0
        return own + sum(one.numel() * one.element_size() for one in every)

    def along_gauges(self, here: Gauges, change: Gauges) -> Tensor:
        """Derivative [row, channel] by what changes gauges so; some of their points may lie elsewhere than in `by`."""
        ground = self.grounds(self.path.grounds(self.values))
        if not any(bool(one.any()) for one in (change.points, change.change) if one is not None):
            # Strain rate is linear in the weights.
            return self.amplitude * self.path.alone(
                self.load, replace(here, weights=change.weights), self.poisson_ratio, ground
            )
        other = (here.points != self.here.points).flatten(2).any(2).any(0)
        if not bool(other.any()):
            return self.by.along_gauges(change)
        # Each point adds what it adds, whatever the others are.
        new = self.path.by_gauges_and_loads(
            self.load, here.part(other), self.amplitude[:, 0], self.poisson_ratio, ground
        )
        return self.by.along_gauges(change, ~other) + new.along_gauges(change.part(other))

    def law_at(self, path: "SignalPath", numbers: Tensor, told: Callable[[], Tensor]) -> Tensor:
        """What each vehicle does alone, [row, channel], with effects at some `numbers`: once for all of these.

        Parameters
        ----------
        path : with the effects
        numbers : of their parameters, shapes of what is absent left out
        told : computes it, without horizontal forces
        """
        pushed = self.load.thrust is not None or self.load.thrust_rate is not None
        if self.known is not None and path is self.path and not pushed:
            return self.known.alone
        if not any(one is path and torch.equal(at, numbers) for one, at, _ in self._law):
            self._law[:] = [(path, numbers, told())]
        return self._law[0][2]

    def by_number(self, stages: Description, name: str) -> Tensor:
        """Derivative of `alone` with respect to a number of the cable, or the gauge length."""
        loose = stages.cable.loose
        key = name, *(() if loose is None else (float(getattr(loose, one)) for one in LOOSE))
        if key not in self._by_number:
            here = torch.as_tensor(number(stages, name), dtype=torch.float64)
            here = here.expand(len(stages.cable.counted)) if name in EACH else here
            moved = pushed_all(lambda x: self.gauges(with_number(stages, name, x)).tensors, here, torch.ones_like(here))
            self._by_number[key] = self.superposed(self.along_gauges(self.gauges(stages), Gauges(*moved)))
        return self._by_number[key]


@dataclass(frozen=True)
class Seen:
    """A model at a state.

    Parameters
    ----------
    path : with the effects
    gauges : as in `Local`
    local : of this path, or of one that differs only by an effect at its null
    """

    path: "SignalPath"
    gauges: Callable[[Description], Gauges]
    local: Local

    @property
    def samples(self) -> NDArray[np.int64]:
        """The traffic's samples that it is of."""
        samples, section = self.path.traffic.samples, self.local.section
        return samples if section is None else samples[section.samples]


def number(stages: Description, name: str) -> Tensor | float:
    """A number of the cable or its loose length, or the gauge length."""
    if name == "gauge_length":
        return stages.interrogator.gauge_length
    value: Tensor | float = getattr(stages.cable.loose if name in LOOSE else stages.cable, name)
    return value


def with_number(stages: Description, name: str, value: Tensor) -> Description:
    """The stages with another value of `number`."""
    if name == "gauge_length":
        return replace(stages, interrogator=replace(stages.interrogator, gauge_length=value))
    cable = stages.cable
    if name in LOOSE:
        assert cable.loose is not None
        return replace(stages, cable=replace(cable, loose=replace(cable.loose, **{name: value})))
    changed = {name: value}
    return replace(stages, cable=replace(cable, **changed))  # type: ignore[arg-type]
