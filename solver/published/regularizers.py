"""The paper's regularizers: what makes a polyline a cable. Differentiable sums of squares over a route's nodes.

A route is nodes [node, 2 or 3], m, evenly spaced by the fiber's length. Divide each sum by its variance to weigh it.
"""

from dataclasses import dataclass

import torch
from torch import Tensor


def directions(route: Tensor) -> Tensor:
    """Unit vectors [node - 1, axis] from node to node.

    >>> directions(torch.tensor([[0.0, 0.0], [3.0, 4.0]])).tolist()
    [[0.6000000238418579, 0.800000011920929]]
    """
    return torch.nn.functional.normalize(route.diff(dim=0), dim=-1)


def angle_loss(route: Tensor) -> Tensor:
    """Turn between neighboring segments: sum of 2 (1 - cos theta_i), which is theta_i^2 where they are small, rad^2.

    >>> corner = torch.tensor([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    >>> angle_loss(corner).item()
    2.0
    """
    direction = directions(route)
    return (2 * (1 - (direction[1:] * direction[:-1]).sum(-1))).sum()


def length_loss(route: Tensor, spacing: float) -> Tensor:
    """Stretch of each segment: sum of (|r_{i+1} - r_i| / spacing - 1)^2.

    Parameters
    ----------
    spacing : length of fiber from node to node, m

    >>> stretched = torch.tensor([[0.0, 0.0], [11.0, 0.0], [20.0, 0.0]])  # 10 % long, 10 % short
    >>> round(length_loss(stretched, 10.0).item(), 4)
    0.02
    """
    return ((route.diff(dim=0).norm(dim=-1) / spacing - 1) ** 2).sum()


def curvature_loss(route: Tensor, spacing: float, axes: slice = slice(None)) -> Tensor:
    """Curvature at the inner nodes: sum of |t_{i+1} - t_i|^2 / spacing^2, 1/m^2, with t the unit directions.

    Parameters
    ----------
    spacing : length of fiber from node to node, m
    axes : slice(0, 2) for bends seen from above, slice(2, 3) for the fiber's dips

    >>> angle = torch.linspace(0, 1, 101, dtype=torch.float64)
    >>> circle = 50 * torch.stack([angle.cos(), angle.sin()], dim=1)
    >>> mean = curvature_loss(circle, 0.5) / 99
    >>> round(mean.item() ** 0.5, 5)  # 1 / 50 m
    0.02
    """
    return ((directions(route).diff(dim=0)[:, axes] / spacing) ** 2).sum()


def depth_loss(route: Tensor, mean: float, sd: float) -> Tensor:
    """Mean depth against its prior: ((mean z - prior mean) / sd)^2.

    >>> round(depth_loss(torch.tensor([[0.0, 4.0, 1.0], [5.0, 4.0, 1.4]]), 0.9, 0.3).item(), 4)
    1.0
    """
    return ((route[:, 2].mean() - mean) / sd) ** 2


def anchor_loss(points: Tensor, known: Tensor, sigma: Tensor) -> Tensor:
    """Distance of the route from its anchors: sum of ((r(s_a) - a) / sigma_a)^2.

    Parameters
    ----------
    points : the route at the anchors' channels [anchor, axis], m
    known, sigma : the anchors and their standard deviations [anchor, axis], m

    >>> one = torch.ones(1, 3)
    >>> round(anchor_loss(1.1 * one, one, 0.1 * one).item(), 4)
    3.0
    """
    return (((points - known) / sigma) ** 2).sum()


@dataclass(frozen=True)
class Regularization:
    """Weights of the shape terms, as standard deviations; infinity switches a term off.

    Parameters
    ----------
    angle : turn over one gauge length, rad
    length : relative length of a gauge length of fiber
    curvature : 1/m
    """

    angle: float = 0.2
    length: float = 0.01
    curvature: float = 0.02

    def loss(self, route: Tensor, spacing: float, gauge_length: float) -> Tensor:
        """Sum of the three terms; it stays the same where nodes are denser, one independent value per gauge length.

        Parameters
        ----------
        route : [node, axis], m
        spacing : length of fiber from node to node, m
        gauge_length : m

        >>> angle = torch.linspace(0, 1, 41, dtype=torch.float64)
        >>> bend = 80 * torch.stack([angle.cos(), angle.sin()], dim=1)
        >>> [round(Regularization().loss(bend[::step], 2.0 * step, 10.0).item(), 1) for step in (1, 2, 4)]
        [6.1, 5.9, 5.6]
        """
        share = spacing / gauge_length
        # Independent turns add up to the square root of their number.
        turn = angle_loss(route) / (self.angle**2 * share)
        stretch = share * length_loss(route, spacing) / self.length**2
        bend = share * curvature_loss(route, spacing) / self.curvature**2
        return turn + stretch + bend
