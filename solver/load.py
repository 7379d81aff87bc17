"""Load stage: a vehicle becomes the forces of its wheels on the road."""

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

#: Makers' data sheets of European vehicles; a class not listed here is a point load.
LAYOUTS = {
    "car": WheelLayout(2.65, 0.12, 1.55, 0.56, 0.02),
    "van": WheelLayout(3.40, 0.20, 1.70, 0.52, 0.02),
    "truck": WheelLayout(4.60, 0.40, 1.90, 0.42, 0.03),
    "bus": WheelLayout(5.90, 0.20, 2.05, 0.38, 0.02),
}


def layout_of(vehicle_class: str, wheelbase: tuple[float, float] | None = None) -> WheelLayout:
    """Return the class's wheel layout, or a point load for a class without one.

    Parameters
    ----------
    wheelbase : that of this vehicle and its standard deviation, m, where they are known better than the class's

    >>> layout_of("car").wheelbase, layout_of("vehicle").wheelbase
    (2.65, 0.0)
    >>> layout_of("car", (2.48, 0.06)).wheelbase
    2.48
    """
    layout = LAYOUTS.get(vehicle_class, POINT)
    if wheelbase is None or layout is POINT:
        return layout
    return replace(layout, wheelbase=wheelbase[0], wheelbase_sd=wheelbase[1])


#: All classes that have a number: `CLASSES[class_number(name)]` is the name, or "vehicle" for any other.
CLASSES = ("vehicle", *LAYOUTS)


def class_number(vehicle_class: str) -> int:
    """Number of a vehicle class; 0 for one without a layout.

    >>> class_number("car"), class_number("tram")
    (1, 0)
    """
    return CLASSES.index(vehicle_class) if vehicle_class in LAYOUTS else 0


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
