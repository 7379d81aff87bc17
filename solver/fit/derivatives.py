"""Derivatives of the strain-rate map by an effect's parameters, by forward-mode automatic differentiation."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, partial
from typing import Any

import torch
from torch import Tensor
from torch.autograd import forward_ad
from torch.func import jvp

from solver.cable import STATION_OFFSETS, Fiber
from solver.extension import Slot, Values
from solver.interrogator import gauge_strain_rate
from solver.model import Sensitivities, SignalPath, Vehicles
from solver.observation import BASE, Description
from solver.stages import Load

#: What may act on the road at each wheel.
FORCES = ("share", "share_rate", "thrust", "thrust_rate")
#: Columns that are filtered at once.
COLUMNS = 16

FiberAt = Callable[[Values, int], Fiber]


@dataclass(frozen=True)
class WheelResponses:
    """What each wheel of each row does to each channel, per unit of what the load stage may change about it.

    Parameters
    ----------
    path : of the model
    load : where its wheels are
    fiber : the gauges' ends
    amplitude : [row, 1]
    poisson_ratio : scalar or [row, channel]
    values : of the effects
    """

    path: SignalPath
    load: Load
    fiber: Fiber
    amplitude: Tensor
    poisson_ratio: Tensor
    values: Values

    @cached_property
    def share(self) -> Tensor:
        """Strain rate [row, channel, wheel] by vertical force."""
        return self._each(share=self._one)

    @cached_property
    def share_rate(self) -> Tensor:
        """Strain rate [row, channel, wheel] by the time derivative of vertical force."""
        return self._each(share_rate=self._one)

    @cached_property
    def thrust(self) -> Tensor:
        """Strain rate [row, channel, wheel, 2] by horizontal force along x and y."""
        return self._both_ways("thrust")

    @cached_property
    def thrust_rate(self) -> Tensor:
        """Strain rate [row, channel, wheel, 2] by the time derivative of horizontal force along x and y."""
        return self._both_ways("thrust_rate")

    def _both_ways(self, force: str) -> Tensor:
        axes = torch.eye(2, dtype=self.amplitude.dtype)
        return torch.stack([self._each(**{force: self._one[..., None] * axis}) for axis in axes], -1)

    @property
    def _one(self) -> Tensor:
        return torch.ones_like(self.load.share[..., :1])

    def _each(self, **force: Any) -> Tensor:
        still = replace(self.load, share=torch.zeros_like(self._one), share_rate=None, thrust=None, thrust_rate=None)
        single, stages = [], self.path.stages_of(self.values)
        for wheel in range(self.load.position.shape[-2]):
            one = replace(still, position=self.load.position[..., wheel : wheel + 1, :], **force)
            single.append(self.path.rows_of(one, self.fiber, self.amplitude, self.poisson_ratio, stages))
        return torch.stack(single, -1)


@dataclass(frozen=True)
class Local:
    """What single vehicles do to single channels at a state, and its derivatives, each computed when asked for.

    Parameters
    ----------
    path : with the effects
    fiber : (values of the effects, order) -> the gauges' ends, or their derivative by distance for order 1
    vehicles, poisson_ratio : of the state
    values : of the effects
    by : strain rate of each vehicle alone and its derivatives by local quantities
    """

    path: SignalPath
    fiber: FiberAt
    vehicles: Vehicles
    poisson_ratio: Tensor
    values: Values
    by: Sensitivities

    @cached_property
    def alone(self) -> Tensor:
        """Map [sample, computed channel] before whatever acts on the whole of it, 1/s."""
        return self.path.traffic.superpose(self.by.rate)

    @cached_property
    def gauges(self) -> Fiber:
        """The gauges' ends."""
        return self.fiber(self.values, 0)

    @cached_property
    def distance(self) -> Tensor:
        """Derivative [row, computed channel] by a shift of the channel along the fiber, 1/m."""
        total = torch.zeros_like(self.by.rate)
        for name, moved in self.fiber(self.values, 1).present().items():
            total = total + (self.by.by[name] * moved).flatten(2).sum(-1)
        return total

    @cached_property
    def slack(self) -> Tensor:
        """Derivative [row, computed channel] by how much farther the gauge reaches, relative to its length."""
        stages = self.path.described(self.values)
        length, gauge = stages.interrogator.gauge_length, torch.as_tensor(stages.gauge)
        strain = self.path.strain(self.load, self.gauges, self.poisson_ratio, stages)
        total = -self.rows.amplitude * stages.cable.gain * gauge_strain_rate(*strain.ends, gauge) * length / gauge
        half = torch.tensor(0.5)
        reach = {"ahead": half, "behind": -half, "inner": torch.from_numpy(STATION_OFFSETS)[:, None]}
        for name, moved in self.fiber(self.values, 1).present().items():
            total = total + length * (self.by.by[name] * moved * reach[name.split("_")[0]]).flatten(2).sum(-1)
        return total

    @cached_property
    def rows(self) -> Vehicles:
        """The vehicles of each row, [row, 1]."""
        rows = self.vehicles.rows(self.path.traffic)
        return Vehicles(*(getattr(rows, f.name)[:, None] for f in fields(rows)))

    @cached_property
    def graded(self) -> tuple[Tensor, Tensor]:
        """Points [channel, point, 3] along each gauge, m, and derivatives [row, channel, point] by compliance there."""
        stages = self.path.described(self.values)
        strain = self.path.strain(self.load, self.gauges, self.poisson_ratio, stages)
        return strain.points, torch.as_tensor(self.rows.amplitude * stages.cable.gain)[..., None] * strain.graded

    @cached_property
    def by_ratio(self) -> tuple[Tensor, Tensor, Tensor | None]:
        """Points [channel, point, 3], m, and derivatives by Poisson's ratio there.

        Of each gauge's pieces [row, channel, piece], by the mean ratio at their ends, and of what the fiber's turning
        within adds [row, channel, station].
        """
        stages = self.path.described(self.values)
        if stages.ground.poisson_change is None:
            # Else the ratio would be the same everywhere, whatever is added to it.
            stages = replace(stages, ground=replace(stages.ground, poisson_change=lambda point: 0 * point[..., 0]))
        strain = self.path.strain(self.load, self.gauges, self.poisson_ratio, stages)
        points, field = strain.points, strain.change
        assert field is not None
        change = field(points)
        scale = torch.as_tensor(self.rows.amplitude * stages.cable.gain)[..., None]
        pieces = jvp(strain.varied, (change,), (torch.ones_like(change),))[1]
        if strain.fiber.inner is None:
            return points, scale * pieces, None
        within = change[..., 1:-1]
        return points, scale * pieces, scale * jvp(strain.bent, (within,), (torch.ones_like(within),))[1]

    @cached_property
    def load(self) -> Load:
        """Forces on the road."""
        return self.path.loads(self.rows, self.values)

    @cached_property
    def wheels(self) -> WheelResponses:
        """Derivatives by the strength of each wheel."""
        return WheelResponses(self.path, self.load, self.gauges, self.rows.amplitude, self.poisson_ratio, self.values)


