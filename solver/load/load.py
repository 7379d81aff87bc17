"""Load stage: forces on the road."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace

import numpy as np
import torch
from torch import Tensor

from solver.trajectory.trajectory import Trajectory

#: Forces of wheels on the road, and how fast these change.
FORCES = ("share", "share_rate", "thrust", "thrust_rate")


@dataclass(frozen=True)
class Load:
    """Forces on the road.

    Parameters
    ----------
    position : [row, 1 or channel, wheel, 2], m
    share : [row, 1 or channel, wheel], vertical force over the vehicle's static weight
    trajectory : that of the vehicles
    class_index : [row], which vehicle class, see `solver.load.wheel_layout.CLASSES`
    share_rate : like `share`, its time derivative, 1/s; None where constant
    thrust : [row, 1 or channel, wheel, 2], horizontal force on the road over the static weight; None: no such force
    thrust_rate : like `thrust`, its time derivative, 1/s; None where constant
    """

    position: Tensor
    share: Tensor
    trajectory: Trajectory
    class_index: Tensor
    share_rate: Tensor | None = None
    thrust: Tensor | None = None
    thrust_rate: Tensor | None = None

    def __post_init__(self) -> None:
        """Refuse forces of other wheels.

        Raises
        ------
        ValueError
            If a force is given for more or fewer wheels than there are.
        """
        for name, force in self.forces.items():
            given, there = force.shape[2:3], self.position.shape[2:3]
            if given and given != there:
                raise ValueError(f"{name} is of {given[0]} wheels, and there are {there[0]}")

    @property
    def tensors(self) -> dict[str, Tensor]:
        """All that is known of each row, [row, ...] each; of its trajectory by names with a dot."""
        own = {f.name: getattr(self, f.name) for f in fields(self) if isinstance(getattr(self, f.name), Tensor)}
        return own | {f"trajectory.{f.name}": getattr(self.trajectory, f.name) for f in fields(self.trajectory)}

    def with_tensors(self, tensors: Mapping[str, Tensor]) -> "Load":
        """The same of other rows: all of `tensors`, named as there."""
        own = {name: x for name, x in tensors.items() if "." not in name}
        driven = {f.name: tensors[f"trajectory.{f.name}"] for f in fields(self.trajectory)}
        return replace(self, trajectory=replace(self.trajectory, **driven), **own)

    def alike(self, other: "Load") -> bool:
        """Whether wheels stand and press alike, and exert the same kinds of forces."""
        same = self.tensors.keys() == other.tensors.keys() and self.position.shape == other.position.shape
        return same and torch.equal(self.position, other.position) and torch.equal(self.share, other.share)

    def part(self, rows: slice | Tensor) -> "Load":
        """Some of its rows."""
        return self.with_tensors({name: x[rows] for name, x in self.tensors.items()})

    def modulated(self, factor: Tensor, rate: Tensor) -> "Load":
        """Vertical force times `factor` [row, 1], which changes by `rate` [row, 1], 1/s."""
        before = 0.0 if self.share_rate is None else self.share_rate * factor[..., None]
        return replace(self, share=self.share * factor[..., None], share_rate=before + self.share * rate[..., None])

    def pushing(
        self, along: Tensor | float = 0.0, across: Tensor | float = 0.0, along_rate: Tensor | float = 0.0
    ) -> "Load":
        """With a horizontal force on the road, along travel and to the right, each [row, 1] over the vertical force.

        `along_rate` [row, 1], 1/s, is how fast that along travel changes.
        """
        forward, right = self.trajectory.heading, self.trajectory.right
        push = (torch.as_tensor(along)[..., None] * forward + torch.as_tensor(across)[..., None] * right)[..., None, :]
        faster = (torch.as_tensor(along_rate)[..., None] * forward)[..., None, :]
        rate = self.share[..., None] * faster
        if self.share_rate is not None:
            rate = rate + self.share_rate[..., None] * push
        thrust, thrust_rate = added(self.thrust, self.share[..., None] * push), added(self.thrust_rate, rate)
        steady = self.share_rate is None and not isinstance(along_rate, Tensor)
        return replace(self, thrust=thrust, thrust_rate=self.thrust_rate if steady else thrust_rate)

    @property
    def forces(self) -> dict[str, Tensor]:
        """The forces that there are, and their rates, [row, 1 or channel, wheel, ...] each."""
        return {name: x for name, x in self.tensors.items() if name in FORCES}

    def scaled(self, by: Tensor) -> "Load":
        """All forces times `by` [row, 1 or channel, 1 or wheel]."""
        scaled = {name: x * by.reshape(*by.shape, *[1] * (x.ndim - by.ndim)) for name, x in self.forces.items()}
        return self.with_tensors(self.tensors | scaled)

    def whole_at(self, position: Tensor) -> "Load":
        """The whole force of each vehicle on every wheel of others, at `position` [row, 1 or channel, wheel, 2]."""
        count = position.shape[2]
        whole = {name: x.sum(2, keepdim=True).expand(-1, -1, count, *x.shape[3:]) for name, x in self.forces.items()}
        return self.with_tensors(self.tensors | whole | {"position": position})

    def joined(self, other: "Load") -> "Load":
        """With the wheels of another load of the same vehicles and kinds of forces besides."""
        others, both = other.tensors, dict[str, Tensor]()
        for name, mine in self.tensors.items():
            if name in ("position", *FORCES):
                lead = np.broadcast_shapes(mine.shape[:2], others[name].shape[:2])
                both[name] = torch.cat([one.expand(*lead, *one.shape[2:]) for one in (mine, others[name])], 2)
        return self.with_tensors(self.tensors | both)


def added(before: Tensor | None, more: Tensor) -> Tensor:
    """A force with more of it."""
    return more if before is None else before + more
