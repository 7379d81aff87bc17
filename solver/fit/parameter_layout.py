"""Where the vector of all that is fitted holds what."""

from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

#: Axes of a route: x, y, z.
AXES = 3
#: What is fitted of each pass.
PER_PASS = ("amplitude", "along", "across", "wheelbase", "front_share")


def of_route(first: int, count: int) -> slice:
    """Where the vector holds `count` coefficients of the route from number `first` on, all axes of each together."""
    return slice(AXES * first, AXES * (first + count))


@dataclass(frozen=True)
class Layout:
    """The vector [parameter] by parts: route, each quantity of all passes, Poisson's ratio, numbers of the effects.

    Parameters
    ----------
    coefficients : of the route, per axis
    passes : whose vehicles are fitted
    numbers : of the effects

    >>> layout = Layout(coefficients=4, passes=2, numbers=3)
    >>> layout["route"], layout["along"], layout["poisson_ratio"], layout["numbers"]
    (slice(0, 12, None), slice(14, 16, None), slice(22, 23, None), slice(23, 26, None))
    >>> layout.size
    26
    """

    coefficients: int
    passes: int
    numbers: int

    @cached_property
    def parts(self) -> dict[str, slice]:
        """Name of each part -> where it is, in the vector's order."""
        counts = {
            "route": AXES * self.coefficients,
            **dict.fromkeys(PER_PASS, self.passes),
            "poisson_ratio": 1,
            "numbers": self.numbers,
        }
        found, first = {}, 0
        for name, count in counts.items():
            found[name] = slice(first, first + count)
            first += count
        return found

    def __getitem__(self, name: str) -> slice:
        """Where one part is."""
        return self.parts[name]

    @property
    def vehicles(self) -> slice:
        """Where all quantities of the passes are."""
        return slice(self[PER_PASS[0]].start, self[PER_PASS[-1]].stop)

    @property
    def size(self) -> int:
        """How many parameters the vector holds."""
        return self["numbers"].stop

    def where(self, name: str) -> Tensor:
        """Which parameters one part is.

        >>> Layout(1, 2, 0).where("amplitude").tolist()
        [3, 4]
        """
        return torch.arange(self[name].start, self[name].stop)
