"""Cable stage: where the channels are on the fiber and how it follows the ground."""

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from solver.effect.transfers import FiberTransfer


@dataclass(frozen=True)
class Loose:
    """A length of fiber that nothing holds but its two ends: there tension, and so strain, is the same all along.

    Parameters
    ----------
    begin, end : scalars, along the route, m
    share : scalar, of that evening out which takes place
    """

    begin: Tensor
    end: Tensor
    share: Tensor

    def shares(self, at: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Shares of the ground's motion at hand, and where the length begins and ends, in that of the fiber.

        Between the ends the fiber's motion is linear.

        Parameters
        ----------
        at : [...], along the route, m

        Returns
        -------
        own, first, last : [...] each

        >>> loose = Loose(torch.tensor(2.0), torch.tensor(6.0), torch.tensor(1.0))
        >>> [x.tolist() for x in loose.shares(torch.tensor([1.0, 3.0, 5.0]))]
        [[1.0, 0.0, 0.0], [0.0, 0.75, 0.25], [0.0, 0.25, 0.75]]
        """
        way = (at - self.begin) / (self.end - self.begin)
        inside = (way > 0) & (way < 1)
        evened, way = torch.where(inside, self.share, torch.zeros_like(way)), torch.where(inside, way, 0.0)
        return 1 - evened, evened * (1 - way), evened * way


@dataclass(frozen=True)
class Cable:
    """Where the channels are on the fiber and how it follows the ground.

    Parameters
    ----------
    counted : [channel], along the fiber, as channels are counted, m
    shift : [channel] or scalar, how much farther along the route each gauge lies, halfway between its ends, m
    slack : [channel] or scalar, share by which a gauge reaches farther along the route than its length says
    middle : [channel] or scalar, how much farther along the route the middle of a gauge lies than halfway, m
    gain : [channel] or scalar, strain of the fiber over that of the ground
    vertical : share of the ground's vertical motion that the fiber follows
    path_integral : share of the strain that bends within a gauge add to the motion of its two ends
    loose : where the fiber slips; None where it does not
    transfers : of filters along the fiber
    mixing : [channel, channel] matrices applied along the fiber
    """

    counted: Tensor
    shift: Tensor | float = 0.0
    slack: Tensor | float = 0.0
    middle: Tensor | float = 0.0
    gain: Tensor | float = 1.0
    vertical: Tensor | float = 1.0
    path_integral: Tensor | float = 0.0
    loose: Loose | None = None
    transfers: tuple[FiberTransfer, ...] = ()
    mixing: tuple[Tensor, ...] = ()

    @property
    def distance(self) -> Tensor:
        """Along the route, halfway between the ends of each gauge [channel], m."""
        return self.counted + self.shift

    @property
    def moved(self) -> bool:
        """Whether channels may lie elsewhere than counted: a number is the base model's, a tensor an effect's."""
        return isinstance(self.shift, Tensor)

    @property
    def like_ground(self) -> bool:
        """Whether the fiber strains as the ground does, told as in `moved`."""
        told = (self.slack, self.gain, self.vertical, self.path_integral)
        return self.loose is None and not any(isinstance(x, Tensor) for x in told)

    def filtered(self, transfer: FiberTransfer) -> "Cable":
        """Whose strain is filtered along the fiber."""
        return replace(self, transfers=(*self.transfers, transfer))

    def mixed(self, matrix: Tensor) -> "Cable":
        """Whose channels are sums [channel, channel] of the base model's."""
        return replace(self, mixing=(*self.mixing, matrix))
