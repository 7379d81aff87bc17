"""What an effect may know of the survey: while it acts, where a fit without it ended, and of the record itself."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import Tensor


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
class Heard:
    """What a fit leaves unexplained, and what it was recorded from.

    Parameters
    ----------
    residual : [sample, channel], in units of the noise; 0 where not measured
    load : `solver.load.load.Load` of the model that was fitted; its trajectory's time is in s
    sample_index : [row], which sample
    middle, slope : [channel, 3], places of the gauges, m, and the fiber's direction there
    """

    residual: Tensor
    load: Any
    sample_index: Tensor
    middle: Tensor
    slope: Tensor


#: Shapes worth trying, and how many they were chosen from.
Proposal = tuple[list[dict[str, float]], int]


@dataclass(frozen=True)
class Fitted:
    """What is known of a survey where a fit without an effect ended.

    Parameters
    ----------
    distance : [channel], of the fitted channels along the fiber, m
    vehicle_class : [pass]
    weight : [pass], how heavy each vehicle came out, in the same unit for all
    route : [channel, 3], where the channels came out, m
    coil : `solver.cable.fiber.Coil` that the matched filter saw; None where it saw none
    """

    distance: NDArray[np.float64]
    vehicle_class: tuple[str, ...]
    weight: NDArray[np.float64]
    route: NDArray[np.float64]
    coil: Any


@dataclass(frozen=True)
class Start:
    """Where a fit with an effect may start besides where the fit without it ended; Poisson's ratio is as expected.

    Parameters
    ----------
    numbers : of each amplitude, [number] each
    shape : values of the shape parameters
    route : distance along the fiber [place], m -> [place, 3], m; vehicles are as heavy as fits it. None: route and
        vehicles are as they were fitted
    """

    numbers: tuple[NDArray[np.float64], ...]
    shape: Mapping[str, float]
    route: Callable[[NDArray[np.float64]], NDArray[np.float64]] | None = None


@dataclass(frozen=True)
class Recorded:
    """A record, for effects that leave a trace in its noise or in its very values.

    Parameters
    ----------
    values : [sample, channel], in units of the noise; NaN where not measured
    still : [sample, channel], no vehicle near
    sampling_rate : Hz
    channel_spacing : m
    """

    values: NDArray[np.float64]
    still: NDArray[np.bool_]
    sampling_rate: float
    channel_spacing: float
