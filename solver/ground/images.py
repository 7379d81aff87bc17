"""Hankel transforms by images: a kernel in wavenumber as a sum of exponentials, each a point source in closed form.

int exp(-k b) J0(k r) dk = 1 / R and int exp(-k b) J1(k r) dk = r / (R (R + b)), R^2 = r^2 + b^2. The kernels of layered
ground are smooth in log k, so that some forty images at depths b in geometric progression fit them to 1e-6: no
oscillating integrand, no truncation, and right from the near field to the far.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
import torch
from torch import Tensor

#: Decades of wavenumber, beyond 1 / b of the outermost images, in which the kernel is sampled.
SHALLOW, DEEP = 30.0, 0.1
#: Singular values of the fit below this share of the largest are noise.
RANK = 1e-13


@dataclass(frozen=True)
class Images:
    """Transforms of kernels at `wavenumber` to equal steps of t = ln(1 + r^2) / 2; lengths in a unit of one's own.

    Parameters
    ----------
    wavenumber : [k]
    step : of t between nodes
    vertical, vertical_slope : [node, k], to int W J0 dk and its derivative by t
    radial, radial_slope : [node, k], to int V J1 dk / r and its derivative by t
    """

    wavenumber: Tensor
    step: float
    vertical: Tensor
    vertical_slope: Tensor
    radial: Tensor
    radial_slope: Tensor


@cache
def images(nearest: float, farthest: float, count: int, reach: float, step: float, samples: int = 160) -> Images:
    """Transforms by `count` images at depths from `nearest` to `farthest`, for distances up to `reach`.

    Parameters
    ----------
    nearest, farthest : the kernel falls at least like exp(-nearest k) and varies over no less than 1 / farthest
    count : number of images
    reach : largest r
    step : of t = ln(1 + r^2) / 2 between nodes
    samples : number of wavenumbers

    >>> h = images(0.5, 100.0, 30, 20.0, 0.2)
    >>> kernel = torch.exp(-h.wavenumber * 3)
    >>> r2 = torch.expm1(2 * h.step * torch.arange(len(h.vertical), dtype=torch.float64))
    >>> bool(torch.allclose(h.vertical @ kernel, (r2 + 9).rsqrt(), atol=1e-7))
    True
    """
    depth = np.geomspace(nearest, farthest, count)
    wavenumber = np.geomspace(DEEP / farthest, SHALLOW / nearest, samples)
    # Errors count by what they add to the integral over k: log-spaced samples weigh like k.
    fit = np.linalg.pinv(wavenumber[:, None] * np.exp(-np.outer(wavenumber, depth)), rcond=RANK) * wavenumber
    t = step * np.arange(np.ceil(np.log1p(reach**2) / 2 / step) + 1)
    grown = np.exp(2 * t)[:, None]
    big = np.sqrt(np.expm1(2 * t)[:, None] + depth**2)
    # dR/dt = e^2t / R, because r^2 = e^2t - 1.
    closed = (
        1 / big,
        -grown / big**3,
        1 / (big * (big + depth)),
        -grown * (2 * big + depth) / (big**3 * (big + depth) ** 2),
    )
    return Images(torch.from_numpy(wavenumber), step, *(torch.from_numpy(c @ fit) for c in closed))
