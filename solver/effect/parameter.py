"""One parameter of an effect: its null, unit, bounds, plausible size and scope."""

from dataclasses import dataclass
from itertools import pairwise

#: What a parameter may be: one number, one per pass, or smooth along the fiber, the road, each pass, or in time.
SCOPES = ("one", "pass", "fiber", "road", "track", "time")
#: Those of which each row, a vehicle at a sample, has a value.
BY_ROW = ("pass", "road", "track")


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect.

    Parameters
    ----------
    name : as the effect's function looks it up
    unit : "1" for a pure number
    plausible : size that would surprise nobody; also the standard deviation of the prior once the effect is added. Many
        numbers without bounds whose root mean square is over three times that are no such effect
    null : value at which the effect is absent
    lower, upper : bounds
    scope : "one", "pass" (one per pass), or smooth along the "fiber", the "road" (x of the vehicle) or each "track", or
        in "time", the same for all vehicles; beyond the fiber's reach in x, as at its end, and what tracks are off by
        goes straight on, as they do
    rated : give the function the time derivative of what is smooth along the road or each track too, as `<name>_rate`
    grid : for a parameter that means nothing at the null of the others (a relaxation time, a place): the values that
        the search tries; () for all others
    """

    name: str
    unit: str
    plausible: float
    null: float = 0.0
    lower: float = -float("inf")
    upper: float = float("inf")
    scope: str = "one"
    grid: tuple[float, ...] = ()
    rated: bool = False

    @property
    def is_shape(self) -> bool:
        """Whether it has no null of its own."""
        return bool(self.grid)

    @property
    def rate_name(self) -> str:
        """Under which a function finds the time derivative, where it is `rated`."""
        return f"{self.name}_rate"

    @property
    def spacing(self) -> float:
        """Largest step of the grid; its plausible size where there is one value."""
        return max((b - a for a, b in pairwise(self.grid)), default=self.plausible)

    @property
    def one_sided(self) -> bool:
        """Whether the null is a bound."""
        return self.null in (self.lower, self.upper)
