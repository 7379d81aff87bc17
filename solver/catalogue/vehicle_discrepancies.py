"""Discrepancy models of vehicles: where they are, and what load they put on the ground."""

from collections.abc import Mapping
from dataclasses import replace

import torch
from torch import Tensor

from solver.catalogue.sieve import SOURCE
from solver.effect import Discrepancy, Parameter, Plain, Surroundings, effect
from solver.load.load import Load
from solver.trajectory.trajectory import Trajectory

Values = Mapping[str, Tensor]
#: Places ahead of a vehicle and behind it, m.
TRAIN = (5, 10, 18)


@effect(
    "generic_track",
    "trajectory",
    [Parameter("x", "m", 0.3, scope="road"), Parameter("y", "m", 0.3, scope="road")],
    physics="All vehicles are off their tracks, by a shift that changes smoothly along the road.",
    plain=Plain("Unknown shift of tracks"),
    source=SOURCE,
    families=("place",),
    discrepancy=Discrepancy(),
)
def generic_track(driven: Trajectory, p: Values, survey: Surroundings) -> Trajectory:
    """Positions plus a smooth function of x."""
    return replace(driven, position=driven.position + torch.stack([p["x"], p["y"]], -1))


@effect(
    "generic_shift",
    "trajectory",
    [Parameter("along", "m", 0.5, scope="pass"), Parameter("across", "m", 0.5, scope="pass")],
    physics="Each vehicle is off its track by a constant shift.",
    plain=Plain("Unknown shift of each vehicle"),
    source=SOURCE,
    families=("lag", "rigid"),
    discrepancy=Discrepancy(),
)
def generic_shift(driven: Trajectory, p: Values, survey: Surroundings) -> Trajectory:
    """One shift along and one across travel for each pass."""
    return driven.shifted(along=p["along"], across=p["across"])


@effect(
    "generic_load",
    "load",
    [Parameter("change", "1", 0.2, scope="track", rated=True)],
    physics="The load of each vehicle changes smoothly as it drives.",
    plain=Plain("Unknown change of weights"),
    source=SOURCE,
    discrepancy=Discrepancy(),
)
def generic_load(load: Load, p: Values, survey: Surroundings) -> Load:
    """Weight times 1 + change."""
    return load.modulated(1 + p["change"], p["change_rate"])


@effect(
    "generic_road",
    "load",
    [Parameter("change", "1", 0.2, scope="road", rated=True)],
    physics="The load of all vehicles changes in the same way along the road.",
    plain=Plain("Unknown change along the road"),
    source=SOURCE,
    families=("gain",),
    discrepancy=Discrepancy(),
)
def generic_road(load: Load, p: Values, survey: Surroundings) -> Load:
    """Weight times 1 + change."""
    return load.modulated(1 + p["change"], p["change_rate"])


@effect(
    "generic_train",
    "load",
    [Parameter(f"{way}_{reach}", "1", 0.2, scope="pass") for way in ("before", "behind") for reach in TRAIN],
    physics="Each vehicle also presses or pulls some meters ahead of it and behind it.",
    plain=Plain("Unknown load ahead or behind"),
    source=SOURCE,
    families=("blur",),
    discrepancy=Discrepancy(before_and_behind=True),
    order=-1,
)
def generic_train(load: Load, p: Values, survey: Surroundings) -> Load:
    """More loads along travel, each a share of the vehicle's weight."""
    driven = load.trajectory
    reach = [sign * meters for sign in (1, -1) for meters in TRAIN]
    along = torch.tensor(reach, dtype=torch.float64)[:, None] * driven.heading[..., None, :]
    share = torch.stack([p[f"{way}_{meters}"] for way in ("before", "behind") for meters in TRAIN], -1)
    return load.joined(load.whole_at(driven.position[..., None, :] + along).scaled(share))


@effect(
    "generic_twin",
    "load",
    [
        Parameter("share", "1", 0.2, lower=-3, upper=3),
        Parameter("aside", "m", 3.0, lower=-12, upper=12, grid=(-8.0, -5.0, 5.0, 8.0)),
    ],
    physics="A second signal is recorded, like that of another fiber some meters to one side.",
    plain=Plain("Unknown second source"),
    source=SOURCE,
    discrepancy=Discrepancy(stage="cable"),
    order=3,
)
def generic_twin(load: Load, p: Values, survey: Surroundings) -> Load:
    """A share of every wheel's load once more, aside: a fiber beside this one sees the road that far away."""
    across = torch.stack([torch.zeros_like(p["aside"]), p["aside"]], -1)
    return load.joined(replace(load, position=load.position + across).scaled(p["share"].reshape(1, 1, 1)))


EFFECTS = (
    generic_track,
    generic_shift,
    generic_load,
    generic_road,
    generic_train,
    generic_twin,
)