@dataclass(frozen=True)
class Seen:
    """A model at a state.

    Parameters
    ----------
    path : with the effects
    fiber : as in `Local`
    local : of this path, or of one that differs by an effect at its null
    """

    path: SignalPath
    fiber: FiberAt
    local: Local


def pushed(function: Callable[[Tensor], Tensor], here: Tensor, way: Tensor) -> Tensor:
    """Derivative of a function's value along a way from here, both of the shape of its argument.

    By two backward passes: the gradient is linear in what it is weighted with, and its derivative by that is wanted.
    On what is not large that takes a fifth of the time of PyTorch's forward mode, which calls Python for every operand
    without a derivative.

    >>> pushed(lambda x: x**2, torch.tensor([1.0, 3.0]), torch.tensor([1.0, 10.0]))
    tensor([ 2., 60.])
    """
    (along,) = pushed_all(lambda value: (function(value),), here, way)
    return along


def pushed_all(function: Callable[[Tensor], tuple[Tensor, ...]], here: Tensor, way: Tensor) -> tuple[Tensor, ...]:
    """`pushed` of a function of several values."""
    with torch.enable_grad():
        at = here.detach().requires_grad_()
        values = function(at)
        moving = [value for value in values if value.requires_grad]
        weights = [torch.zeros_like(value, requires_grad=True) for value in moving]
        gradient = torch.autograd.grad(moving, at, weights, create_graph=True)[0] if moving else at
    found = iter(torch.autograd.grad(gradient, weights, way, materialize_grads=True) if moving else ())
    return tuple(next(found) if value.requires_grad else torch.zeros_like(value) for value in values)


