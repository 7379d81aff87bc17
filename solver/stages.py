"""The six stages of the signal path as values: what an effect is given, and what it gives back changed.

trajectory -> load -> ground -> cable -> interrogator -> processing. Each is a frozen record of tensors and functions
whose defaults are the base model; `dataclasses.replace` (or one of the methods) makes a changed one.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace

import torch
from torch import Tensor

from solver.ground import Ratio, Response, displacement, displacement_rate

#: Complex transfer of a time filter at the complex frequency s = sigma + i omega, rad/s.
TimeTransfer = Callable[[Tensor], Tensor]
#: Real, even transfer of a filter along the fiber at the wavenumber k, rad/m.
FiberTransfer = Callable[[Tensor], Tensor]
#: Of a map [..., sample, channel].
MapFunction = Callable[[Tensor], Tensor]
#: Value [...] at points of the ground [..., 3], m.
Field = Callable[[Tensor], Tensor]


@dataclass(frozen=True)
class Surroundings:
    """What an effect may ask about the survey, beside the stage that it changes.

    Parameters
    ----------
    distance : [channel], along the fiber, m
    recorded : channels of the whole record, those beyond the stretch that is fitted included
    gauge_length, channel_spacing : m
    sampling_rate : Hz
    passes : number of passes
    middle : [2], middle of the stretch of road that was observed, m
    largest : largest strain rate of the record, single jumps left aside, 1/s
    """

    distance: Tensor
    recorded: int
    gauge_length: float
    channel_spacing: float
    sampling_rate: float
    passes: int
    middle: Tensor
    largest: float


@dataclass(frozen=True)
class Trajectory:
    """Where the vehicles are; a row is one vehicle at one sample.

    Parameters
    ----------
    time : [row, 1], s since the record's start
    since : [row, 1], s since the vehicle's first row
    position, velocity : [row, 1 or channel, 2], m and m/s
    heading : [row, 1 or channel, 2], unit vector along travel
    pass_index : [row], which pass
    """

    time: Tensor
    since: Tensor
    position: Tensor
    velocity: Tensor
    heading: Tensor
    pass_index: Tensor

    @property
    def speed(self) -> Tensor:
        """[row, 1], m/s."""
        return self.velocity.norm(dim=-1)

    @property
    def right(self) -> Tensor:
        """[row, 1 or channel, 2], unit vector to the driver's right."""
        return torch.stack([-self.heading[..., 1], self.heading[..., 0]], -1)

    def since_passing(self, beyond: Tensor) -> Tensor:
        """Time [row, 1 or channel], s, since each vehicle was where `beyond` [row, 1 or channel], m on its way, is 0.

        By its sample nearest to there and the speed that it had, so that it may slow down before and after.
        """
        with torch.no_grad():
            away = beyond[:, :1].abs()
            least = away.new_full((int(self.pass_index.max()) + 1,), torch.inf)
            least = least.scatter_reduce(0, self.pass_index, away[:, 0], "amin")[self.pass_index]
            nearest = (away[:, 0] == least).nonzero()[:, 0]
            row = torch.zeros(int(self.pass_index.max()) + 1, dtype=torch.long)
            row = row.index_copy(0, self.pass_index[nearest], nearest)[self.pass_index]
            speed = self.speed.clamp_min(0.5)[row]
            passed = self.time - self.time[row] + beyond[row] / speed
        # Each sample's own place alone is differentiated: a place, or a shift of the vehicle, moves all of them alike.
        return passed + (beyond - beyond.detach()) / speed

    def shifted(self, along: Tensor | float = 0.0, across: Tensor | float = 0.0) -> "Trajectory":
        """Moved along travel and to the right, each [row, 1 or channel], m."""
        forward, sideways = torch.as_tensor(along)[..., None], torch.as_tensor(across)[..., None]
        return replace(self, position=self.position + forward * self.heading + sideways * self.right)


