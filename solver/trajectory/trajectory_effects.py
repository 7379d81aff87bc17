"""Trajectory stage: clocks, and what is wrong with where the vehicles were said to be."""

from collections.abc import Mapping
from dataclasses import replace

import torch
from torch import Tensor

from solver.effect import Parameter, Plain, Surroundings, absolute, effect, percent
from solver.trajectory.trajectory import Trajectory

Values = Mapping[str, Tensor]

#: m/s; a vehicle that is slower keeps the heading of its track.
STANDING = 0.1


@effect(
    "clock_offset",
    "trajectory",
    [Parameter("offset", "s", 0.2, lower=-5, upper=5)],
    physics="The interrogator's clock is ahead of the trajectories' by the same time in all passes.",
    plain=Plain(
        "Clock offset",
        "The DAS clock is {size} ahead of the vehicles' clock.",
        "The DAS clock is {size} behind the vehicles' clock.",
    ),
    source="Video and DAS have clocks of their own; two speeds tell their offset from a shift of the fiber.",
    confounders="other lags: the vehicle's reference point, an averaging interval, a viscous ground",
    families=("lag",),
)
def clock_offset(driven: Trajectory, p: Values, survey: Surroundings) -> Trajectory:
    """At the interrogator's time t the vehicle is where the trajectories have it at t - offset."""
    return driven.shifted(along=-p["offset"] * driven.speed)


@effect(
    "clock_drift",
    "trajectory",
    [Parameter("rate", "1", 2e-3, lower=-0.05, upper=0.05), Parameter("offset", "s", 0.2, lower=-5, upper=5)],
    physics="One clock runs faster than the other, and is ahead of it by some time in the middle of the survey.",
    plain=Plain(
        "Clock drift", "The two clocks drift apart by {size} an hour.", size=lambda v, s: 3600 * abs(v), unit="s"
    ),
    source="Mills 1991, IEEE Trans. Commun. 39, 1482.",
    confounders="a stretched fiber, if all passes are equally fast",
    families=("lag",),
    corrects="rate",
)
def clock_drift(driven: Trajectory, p: Values, survey: Surroundings) -> Trajectory:
    """An offset that grows with time: clocks that drift apart agree in the middle of a survey by chance alone."""
    middle = (driven.time.min() + driven.time.max()) / 2
    return driven.shifted(along=-(p["offset"] + p["rate"] * (driven.time - middle)) * driven.speed)


@effect(
    "track_bias",
    "trajectory",
    [Parameter("ahead", "m", 1.0, lower=-5, upper=5)],
    physics="The tracked point is a constant distance ahead of the middle of the load, or behind it.",
    plain=Plain(
        "Tracked point",
        "Vehicles are {size} farther ahead than tracks say.",
        "Vehicles are {size} farther back than tracks say.",
    ),
    source="Box centers against contact points: Rezaei et al. 2021, arXiv:2109.06783, section III.",
    confounders="other lags; opposite directions and speeds separate them",
    families=("lag",),
)
def track_bias(driven: Trajectory, p: Values, survey: Surroundings) -> Trajectory:
    """All vehicles are farther ahead, as they drive."""
    return driven.shifted(along=p["ahead"])


@effect(
    "track_offset",
    "trajectory",
    [Parameter("x", "m", 0.5, lower=-10, upper=10), Parameter("y", "m", 0.5, lower=-10, upper=10)],
    physics="All tracks are shifted as a whole.",
    plain=Plain("Shifted tracks", "All tracks are shifted by about {size} as a whole.", size=absolute),
    source="Rigid motion; the route moves along with the tracks, so that anchors alone can tell.",
    confounders="the route itself; only anchors tell",
    families=("rigid",),
)
def track_offset(driven: Trajectory, p: Values, survey: Surroundings) -> Trajectory:
    """All vehicles are displaced by (x, y)."""
    return replace(driven, position=driven.position + torch.stack([p["x"], p["y"]]))


