"""Load stage: a vehicle becomes the forces of its wheels on the road."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor


@dataclass(frozen=True)
class WheelLayout:
    """Where a class of vehicle puts its weight: means and standard deviations over the class.

    Parameters
    ----------
    wheelbase, wheelbase_sd : distance between the axles, m
    track : distance between left and right wheels, m
    front_share, front_share_sd : share of the load on the front axle
    """

    wheelbase: float
    wheelbase_sd: float
    track: float
    front_share: float
    front_share_sd: float


POINT = WheelLayout(0.0, 0.0, 0.0, 0.5, 0.0)

#: Classes without wheels to speak of: what is only known to be a vehicle, and who walks.
POINTS = ("vehicle", "person")

#: Makers' data sheets of European vehicles; `unknown` holds the wheels of any, from a tuk-tuk to a bus.
LAYOUTS = {
    "car": WheelLayout(2.65, 0.12, 1.55, 0.56, 0.02),
    "van": WheelLayout(3.40, 0.20, 1.70, 0.52, 0.02),
    "truck": WheelLayout(4.60, 0.40, 1.90, 0.42, 0.03),
    "bus": WheelLayout(5.90, 0.20, 2.05, 0.38, 0.02),
    "motorcycle": WheelLayout(1.40, 0.10, 0.0, 0.48, 0.03),
    "bicycle": WheelLayout(1.05, 0.05, 0.0, 0.42, 0.03),
    "unknown": WheelLayout(3.20, 1.20, 1.60, 0.50, 0.08),
}


def layout_of(vehicle_class: str, wheelbase: tuple[float, float] | None = None) -> WheelLayout:
    """Return the class's wheel layout: a point load for those of `POINTS`, `unknown` for a class that is not known.

    Parameters
    ----------
    wheelbase : that of this vehicle and its standard deviation, m, where they are known better than the class's

    >>> layout_of("car").wheelbase, layout_of("vehicle").wheelbase
    (2.65, 0.0)
    >>> layout_of("tuk-tuk") is LAYOUTS["unknown"]
    True
    >>> layout_of("car", (2.48, 0.06)).wheelbase
    2.48
    """
    layout = POINT if vehicle_class in POINTS else LAYOUTS.get(vehicle_class, LAYOUTS["unknown"])
    if wheelbase is None or vehicle_class in POINTS:
        return layout
    return replace(layout, wheelbase=wheelbase[0], wheelbase_sd=wheelbase[1])


#: All classes that have a number: `CLASSES[class_number(name)]` is the name, "vehicle" for a point load, or "unknown".
CLASSES = ("vehicle", *LAYOUTS)


def class_number(vehicle_class: str) -> int:
    """Number of a vehicle class; 0 for a point load.

    >>> class_number("car"), class_number("person"), CLASSES[class_number("tram")]
    (1, 0, 'unknown')
    """
    if vehicle_class in POINTS:
        return 0
    return CLASSES.index(vehicle_class if vehicle_class in LAYOUTS else "unknown")


def not_known(vehicle_classes: Sequence[str]) -> list[str]:
    """What a user should read of the classes [pass] that are not known; nothing where all are.

    >>> not_known(["car", "tuk-tuk", "vehicle", "tuk-tuk"])[0].partition(";")[0]
    'class tuk-tuk (2 passes) is not known'
    """
    strange = Counter(name for name in vehicle_classes if name not in LAYOUTS and name not in POINTS)
    known = ", ".join([*LAYOUTS, *POINTS])
    return [
        f"class {name} ({count} pass{'es' * (count > 1)}) is not known; its wheels may be anything from a tuk-tuk's to "
        f"a bus's, and are fitted. Known are {known}"
        for name, count in strange.items()
    ]


def wheel_loads(
    position: Tensor, heading: Tensor, wheelbase: Tensor, track: Tensor, front_share: Tensor
) -> tuple[Tensor, Tensor]:
    """Four wheel loads of unit total weight.

    Parameters
    ----------
    position : [..., 2], ground point under the middle of the wheelbase (x, y), m
    heading : [..., 2], unit vector along travel
    wheelbase, track : [...], m
    front_share : [...], share of the load on the front axle

    Returns
    -------
    wheels : [..., 4, 2], positions front left, front right, rear left, rear right, m
    weights : [..., 4], shares that sum to 1

    >>> one = torch.ones((), dtype=torch.float64)
    >>> wheels, weights = wheel_loads(
    ...     torch.zeros(2, dtype=torch.float64), torch.tensor([1.0, 0.0], dtype=torch.float64), 2 * one, one, 0.6 * one)
    >>> wheels.tolist()
    [[1.0, -0.5], [1.0, 0.5], [-1.0, -0.5], [-1.0, 0.5]]
    >>> [round(w, 2) for w in weights.tolist()]
    [0.3, 0.3, 0.2, 0.2]
    """
    # y points right of +x seen from above, so (-heading_y, heading_x) points to the driver's right.
    right = torch.stack([-heading[..., 1], heading[..., 0]], -1)
    along = 0.5 * wheelbase[..., None] * heading
    across = 0.5 * track[..., None] * right
    wheels = torch.stack(
        [
            position + along - across,
            position + along + across,
            position - along - across,
            position - along + across,
        ],
        -2,
    )
    front, rear = 0.5 * front_share, 0.5 * (1 - front_share)
    return wheels, torch.stack([front, front, rear, rear], -1)