@dataclass(frozen=True)
class Load:
    """Forces on the road.

    Parameters
    ----------
    position : [row, 1 or channel, wheel, 2], m
    share : [row, 1 or channel, wheel], vertical force over the vehicle's static weight
    trajectory : that of the vehicles
    class_index : [row], which vehicle class, see `solver.load.CLASSES`
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

    def part(self, rows: slice) -> "Load":
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

    def joined(self, position: Tensor, share: Tensor) -> "Load":
        """With more wheels: position [row, 1 or channel, wheel, 2], share [row, 1 or channel, wheel]."""
        lead = torch.broadcast_shapes(self.share.shape[:-1], share.shape[:-1])

        def both(one: Tensor, other: Tensor, tail: int) -> Tensor:
            cut = one.shape[len(one.shape) - tail :], other.shape[len(other.shape) - tail :]
            return torch.cat([one.expand(*lead, *cut[0]), other.expand(*lead, *cut[1])], len(lead))

        rate = None if self.share_rate is None else both(self.share_rate, torch.zeros_like(share), 1)
        none = torch.zeros_like(position)
        thrust, thrust_rate = (None if x is None else both(x, none, 2) for x in (self.thrust, self.thrust_rate))
        return replace(
            self,
            position=both(self.position, position, 2),
            share=both(self.share, share, 1),
            share_rate=rate,
            thrust=thrust,
            thrust_rate=thrust_rate,
        )


def added(before: Tensor | None, more: Tensor) -> Tensor:
    """A force with more of it."""
    return more if before is None else before + more


@dataclass(frozen=True)
class Ground:
    """How the ground answers a load.

    Parameters
    ----------
    response : (offset [..., 3], velocity [..., 2], Poisson's ratio) -> displacement rate [..., 3] of a unit load
    settlement : (offset, Poisson's ratio) -> displacement [..., 3] of a unit load
    compliance : strain here over that of the base model
    poisson_change : added to Poisson's ratio here
    radiation : (offset [..., 3], velocity [..., 2], time [row, 1, ...], s) -> velocity [..., 3] of the ground in the
        waves that a unit load sends out; None: no such waves
    transfers : of time filters
    tangent_compliances : functions of a map of strain [..., sample, channel]: how much more it changes than in the base
        model
    """

    response: Response = displacement_rate
    settlement: Callable[[Tensor, Ratio], Tensor] = displacement
    compliance: Field | None = None
    poisson_change: Field | None = None
    radiation: Callable[[Tensor, Tensor, Tensor], Tensor] | None = None
    transfers: tuple[TimeTransfer, ...] = ()
    tangent_compliances: tuple[MapFunction, ...] = ()

    def filtered(self, transfer: TimeTransfer) -> "Ground":
        """Whose displacement is filtered in time."""
        return replace(self, transfers=(*self.transfers, transfer))

    def yielding(self, compliance: MapFunction) -> "Ground":
        """Whose strain changes more, or less, by what it is."""
        return replace(self, tangent_compliances=(*self.tangent_compliances, compliance))


@dataclass(frozen=True)
class Loose:
    """A length of fiber that nothing holds but its two ends: there tension, and so strain, is the same all along.

    Parameters
    ----------
    begin, end : scalars, along the route, m
    share : scalar, of that evening out which takes place
    """

    begin: Tensor
    end: Tensor
    share: Tensor

    def moved(self, ground: Tensor, at: Tensor, first: Tensor, last: Tensor) -> Tensor:
        """Motion along the fiber where the ground's is `ground` and, at the two ends, `first` and `last`, all [...].

        `at` [...] is where along the route, m. Between the ends the fiber's motion is linear.

        >>> loose = Loose(torch.tensor(2.0), torch.tensor(6.0), torch.tensor(1.0))
        >>> loose.moved(torch.zeros(3), torch.tensor([1.0, 3.0, 5.0]), torch.tensor(4.0), torch.tensor(8.0)).tolist()
        [0.0, 5.0, 7.0]
        """
        way = (at - self.begin) / (self.end - self.begin)
        even = ground + self.share * (first + way * (last - first) - ground)
        return torch.where((way > 0) & (way < 1), even, ground)


@dataclass(frozen=True)
class Cable:
    """Where the channels are on the fiber and how it follows the ground.

    Parameters
    ----------
    distance : [channel], along the route, halfway between the ends of each gauge, m
    slack : [channel] or scalar, share by which a gauge reaches farther along the route than its length says
    middle : [channel] or scalar, how much farther along the route the middle of a gauge lies than halfway, m
    gain : [channel] or scalar, strain of the fiber over that of the ground
    vertical : share of the ground's vertical motion that the fiber follows
    path_integral : share of the strain that bends within a gauge add to the motion of its two ends
    loose : where the fiber slips; None where it does not
    transfers : of filters along the fiber
    mixing : [channel, channel] matrices applied along the fiber
    """

    distance: Tensor
    slack: Tensor | float = 0.0
    middle: Tensor | float = 0.0
    gain: Tensor | float = 1.0
    vertical: Tensor | float = 1.0
    path_integral: Tensor | float = 0.0
    loose: Loose | None = None
    transfers: tuple[FiberTransfer, ...] = ()
    mixing: tuple[Tensor, ...] = ()

    def filtered(self, transfer: FiberTransfer) -> "Cable":
        """Whose strain is filtered along the fiber."""
        return replace(self, transfers=(*self.transfers, transfer))

    def mixed(self, matrix: Tensor) -> "Cable":
        """Whose channels are sums [channel, channel] of the base model's."""
        return replace(self, mixing=(*self.mixing, matrix))


@dataclass(frozen=True)
class Interrogator:
    """How strain becomes numbers.

    Parameters
    ----------
    gauge_length : m
    gain : scalar or [sample, 1], output of all channels over strain rate
    fiber_transfers : of filters along the fiber
    mixing : [channel, channel] matrices applied along the fiber
    transfers : of time filters
    pointwise : functions of each sample
    """

    gauge_length: Tensor | float
    gain: Tensor | float = 1.0
    fiber_transfers: tuple[FiberTransfer, ...] = ()
    mixing: tuple[Tensor, ...] = ()
    transfers: tuple[TimeTransfer, ...] = ()
    pointwise: tuple[MapFunction, ...] = ()

    def filtered(self, transfer: TimeTransfer) -> "Interrogator":
        """Whose output is filtered in time."""
        return replace(self, transfers=(*self.transfers, transfer))

    def blurred(self, transfer: FiberTransfer) -> "Interrogator":
        """Whose output is filtered along the fiber."""
        return replace(self, fiber_transfers=(*self.fiber_transfers, transfer))

    def mixed(self, matrix: Tensor) -> "Interrogator":
        """Whose channels are sums [channel, channel] of the base model's."""
        return replace(self, mixing=(*self.mixing, matrix))

    def through(self, function: MapFunction) -> "Interrogator":
        """Whose every sample goes through a function of a map [..., sample, channel]."""
        return replace(self, pointwise=(*self.pointwise, function))


@dataclass(frozen=True)
class Processing:
    """What is done to the map afterwards: functions of a gapless stretch of it, [..., sample, channel]."""

    steps: tuple[MapFunction, ...] = ()

    def then(self, step: MapFunction) -> "Processing":
        """With one more step."""
        return replace(self, steps=(*self.steps, step))


STAGES: dict[str, type] = {
    "trajectory": Trajectory,
    "load": Load,
    "ground": Ground,
    "cable": Cable,
    "interrogator": Interrogator,
    "processing": Processing,
}
