"""Cable stage: how the fiber lies in its duct and follows the ground."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import softplus

from solver.cable.cable import Cable, Loose
from solver.cable.fiber import between_channels
from solver.cable.points import Points
from solver.effect import Fitted, Parameter, Plain, Start, Surroundings, absolute, effect, grown, percent, root

Values = Mapping[str, Tensor]

#: Least share of its length over which a gauge reaches.
SHORTEST = 0.02
#: Least detour, m, for which a coil may stand: half of a plausible one.
DETOUR = 2.5


@effect(
    "channel_coupling",
    "cable",
    [Parameter("log_gain", "1", 0.3, lower=-3, upper=3, scope="fiber")],
    physics="The cable grips the ground better at some places than at others.",
    plain=Plain(
        "Uneven coupling",
        "The cable grips the ground unevenly, by about {size} from place to place.",
        size=grown,
        unit="%",
    ),
    source="Reinsch et al. 2017, Geophys. J. Int. 210, 1017.",
    confounders="stiffness of the ground that changes along it",
    families=("gain",),
)
def channel_coupling(cable: Cable, p: Values, survey: Surroundings) -> Cable:
    """Gain exp(log_gain) of the strain at points, smooth along the fiber."""
    points = Points.of(survey)
    gain = torch.expm1(between_channels(p["log_gain"], survey.distance, points.place))
    return cable.mixed(torch.eye(len(survey.distance), dtype=gain.dtype) + points.read * gain @ points.told)


@effect(
    "shear_lag",
    "cable",
    [Parameter("length_squared", "m^2", 2.0, lower=0, upper=25)],
    physics="The jacket passes strain on over a length L: 1 / (1 + k^2 L^2).",
    plain=Plain("Soft jacket", "The cable's jacket blurs strain over a length of {size}.", size=root, unit="m"),
    source="Ansari and Libo 1998, J. Eng. Mech. 124, 385.",
    confounders="pulse width",
    families=("blur",),
)
def shear_lag(cable: Cable, p: Values, survey: Surroundings) -> Cable:
    """Strain transfer of an elastic jacket."""
    return cable.filtered(lambda k: 1 / (1 + k**2 * p["length_squared"]))


@effect(
    "conduit_slip",
    "cable",
    [
        Parameter("share", "1", 1.0, lower=0, upper=1.5),
        Parameter("place", "m", 1.0, grid=tuple(np.arange(-45.0, 45.1, 6.0).tolist())),
        Parameter("length", "m", 2.0, lower=4, upper=60, grid=(8.0, 13.0, 20.0, 35.0)),
    ],
    physics="The fiber slips in its conduit and senses only the mean strain between the points that hold it.",
    plain=Plain(
        "Slipping fiber", "About {along} along the fiber, {length} of it slip in the conduit.", size=percent, unit="%"
    ),
    source="Equilibrium: where nothing grips it, the tension of a fiber, and so its strain, is the same all along.",
)
def conduit_slip(cable: Cable, p: Values, survey: Surroundings) -> Cable:
    """The free length shows its mean strain; place is from the middle of the channels, along the fiber."""
    s, half = survey.distance, p["length"] / 2
    center = (s.min() + s.max()) / 2 + p["place"]
    return replace(cable, loose=Loose(center - half, center + half, p["share"]))


def coiled(fitted: Fitted) -> list[Start]:
    """Coils where the matched filter saw one, and in place of a detour: fits without one end too far off to find it."""
    found = [] if fitted.coil is None else [(fitted.coil.place, fitted.coil.length, fitted.coil.route)]
    found += without_detour(fitted.distance, fitted.route)
    middle = (fitted.distance[0] + fitted.distance[-1]) / 2
    return [Start((np.array([length]),), {"place": place - middle}, route) for place, length, route in found]


def without_detour(
    distance: NDArray[np.float64], route: NDArray[np.float64]
) -> list[tuple[float, float, Callable[[NDArray[np.float64]], NDArray[np.float64]]]]:
    """A coil as long as what a route is longer than the straight way between its ends; none of less than `DETOUR`.

    Channels are as far apart along a route as fiber is. Where some lies coiled, and the model has no coil, the route
    swings aside and comes back, and is as much longer.

    Parameters
    ----------
    distance : [channel], along the fiber, m
    route : [channel, 3], m

    Returns
    -------
    place and length of the coil, m, and the straight route as of `Start`

    >>> s = np.arange(0.0, 61.0)
    >>> turn = np.where((s >= 20) & (s < 40), np.where(s < 30, 1.0, -1.0), 0.0)
    >>> route = np.cumsum(np.stack([np.cos(turn), np.sin(turn), 0 * turn], 1), 0)
    >>> [(place, length, _)] = without_detour(s, route)
    >>> place, round(length)
    (29.0, 9)
    """
    way = float(np.linalg.norm(route[-1] - route[0]))
    length = float(distance[-1] - distance[0]) - way
    if length < DETOUR:
        return []
    ahead = (route[-1] - route[0]) / way
    late = distance - distance[0] - (route - route[0]) @ ahead
    place = float(distance[(late >= length / 2).argmax()])

    def straight(at: NDArray[np.float64]) -> NDArray[np.float64]:
        # Half of the coil counts on either side of its middle.
        return route[0] + (at - length / 2 - distance[0])[:, None] * ahead

    return [(place, length, straight)]


@effect(
    "slack_spool",
    "cable",
    [
        Parameter("length", "m", 5.0, lower=-1, upper=60),
        Parameter("place", "m", 1.0, grid=tuple(np.arange(-45.0, 45.1, 5.0).tolist())),
    ],
    physics="Fiber lies coiled in a manhole: all channels beyond it are nearer than they count.",
    plain=Plain("Coil of slack", "About {along} along the fiber, {size} of it lie coiled.", size=absolute),
    source="ITU-T L.1430: slack storage at closures.",
    confounders="smooth errors of the channels' positions",
    families=("place",),
    starts=coiled,
)
def slack_spool(cable: Cable, p: Values, survey: Surroundings) -> Cable:
    """Gauges end where the fiber leads, which stands still over the coil; what lies coiled senses nothing.

    Half of the length counts on either side, which leaves the middle of the route where it was.
    """
    s, half, soft = survey.distance, survey.gauge_length / 2, survey.channel_spacing / 5
    begins = (s.min() + s.max()) / 2 + p["place"] - p["length"] / 2

    def led(place: Tensor) -> Tensor:
        coiled = softplus((place - begins) / soft) - softplus((place - begins - p["length"]) / soft)
        return place - soft * coiled + p["length"] / 2

    ahead, behind = led(s + half), led(s - half)
    # Never quite nothing: derivatives divide by it.
    reach = ((ahead - behind) / survey.gauge_length).clamp_min(1e-9)
    slack = (1 + cable.slack) * reach.clamp_min(SHORTEST) - 1
    halfway = (ahead + behind) / 2
    middle = cable.middle + led(s) - halfway
    return replace(cable, shift=cable.shift + halfway - s, slack=slack, middle=middle, gain=cable.gain * reach)


@effect(
    "sloping_fiber",
    "cable",
    [Parameter("vertical_share", "1", 0.5, null=1.0, lower=0, upper=2)],
    physics="Where the fiber slopes, vertical motion stretches it too; a loose cable follows that less.",
    plain=Plain(
        "Vertical motion", "Where the fiber slopes it follows {size} of the vertical motion.", size=percent, unit="%"
    ),
    source="Displacement projected on the tangent, all three components: t . u.",
)
def sloping_fiber(cable: Cable, p: Values, survey: Surroundings) -> Cable:
    """The fiber follows this share of the ground's vertical motion."""
    return replace(cable, vertical=p["vertical_share"])


