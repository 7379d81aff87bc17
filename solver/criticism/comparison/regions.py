"""A region that fails: which passes and channels, and what change explains most of it."""

from dataclasses import dataclass

#: What each kind of change is measured in.
UNITS = {"gain": "1", "late": "s", "place": "m", "offset": "noise sigma", "power": "1", "shape": "1", "unseen": "1"}


@dataclass(frozen=True)
class Region:
    """One place where the model fails.

    Parameters
    ----------
    kind : "gain" (relative), "late" (s), "place" (m along the fiber), "offset" (noise sigmas), "power" (near vehicles),
        "shape" (at one distance from the vehicle), "unseen" (far from all vehicles); the last three are chi2 per sample
    passes : track ids; empty for "unseen"
    every_pass : whether these are all
    channels : first and last
    x : m, at those channels
    time : first and last, s since the record's start; None where passes at several times are meant
    ahead : m ahead of the vehicle, first and last; None where it does not matter
    amount, sigma : size of the change with its standard deviation
    meters : the delay of a single pass as distance, m
    speed : m/s, toward higher channels, of what moves there; None if unknown
    chi2 : how much of the misfit it is
    z : statistic of the scan, standard deviations
    """

    kind: str
    passes: tuple[str, ...]
    every_pass: bool
    channels: tuple[int, int]
    x: tuple[float, float]
    time: tuple[float, float] | None
    ahead: tuple[float, float] | None
    amount: float
    sigma: float
    meters: float | None
    speed: float | None
    chi2: float
    z: float

    @property
    def unit(self) -> str:
        """Of `amount`."""
        return UNITS[self.kind]