def observed_tangents(path: SignalPath, alone: Tensor, tangents: Tensor, values: Values) -> Tensor:
    """What interrogator and processing make of small changes [column, sample, computed channel] of a map."""
    stages = path.described(values)
    plain = not stages.nonlinear and not stages.processing.steps

    def seen(some: Tensor) -> Tensor:
        if plain:
            return path.observed(some, values)
        return jvp(lambda m: path.observed(m, values), (alone.expand_as(some).clone(),), (some.contiguous(),))[1]

    # Spectra of all columns at once would not fit into memory.
    return torch.cat([seen(some) for some in tangents.split(COLUMNS)])


def derivative(seen: Seen, slot: Slot, numbers: Tensor) -> Tensor:
    """Derivative of the observed map by the numbers of one parameter, [number, sample, channel].

    What a row or a channel feels depends on the parameter's value there alone, so that one forward pass with the
    tangent 1 everywhere holds the derivatives by all numbers.
    """
    path, extension = seen.path, seen.path.extension
    values = extension.local(numbers)
    effect, p, scope = slot.effect, slot.parameter, slot.parameter.scope

    def changed(name: str, value: Tensor) -> dict[str, dict[str, Tensor]]:
        return {**values, effect.name: {**values[effect.name], name: value}}

    def rows(new: Values) -> Tensor:
        return path.rows(seen.fiber(new, 0), seen.local.vehicles.rows(path.traffic), seen.local.poisson_ratio, new)

    def tangent(name: str) -> Tensor:
        found = SHORTCUTS[effect.stage](seen, partial(changed, name), values[effect.name][name])
        if found is not None:
            return found
        here = values[effect.name][name]
        return jvp(lambda v: rows(changed(name, v)), (here,), (torch.ones_like(here),))[1]

    def spread(by_row: Tensor, matrix: Tensor) -> Tensor:
        return torch.stack([path.traffic.superpose(by_row * c[:, None]) for c in matrix.unbind(1)])

    here, change = values[effect.name][p.name], partial(changed, p.name)
    one = torch.ones_like(here)
    assert extension.scopes is not None
    ways = [one] if scope == "one" else [w.reshape(here.shape) for w in extension.scopes.along(scope).unbind(1)]
    if not acts_on_rows(seen, slot, values):
        return torch.stack([pushed(lambda v: path.observed(seen.local.alone, change(v)), here, way) for way in ways])
    if effect.stage == "cable" and (placed := placements(seen, change, here, ways)) is not None:
        return observed_tangents(path, seen.local.alone, placed, values)
    if scope == "one":
        whole = SHORTCUTS[effect.stage](seen, change, here)
        if whole is None:
            every = jvp(lambda v: path.observed(path.traffic.superpose(rows(change(v))), change(v)), (here,), (one,))
            return every[1][None]
        columns = path.traffic.superpose(whole)[None]
    elif scope == "fiber":
        columns = path.traffic.superpose(tangent(p.name))[None] * extension.scopes.fiber.T[:, None, :]
    else:
        columns = spread(tangent(p.name), extension.scopes.rows[scope])
        if p.rated:
            columns = columns + spread(tangent(p.rate_name), extension.scopes.rates[scope])
    return observed_tangents(path, seen.local.alone, columns, values)


Changed = Callable[[Tensor], Values]