@effect(
    "track_rotation",
    "trajectory",
    [Parameter("angle", "degree", 1.0, lower=-20, upper=20)],
    physics="All tracks are turned about the middle of the view.",
    plain=Plain(
        "Turned tracks", "All tracks are turned by {size} about the middle of the view.", size=absolute, unit="degrees"
    ),
    source="Rigid motion; the route turns along with the tracks, so that anchors alone can tell.",
    confounders="the route itself; only anchors tell",
    families=("rigid",),
)
def track_rotation(driven: Trajectory, p: Values, survey: Surroundings) -> Trajectory:
    """All vehicles turned clockwise seen from above (from x toward y)."""
    angle = torch.deg2rad(p["angle"])
    cosine, sine = torch.cos(angle), torch.sin(angle)

    def turned(v: Tensor) -> Tensor:
        x, y = v.unbind(-1)
        return torch.stack([cosine * x - sine * y, sine * x + cosine * y], -1)

    position = survey.middle + turned(driven.position - survey.middle)
    return replace(driven, position=position, velocity=turned(driven.velocity), heading=turned(driven.heading))


@effect(
    "track_scale",
    "trajectory",
    [Parameter("scale", "1", 0.02, lower=-0.3, upper=0.3)],
    physics="Lengths in the tracks are too short or too long.",
    plain=Plain(
        "Scale of the tracks",
        "Lengths in the tracks are {size} too short.",
        "Lengths in the tracks are {size} too long.",
        percent,
        "%",
    ),
    source="Similarity; a known length in the scene, or anchors, decide.",
    confounders="the route itself and the channel spacing; only anchors tell",
    families=("rigid", "curve"),
)
def track_scale(driven: Trajectory, p: Values, survey: Surroundings) -> Trajectory:
    """Distances from the middle of the view are longer by the scale."""
    position = survey.middle + (1 + p["scale"]) * (driven.position - survey.middle)
    return replace(driven, position=position, velocity=(1 + p["scale"]) * driven.velocity)


@effect(
    "track_bend",
    "trajectory",
    [Parameter("y", "m", 0.4, scope="road", rated=True)],
    physics="The ground is not flat or the lens not straight: the lateral error depends on the place alone.",
    plain=Plain("Bent tracks", "Tracks are off sideways by about {size}, depending on the place.", size=absolute),
    source="Hartley and Zisserman 2004, section 7.4: distortion left in a homography.",
    confounders="the route and the channels' positions",
    families=("place", "curve"),
)
def track_bend(driven: Trajectory, p: Values, survey: Surroundings) -> Trajectory:
    """The lateral position changes smoothly with x, alike for all vehicles, and with it the way they drive."""
    moved, faster = (torch.stack([torch.zeros_like(y), y], -1) for y in (p["y"], p["y_rate"]))
    velocity = driven.velocity + faster
    heading = driven.heading + faster / driven.speed.clamp_min(STANDING)[..., None]
    heading = heading / heading.norm(dim=-1, keepdim=True)
    return replace(driven, position=driven.position + moved, velocity=velocity, heading=heading)


@effect(
    "track_jitter",
    "trajectory",
    [Parameter("along", "m", 0.3, scope="track"), Parameter("across", "m", 0.3, scope="track")],
    physics="Each track has an error of its own that lasts for seconds.",
    plain=Plain("Wandering tracks", "Each track wanders off by about {size} for some seconds.", size=absolute),
    source="Correlated errors of detections: Bar-Shalom, Li and Kirubarajan 2001, section 8.",
    confounders="the route, if there is one pass only",
    slow_error=True,
)
def track_jitter(driven: Trajectory, p: Values, survey: Surroundings) -> Trajectory:
    """Each vehicle's position departs smoothly from its track."""
    return driven.shifted(along=p["along"], across=p["across"])


#: What the base model fits of tracks from one camera.
COMMON_ERRORS = (track_offset, track_rotation, track_scale)
#: What the base model fits of tracks that are uncertain.
SLOW_ERROR = track_jitter
#: What `roadfiber clock` estimates.
CLOCK = clock_offset

EFFECTS = (
    clock_offset,
    clock_drift,
    track_bias,
    track_offset,
    track_rotation,
    track_scale,
    track_bend,
    track_jitter,
)
