"""Where a fiber can be that sees a vehicle this wide: circles about the vehicle's place."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.start.coupling_curve import CouplingCurve, coupling_curve
from solver.start.detections import Detections
from solver.start.lateral import SHAPE_ERROR, relative_scale_error

Array = NDArray[np.float64]

SLOPE_STEP = 0.05  # share of a width over which the inverted curve is differenced


@dataclass(frozen=True)
class Circles:
    """Circular loci seen from above: |r(s_c) - v_c| = R_c for the channel c that a vehicle at v_c is beside.

    Parameters
    ----------
    channel : with a fraction [circle]
    center : of the vehicle [circle, 2], m
    radius : lateral offset that the width of the response tells [circle], m
    sigma : its standard deviation [circle], m
    """

    channel: Array
    center: Array
    radius: Array
    sigma: Array

    def __len__(self) -> int:
        return len(self.channel)


def circles_of(
    detections: Sequence[Detections], curves: Sequence[CouplingCurve], channel_spacing: float, lag: float = 0.0
) -> Circles:
    """Turn the widths that the matched filter saw into circles, by the inverted coupling curve.

    R = sigma^-1(w; Z),  sd of R = dR/dw sd of w; a width that tells nothing (the fiber is nearly under the wheels)
    gives half the smallest offset that can be told, and as much for its standard deviation.

    Parameters
    ----------
    detections : of each pass
    curves : coupling curve of each pass, for the prior mean depth
    channel_spacing : m
    lag : how far the clock of the trajectories is ahead of the DAS's, s

    Examples
    --------
    >>> curve = coupling_curve("car", depth=0.9, gauge_length=10.0, poisson_ratio=0.25)
    >>> width = curve.width_at(np.array([5.0, 7.0]))
    >>> x, zero = np.array([10.0, 20.0]), np.zeros(2)
    >>> seen = Detections(zero.astype(int), x, zero, zero + 12.0, x, width, zero + 20.0, np.zeros((2, 3)))
    >>> circles_of([seen], [curve], 1.0).radius.round(3).tolist()
    [5.0, 7.0]
    """
    relative = relative_scale_error()
    parts = []
    for seen, curve in zip(detections, curves, strict=True):
        width = seen.scale * channel_spacing
        spread = width * np.hypot(SHAPE_ERROR, relative / 10 ** (seen.snr_db / 20))
        step = SLOPE_STEP * width
        slope = (curve.offset_of(width + step) - curve.offset_of(width - step)) / (2 * step)
        radius, sigma = curve.offset_of(width), slope * spread
        mute = radius <= curve.nearest
        radius, sigma = np.where(mute, curve.nearest / 2, radius), np.where(mute, curve.nearest / 2, sigma)
        center = np.column_stack([seen.x + lag * seen.speed, seen.y])
        parts.append((seen.channel, center, radius, np.maximum(sigma, 1e-3)))
    return Circles(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def equal_width_locus(
    width: float, vehicle_class: str, depth: Array, *, gauge_length: float = 10.0, poisson_ratio: float = 0.25
) -> Array:
    """Offsets that one width allows at each depth: the locus sigma(Y; Z) = w in the cross-section.

    A deeper fiber sees the vehicle wider, so the same width puts it nearer, until no offset is left.

    Parameters
    ----------
    width : scale of the response, m
    vehicle_class : its wheel layout is taken; an unknown class is a point load
    depth : [depth], m
    gauge_length : m
    poisson_ratio : of the ground

    Returns
    -------
    offset [depth], m; NaN where the width tells nothing, or where no offset at that depth gives it

    Examples
    --------
    >>> equal_width_locus(8.0, "vehicle", np.array([0.5, 1.0, 1.5])).round(2).tolist()
    [8.27, 7.28, nan]
    """
    curves = [
        coupling_curve(vehicle_class, depth=float(z), gauge_length=gauge_length, poisson_ratio=poisson_ratio)
        for z in depth
    ]
    told = [curve.width[0] < width < curve.width[-1] for curve in curves]
    return np.where(told, [float(curve.offset_of(width)) for curve in curves], np.nan)