def shift_tangent(seen: Seen, changed: Changed, here: Tensor) -> Tensor | None:
    """Derivative [row, channel] by a parameter that moves vehicles; None where it turns them or changes their speed."""
    vehicles, path = seen.local.rows, seen.path

    def driven(value: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        trajectory = path.trajectory(vehicles, changed(value))
        return trajectory.position, trajectory.velocity, trajectory.heading

    move, faster, turn = pushed_all(driven, here, torch.ones_like(here))
    if bool(faster.any() | turn.any()):
        return None
    heading = path.trajectory(vehicles, changed(here)).heading
    right = torch.stack([-heading[..., 1], heading[..., 0]], -1)
    return (move * heading).sum(-1) * seen.local.by.by["along"] + (move * right).sum(-1) * seen.local.by.by["across"]


def strength_tangent(seen: Seen, changed: Changed, here: Tensor) -> Tensor | None:
    """Derivative [row, channel] by a parameter that changes the strength of wheels only; None where it moves them."""
    vehicles, path, wheels = seen.local.rows, seen.path, seen.local.wheels

    def strengths(value: Tensor) -> tuple[Tensor, ...]:
        load = path.loads(vehicles, changed(value))
        alike = (load.share, load.share, load.position, load.position)
        forces = (getattr(load, name) for name in FORCES)
        none = (torch.zeros_like(x) if force is None else force for force, x in zip(forces, alike, strict=True))
        return load.position, *none

    moved, *tangents = pushed_all(strengths, here, torch.ones_like(here))
    forces = {name: force for name, force in zip(FORCES, tangents, strict=True) if bool(force.any())}
    total = torch.zeros_like(seen.local.by.rate)
    if bool(moved.any()):
        return None
    # Others may be joined to them, or stand elsewhere.
    if not torch.equal(path.loads(vehicles, changed(here)).position, wheels.load.position):
        return of_strengths(seen, changed(here), tangents[0], forces) if forces else total
    for name, force in forces.items():
        total = total + (getattr(wheels, name) * force).flatten(2).sum(-1)
    return total


def of_strengths(seen: Seen, values: Values, share: Tensor, forces: dict[str, Tensor]) -> Tensor:
    """What wheels of other strengths do [row, channel], those of none left out: all is in proportion to strength."""
    local, load = seen.local, seen.path.loads(seen.local.rows, values)
    acting = torch.stack([force.reshape(*share.shape, -1).any(-1) for force in forces.values()]).flatten(0, 2).any(0)
    strong = {"share_rate": None, "thrust": None, "thrust_rate": None, "share": torch.zeros_like(share)} | forces
    chosen = acting.nonzero()[:, 0]
    part: dict[str, Any] = {name: None if x is None else x.index_select(2, chosen) for name, x in strong.items()}
    wheels = replace(load, position=load.position.index_select(2, chosen), **part)
    stages = seen.path.stages_of(values)
    return seen.path.rows_of(wheels, local.gauges, local.rows.amplitude, local.poisson_ratio, stages)


def ground_tangent(seen: Seen, changed: Changed, here: Tensor) -> Tensor | None:
    """Derivative [row, channel] by a parameter that changes one property of the ground only, of those told apart."""
    ground = seen.path.described(changed(here)).ground
    for names, tangent in GROUND_SHORTCUTS.items():
        usual = {name: getattr(BASE.ground, name) for name in names}
        same = all(getattr(ground, name) is value for name, value in usual.items())
        if not same and not replace(BASE, ground=replace(ground, **usual)).in_rows:
            return tangent(seen, changed, here)
    return None


def ratio_tangent(seen: Seen, changed: Changed, here: Tensor) -> Tensor:
    """Derivative [row, channel] by a parameter that changes Poisson's ratio here and there."""
    points, pieces, within = seen.local.by_ratio

    def change(value: Tensor) -> Tensor:
        field = seen.path.described(changed(value)).ground.poisson_change
        assert field is not None
        return field(points)

    by_point = pushed(change, here, torch.ones_like(here))
    total = (pieces * (by_point[..., 1:] + by_point[..., :-1]) / 2).sum(-1)
    return total if within is None else total + (within * by_point[..., 1:-1]).sum(-1)


def answer_tangent(seen: Seen, changed: Changed, here: Tensor) -> Tensor:
    """Derivative [row, channel] by a parameter that changes how the ground answers loads, or what they radiate.

    Strain is in proportion to the answer: what the answer's derivative would make of the loads is wanted.
    """
    path, local = seen.path, seen.local
    load = replace(local.load, thrust=None, thrust_rate=None)
    with forward_ad.dual_level():
        dual = path.stages_of(changed(forward_ad.make_dual(here, torch.ones_like(here))))

        def varied(rows: slice) -> Description:
            stages = dual(rows)
            ground = stages.ground
            answers = {"response": ground.response, "settlement": ground.settlement, "radiation": ground.radiation}
            moved: dict[str, Any] = {name: varying(answer) for name, answer in answers.items() if answer is not None}
            return replace(stages, ground=replace(ground, **moved))

        return path.rows_of(load, local.gauges, local.rows.amplitude, local.poisson_ratio, varied)


def varying(answer: Callable[..., Tensor]) -> Callable[..., Tensor]:
    """Derivative of an answer to loads by the parameter of which it knows the derivative; zero where it has none."""

    def tangent(offset: Tensor, *others: Tensor) -> Tensor:
        value, along = forward_ad.unpack_dual(answer(offset, *others))
        return torch.zeros_like(value) if along is None else along

    return tangent


def compliance_tangent(seen: Seen, changed: Changed, here: Tensor) -> Tensor:
    """Derivative [row, channel] by a parameter that changes the compliance of the ground here and there."""
    points, graded = seen.local.graded

    def softness(value: Tensor) -> Tensor:
        compliance = seen.path.described(changed(value)).ground.compliance
        return torch.ones_like(points[..., 0]) if compliance is None else compliance(points)

    return (graded * pushed(softness, here, torch.ones_like(here))).sum(-1)


def placements(seen: Seen, changed: Changed, here: Tensor, ways: Sequence[Tensor]) -> Tensor | None:
    """Derivatives [way, sample, channel] by a parameter that moves or stretches gauges, or changes their gain, only.

    Each way that it may change is [] or [channel].
    """

    def placed(value: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        cable = seen.path.described(changed(value)).cable
        zero = torch.zeros_like(cable.distance) + 0 * value.sum()
        return cable.distance + zero, cable.slack + zero, cable.gain + zero

    cable = seen.path.described(changed(here)).cable
    if replace(BASE, cable=replace(cable, slack=BASE.cable.slack, gain=BASE.cable.gain)).in_rows:
        return None
    gain = placed(here)[2]
    tangents = [pushed_all(placed, here, way) for way in ways]
    moves, slacks, gains = (torch.stack(one)[:, None] for one in zip(*tangents, strict=True))
    superpose, local = seen.path.traffic.superpose, seen.local
    total = superpose(local.by.rate) * gains / gain
    if bool(moves.any()):
        total = total + superpose(local.distance) * moves
    return total + superpose(local.slack) * slacks if bool(slacks.any()) else total


def no_shortcut(seen: Seen, changed: Changed, here: Tensor) -> Tensor | None:
    """What acts on whole maps is computed on whole maps."""
    return None


GROUND_SHORTCUTS = {
    ("compliance",): compliance_tangent,
    ("poisson_change",): ratio_tangent,
    ("response", "settlement", "radiation"): answer_tangent,
}
SHORTCUTS = {
    "trajectory": shift_tangent,
    "load": strength_tangent,
    "ground": ground_tangent,
    "cable": no_shortcut,
    "interrogator": no_shortcut,
    "processing": no_shortcut,
}


def acts_on_rows(seen: Seen, slot: Slot, values: Values) -> bool:
    """Whether an effect changes what single vehicles do to single channels, and not just the whole map."""
    if slot.effect.stage in ("trajectory", "load"):
        return True
    alone = replace(seen.path.extension, effects=(slot.effect,)).described(values, seen.path.gauge_length)
    around = seen.path.extension.surroundings
    return alone.in_rows or (around is not None and alone.cable.distance is not around.distance)