@effect(
    "curved_gauge",
    "cable",
    [Parameter("share", "1", 1.0, lower=0, upper=1.5)],
    physics="Within a gauge the fiber turns: strain is the integral along the path, not the motion of its two ends.",
    plain=Plain(
        "Bends within a gauge", "The fiber bends within a gauge, and that counts by {size}.", size=percent, unit="%"
    ),
    source="Integration by parts of t . grad u . t along the fiber.",
    base_part="bends",
)
def curved_gauge(cable: Cable, p: Values, survey: Surroundings) -> Cable:
    """1 is the full path integral."""
    return replace(cable, path_integral=p["share"])


@effect(
    "channel_stretch",
    "cable",
    [
        Parameter("stretch", "1", 0.01, lower=-0.1, upper=0.1),
        Parameter("stretched", "1", 1.0, lower=0, upper=1, grid=(0.0, 1.0)),
    ],
    physics="Channels lie farther apart than the file says: refractive index, helix, overstuffed fiber.",
    plain=Plain(
        "Channel spacing",
        "Channels lie {size} apart along the cable, not {told}.",
        size=lambda v, s: s.channel_spacing * (1 + v),
        unit="m",
    ),
    source="Lindsey et al. 2020, JGR Solid Earth 125.",
    confounders="the route and the clock's rate; only anchors tell",
    families=("rigid",),
    corrects="spacing",
)
def channel_stretch(cable: Cable, p: Values, survey: Surroundings) -> Cable:
    """Distance along the fiber grows by the stretch, about the middle; where light counts wrong, so do gauges."""
    middle = (survey.distance.min() + survey.distance.max()) / 2
    slack = cable.slack + p["stretched"] * p["stretch"]
    return replace(cable, shift=cable.shift + p["stretch"] * (survey.distance - middle), slack=slack)


@effect(
    "channel_wander",
    "cable",
    [
        Parameter("shift", "m", 0.5, scope="fiber"),
        Parameter("stretched", "1", 1.0, lower=0, upper=1, grid=(0.0, 1.0)),
    ],
    physics="Channels lie off their place along the fiber by a smooth amount: slack, snaking, index.",
    plain=Plain("Misplaced channels", "Channels lie off their place along the fiber by about {size}.", size=absolute),
    source="Piana Agostinetti et al. 2022, Solid Earth 13, 449.",
    confounders="the route",
    families=("place",),
)
def channel_wander(cable: Cable, p: Values, survey: Surroundings) -> Cable:
    """Channel positions depart smoothly from their count; where that is slack fiber, gauges reach less far as well."""
    slack = p["stretched"] * slope(p["shift"], survey.distance)
    return replace(cable, shift=cable.shift + p["shift"], slack=slack)


def slope(values: Tensor, distance: Tensor) -> Tensor:
    """Derivative of values [channel] by distance [channel], from neighbors on either side; constant to the ends.

    >>> slope(torch.tensor([0.0, 1.0, 4.0, 9.0]), torch.arange(4.0)).tolist()
    [2.0, 2.0, 4.0, 4.0]
    """
    inner = (values[2:] - values[:-2]) / (distance[2:] - distance[:-2])
    return torch.cat([inner[:1], inner, inner[-1:]])


EFFECTS = (
    channel_coupling,
    shear_lag,
    conduit_slip,
    slack_spool,
    sloping_fiber,
    curved_gauge,
    channel_stretch,
    channel_wander,
)
