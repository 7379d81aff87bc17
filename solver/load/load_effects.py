"""Load stage: what vehicles do to the road beyond four wheels of constant weight."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from solver.effect import Fitted, Parameter, Plain, Start, Surroundings, absolute, effect, percent, percents, root
from solver.load.load import Load, added
from solver.load.wheel_layout import CLASSES, LAYOUTS, POINTS, class_number

Values = Mapping[str, Tensor]

#: m; the second moment of a layout is exact for any reach of its stencil, the fourth is nearly so for this one.
SOFTENING = 0.3
#: Classes from light to heavy, and weights relative to the lighter half's mean that divide them.
HEAVIER, TIMES = ("car", "truck", "bus"), (1.8, 5.0)
#: Classes of which a vehicle may be a long one.
HEAVY = ("vehicle", "unknown", "truck", "bus")


def spread(second: Tensor) -> tuple[Tensor, Tensor]:
    """Offset, m, and share of the outer two of three loads with this second moment times 4, m^2.

    A wheelbase enters through its square: at 0 the share is 0, with a derivative; at 2.65 m it is 0.95.
    """
    reach = second / 4 + SOFTENING**2
    return reach.sqrt(), second / (4 * reach)


def share_in_front(wheelbase: Tensor) -> Tensor:
    """Share of the load on the front axle that goes with a wheelbase, m: the line through the classes' layouts.

    >>> [round(float(share_in_front(torch.tensor(length))), 2) for length in (2.65, 5.9)]
    [0.56, 0.37]
    """
    return torch.clamp(0.71 - 0.058 * wheelbase, 0.36, 0.56)


def on_usual_wheels(fitted: Fitted) -> list[Start]:
    """Vehicles of unknown class on the wheels of the classes that their weights suggest.

    Point loads have driven the ground's Poisson ratio and the depth elsewhere, from where steps lead nowhere.
    """
    unknown = np.array([name in POINTS for name in fitted.vehicle_class])
    if not unknown.any():
        return []
    light = np.sort(fitted.weight)[: (len(fitted.weight) + 1) // 2].mean()
    kinds = [LAYOUTS[HEAVIER[np.searchsorted(TIMES, one / light)]] for one in fitted.weight]
    along = np.array([kind.wheelbase**2 for kind in kinds]) * unknown
    across = np.array([kind.track**2 for kind in kinds]) * unknown
    return [Start((along, across, 0 * along), {})]


@effect(
    "wheel_layout",
    "load",
    [
        Parameter("wheelbase_squared", "m^2", 8.0, lower=0, upper=64, scope="pass"),
        Parameter("track_squared", "m^2", 2.5, lower=0, upper=6.5, scope="pass"),
        Parameter("front_heavy", "1", 0.05, lower=-0.3, upper=0.3, scope="pass"),
    ],
    physics="Vehicles stand on axles and wheels, not on a point: the load is spread along and across the lane.",
    plain=Plain("Wheels", "Vehicles press on axles about {size} apart, not on one point.", size=root, unit="m"),
    source="Superposition of Boussinesq loads; class means are makers' data sheets, see solver.load.wheel_layout.",
    confounders="pulse width, if there is one type of vehicle only",
    families=("blur",),
    base_part="wheels",
    starts=on_usual_wheels,
    order=-3,
)
def wheel_layout(load: Load, p: Values, survey: Surroundings) -> Load:
    """Point loads of vehicles without a class become three by three loads of the same second moments.

    The longer a vehicle, the more of it is on the rear axle (`share_in_front`); `front_heavy` is what more of it is on
    the front axle.
    """
    if load.position.shape[-2] > 1:
        unknown = (load.class_index == 0).double()[:, None]
    else:
        unknown = torch.ones_like(load.trajectory.time)
    forward, right = load.trajectory.heading, load.trajectory.right
    along, outer = spread(p["wheelbase_squared"] * unknown)
    across, side = spread(p["track_squared"] * unknown)
    steps = [(a, b) for a in (0, 1, -1) for b in (0, 1, -1)]
    moves = torch.stack([a * along[..., None] * forward + b * across[..., None] * right for a, b in steps], -2)

    front, more = share_in_front(2 * along), p["front_heavy"] * unknown
    by_axle = {0: 1 - outer, 1: front * outer + more, -1: (1 - front) * outer - more}
    by_side = {0: 1 - side, 1: side / 2, -1: side / 2}
    shares = torch.stack([by_axle[a] * by_side[b] for a, b in steps], -1)
    position = load.position[..., :, None, :] + moves[..., None, :, :]
    share = load.share[..., :, None] * shares[..., None, :]
    return replace(load, position=position.flatten(-3, -2), share=share.flatten(-2))


@effect(
    "front_share",
    "load",
    [Parameter("change", "1", 0.1, lower=-0.5, upper=0.5)],
    physics="More of the weight is on the front axle, in all vehicles, than their class says.",
    plain=Plain(
        "Front axles",
        "Front axles carry {size} more of the weight than told.",
        "Front axles carry {size} less of the weight than told.",
        percent,
        "%",
    ),
    source="Gillespie 1992, Fundamentals of Vehicle Dynamics, section 1.",
    confounders="other lags",
    families=("lag",),
    order=-4,
)
def front_share(load: Load, p: Values, survey: Surroundings) -> Load:
    """The middle of the load moves forward by its share of the distance between the axles."""
    if load.position.shape[-2] != 4:
        return replace(load, share=load.share + 0 * p["change"])
    return replace(load, share=load.share + p["change"] * torch.tensor([0.5, 0.5, -0.5, -0.5], dtype=torch.float64))


def on_many_axles(fitted: Fitted) -> list[Start]:
    """Half of the load of all vehicles that may be long on axles over 12 m, or all of it over 14 m.

    Where a fit has moved route and tracks to make up for them, a small share tells little. Of eight training surveys
    with lengths of 10 to 18 m every one was found from the one or the other.
    """
    heavy = np.array([CLASSES[class_number(name)] in HEAVY for name in fitted.vehicle_class], dtype=float)
    return [Start((share * heavy,), {"length": length}) for share, length in ((0.5, 12.0), (1.0, 14.0)) if heavy.any()]


@effect(
    "long_vehicle",
    "load",
    [
        Parameter("share", "1", 1.0, lower=0, upper=1, scope="pass"),
        Parameter("length", "m", 4.0, lower=6, upper=20, grid=(7.0, 9.0, 12.0, 16.0)),
    ],
    physics="Some vehicles carry their load on many axles over 6 to 18 m.",
    plain=Plain(
        "Long vehicles", "Long vehicles carry {size} of their load on axles over {length}.", size=percent, unit="%"
    ),
    source="EU Directive 96/53/EC, annex I: lengths and axles of lorries.",
    confounders="nothing where one pass differs from the others",
    starts=on_many_axles,
    order=-2,
)
def long_vehicle(load: Load, p: Values, survey: Surroundings) -> Load:
    """Five axles, evenly apart, carry a share of a heavy or unknown vehicle."""
    heavy = torch.tensor([name in HEAVY for name in CLASSES])[load.class_index]
    share = p["share"] * heavy[:, None].double()
    along = p["length"] * torch.linspace(-0.5, 0.5, 5, dtype=torch.float64)
    where = load.trajectory.position[..., None, :] + along[:, None] * load.trajectory.heading[..., None, :]
    share = share[..., None]
    return load.scaled(1 - share).joined(load.whole_at(where).scaled(share / 5))


@effect(
    "dynamic_load",
    "load",
    [
        Parameter("sine", "1", 0.15, lower=-0.8, upper=0.8, scope="pass"),
        Parameter("cosine", "1", 0.15, lower=-0.8, upper=0.8, scope="pass"),
        Parameter("frequency", "Hz", 0.2, lower=0.8, upper=4, grid=tuple(np.arange(1.2, 3.1, 0.15).round(2).tolist())),
    ],
    physics="The body bounces on its springs: F(t) = F0 (1 + A sin(2 pi f t + p)).",
    plain=Plain(
        "Bouncing vehicles", "Vehicles bounce at {frequency}, by about {size} of their weight.", size=percents, unit="%"
    ),
    source="Cebon 1999, Handbook of Vehicle-Road Interaction, chapter 4: 1.3 to 3 Hz.",
)
def dynamic_load(load: Load, p: Values, survey: Surroundings) -> Load:
    """Each vehicle bounces with a phase of its own, all at one frequency."""
    omega = 2 * torch.pi * p["frequency"]
    phase = omega * load.trajectory.since
    sine, cosine = torch.sin(phase), torch.cos(phase)
    factor = 1 + p["sine"] * sine + p["cosine"] * cosine
    return load.modulated(factor, omega * (p["sine"] * cosine - p["cosine"] * sine))


@effect(
    "road_bump",
    "load",
    [
        Parameter("first", "1", 0.25, lower=-0.9, upper=0.9),
        Parameter("place", "m", 1.0, grid=tuple(np.arange(-46.0, 46.1, 2.0).tolist())),
        Parameter("frequency", "Hz", 0.2, lower=1.0, upper=3.0, grid=(1.3, 1.6, 1.9, 2.3)),
        Parameter("damping", "1", 0.05, lower=0.03, upper=0.5, grid=(0.17,)),
    ],
    physics="A bump sets every vehicle swinging at the same place: a damped sine of the load.",
    plain=Plain(
        "Bump in the road",
        "A bump at x = {x} sets vehicles swinging by {size} of their weight.",
        size=percents,
        unit="%",
    ),
    source="Cebon 1999, chapter 5: spatial repeatability of dynamic loads.",
)
def road_bump(load: Load, p: Values, survey: Surroundings) -> Load:
    """The swing begins where the front axle meets the bump; place is from the middle of the view along x."""
    driven = load.trajectory
    beyond = (driven.position[..., 0] - survey.middle[0] - p["place"]) * driven.heading[..., 0].sign()
    time = driven.since_passing(beyond)
    after = torch.where(time > 0, time, torch.zeros_like(time))
    omega = 2 * torch.pi * p["frequency"]
    damping = p["damping"]
    decay = torch.exp(-damping * omega * after) * (time > 0)
    swing = decay * torch.sin(omega * after)
    rate = decay * omega * (torch.cos(omega * after) - damping * torch.sin(omega * after))
    return load.modulated(1 + p["first"] * swing, p["first"] * rate)


@effect(
    "braking",
    "load",
    [
        Parameter("deceleration", "g", 0.15, lower=-0.6, upper=0.8, scope="pass"),
        Parameter("place", "m", 2.0, grid=tuple(np.arange(-40.0, 40.1, 10.0).tolist())),
        Parameter("before", "m", 2.0, grid=(-15.0, 0.0, 15.0)),
        Parameter("length", "m", 20.0, lower=0, upper=100, grid=(0.0,)),
        Parameter("later", "s", 0.3, lower=-1.0, upper=3.0, grid=(0.0,)),
        Parameter("width", "s", 0.3, lower=0.2, upper=3.0, grid=(0.5,)),
    ],
    physics="A vehicle that brakes pushes the road ahead and loads its front axle, for some seconds.",
    plain=Plain("Braking", "Some vehicles brake or speed up by about {size} within the view.", size=absolute),
    source="Cerruti 1882; Johnson 1985, Contact Mechanics, section 3.6; Gillespie 1992, section 3.",
    confounders="an error of the track over the same seconds",
    order=1,
)
def braking(load: Load, p: Values, survey: Surroundings) -> Load:
    """Push over a stretch of road around so far before a place, either way; each vehicle brakes as hard as it does.

    It begins some time after passing the stretch's start and ends as long after passing its end, smoothly: over a
    stretch of no length it is a pulse in time.
    """
    driven = load.trajectory
    way = driven.heading[..., 0].sign()
    beyond = (driven.position[..., 0] - survey.middle[0] - p["place"]) * way + p["before"]
    begun, ended = (driven.since_passing(beyond + side * p["length"] / 2) - p["later"] for side in (1, -1))
    outside = (begun.clamp_max(0) + ended.clamp_min(0)) / p["width"]
    push = p["deceleration"] * torch.exp(-0.5 * outside**2)
    faster = -push * outside / p["width"]
    if load.position.shape[-2] == 4:
        # Height of the center of mass over the wheelbase of most vehicles: 0.6 m over 2.7 m.
        dip = 0.22 * torch.tensor([0.5, 0.5, -0.5, -0.5], dtype=torch.float64)
        rate = added(load.share_rate, faster[..., None] * dip)
        load = replace(load, share=load.share + push[..., None] * dip, share_rate=rate)
    return load.pushing(along=push, along_rate=faster)


@effect(
    "grade_drag",
    "load",
    [Parameter("share", "1", 0.04, lower=-0.3, upper=0.3)],
    physics="Driven wheels push the road backward against grade and drag.",
    plain=Plain(
        "Grade and drag",
        "Wheels push the road back with {size} of the weight.",
        "Wheels push the road forward with {size} of the weight.",
        percent,
        "%",
    ),
    source="Cerruti 1882; Johnson 1985, section 3.6.",
    confounders="a viscous ground, an AC-coupled interrogator",
    families=("even",),
    order=2,
)
def grade_drag(load: Load, p: Values, survey: Surroundings) -> Load:
    """A constant share of the weight pushes backward."""
    return load.pushing(along=-p["share"])


@effect(
    "camber",
    "load",
    [Parameter("share", "1", 0.02, lower=-0.2, upper=0.2)],
    physics="The road slopes to its side: a share of the weight pushes toward the driver's right.",
    plain=Plain(
        "Cross slope",
        "The load pushes to the driver's right with {size} of the weight.",
        "The load pushes to the driver's left with {size} of the weight.",
        percent,
        "%",
    ),
    source="Johnson 1985, section 3.6.",
    confounders="Poisson's ratio and depth, exactly",
    families=("depth",),
    order=2,
)
def camber(load: Load, p: Values, survey: Surroundings) -> Load:
    """A constant share of the weight pushes to the right."""
    return load.pushing(across=p["share"])


EFFECTS = (
    wheel_layout,
    front_share,
    long_vehicle,
    dynamic_load,
    road_bump,
    braking,
    grade_drag,
    camber,
)
