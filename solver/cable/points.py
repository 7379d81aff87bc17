"""Strain at points of the fiber from that of gauges, for effects on a fiber that gauges average only afterwards."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch
from torch import Tensor

from solver.effect import Surroundings

#: Distance between points, m, at most, and over which the ground's strain is alike.
STEP, ALIKE = 0.25, 2.5
#: Variance of what the strain at points may be beside, of that of the channels.
NUGGET = 1e-6


@dataclass(frozen=True)
class Points:
    """Points along the fiber between its channels.

    Parameters
    ----------
    place : [point], along the fiber, m
    step : distance between them, m
    read : [channel, point], what gauges make of strain at points
    told : [point, channel], best linear estimate of strain at points from that of gauges
    """

    place: Tensor
    step: float
    read: Tensor
    told: Tensor

    @classmethod
    def of(cls, survey: Surroundings) -> "Points":
        """Points of a survey's fiber.

        >>> distance = torch.arange(40, dtype=torch.float64)
        >>> points = Points.of(Surroundings(distance, 40, 10.0, 1.0, 10.0, 1, torch.zeros(2), 1.0))
        >>> bump = 1 / (1 + ((points.place - 20) / 5) ** 2)
        >>> bool((points.told @ (points.read @ bump) - bump).abs().max() < 0.03)
        True
        """
        distance = tuple(survey.distance.tolist())
        return between(distance, survey.gauge_length, min(STEP, survey.channel_spacing))


@lru_cache(maxsize=4)
def between(distance: tuple[float, ...], gauge_length: float, step: float) -> Points:
    """Points from the first gauge's begin to the last one's end.

    Best linear prediction (simple kriging: Cressie 1993, Statistics for Spatial Data, section 3.2) of strain whose
    covariance is Matern's of order 3/2: wavelengths that a gauge averages out are filled in as smooth as the ground's.
    """
    s = np.array(distance)
    place = np.arange(s.min() - gauge_length / 2 + step / 2, s.max() + gauge_length / 2, step)
    read = np.clip((gauge_length / 2 - np.abs(s[:, None] - place)) / step + 0.5, 0, 1) * step / gauge_length
    apart = np.abs(place[:, None] - place) / ALIKE
    with_points = read @ ((1 + apart) * np.exp(-apart))
    own = with_points @ read.T
    own += NUGGET * np.trace(own) / len(own) * np.eye(len(own))
    told = np.linalg.solve(own, with_points).T
    return Points(torch.from_numpy(place), step, torch.from_numpy(read), torch.from_numpy(told))
