"""Derivatives by parameters that change one stage in a simple way, from what single vehicles do to single channels.

A parameter that only moves vehicles, changes forces, what the ground answers, or where channels are, needs no forward
pass through the whole signal path.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import torch
from torch import Tensor
from torch.autograd import forward_ad

from solver.interrogator.gauge import gauge_strain_rate
from solver.signal_path.autodiff import pushed, pushed_all
from solver.signal_path.extension import Values
from solver.signal_path.local import Seen
from solver.signal_path.observation import Description

#: What may act on the road at each wheel.
FORCES = ("share", "share_rate", "thrust", "thrust_rate")

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
        rest: dict[str, Any] = dict.fromkeys(names)
        own = any(getattr(ground, name) is not None for name in names)
        if own and replace(ground, **rest).plain:
            return tangent(seen, changed, here)
    return None


def ratio_tangent(seen: Seen, changed: Changed, here: Tensor) -> Tensor | None:
    """Derivative [row, channel] by a parameter that changes Poisson's ratio here and there.

    None where the ratio at what holds a loose length counts too.
    """
    if seen.path.described(changed(here)).cable.loose is not None:
        return None
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
            radiation = None if ground.radiation is None else varying(ground.radiation)
            response, settlement = varying(ground.displacement_rate), varying(ground.displacement)
            moved = replace(ground, response=response, settlement=settlement, radiation=radiation)
            return replace(stages, ground=moved)

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

    def placed(value: Tensor) -> tuple[Tensor, ...]:
        cable = seen.path.described(changed(value)).cable
        zero = torch.zeros_like(cable.counted) + 0 * value.sum()
        loose = () if cable.loose is None else (cable.loose.begin, cable.loose.end, cable.loose.share)
        return cable.shift + zero, cable.slack + zero, cable.gain + zero, *(x + 0 * value.sum() for x in loose)

    cable = seen.path.described(changed(here)).cable
    if not replace(cable, slack=0.0, gain=1.0, loose=None).like_ground:
        return None
    gain = placed(here)[2]
    tangents = [torch.stack(one)[:, None] for one in zip(*(pushed_all(placed, here, way) for way in ways), strict=True)]
    moves, slacks, gains, *loose = tangents
    if any(bool(one.any()) for one in loose):
        return None
    superpose, local = seen.path.traffic.superpose, seen.local
    total = superpose(local.by.rate) * gains / gain
    if bool(moves.any()):
        total = total + superpose(local.distance) * moves
    return total + superpose(local.slack) * slacks if bool(slacks.any()) else total


def loose_tangent(seen: Seen, changed: Changed, here: Tensor) -> Tensor | None:
    """Derivative [row, channel] by the share to which a loose length evens its strain out; None for all else.

    All is in proportion to that share, and the same motion of gauges' ends serves for any length.
    """
    local, path = seen.local, seen.path

    def evened(value: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        loose = path.described(changed(value)).cable.loose
        assert loose is not None
        return loose.begin, loose.end, loose.share

    stages = path.described(changed(here))
    cable = stages.cable
    if cable.loose is None or cable.moved or replace(stages, cable=replace(cable, loose=None)).in_rows:
        return None
    begins, ends, share = pushed_all(evened, here, torch.ones_like(here))
    if bool(begins.any() | ends.any()):
        return None
    strain = path.strain(local.load, seen.fiber(changed(here), 0), local.poisson_ratio, stages)
    ahead, behind = local.ground_ends
    first, last = strain.held
    full, along = replace(cable.loose, share=share), strain.along
    moved = [full.moved(x, along[..., end], first, last) - x for x, end in ((ahead, -1), (behind, 0))]
    return local.rows.amplitude * gauge_strain_rate(moved[0], moved[1], torch.as_tensor(stages.gauge))


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
    "cable": loose_tangent,
    "interrogator": no_shortcut,
    "processing": no_shortcut,
}
