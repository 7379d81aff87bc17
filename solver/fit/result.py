"""What every fit gives back."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from solver.noise.law import NoiseLaw


@dataclass(frozen=True)
class Parameter:
    """One fitted number: value, standard deviation, unit, whether it was free."""

    value: float
    sigma: float
    unit: str
    free: bool


@dataclass(frozen=True)
class Corner:
    """A place where a fiber turns, or goes deeper or less deep.

    Parameters
    ----------
    kind : "corner" (in plan) or "step" (in depth)
    amount, sigma : degrees to the right of one who looks toward higher channels, or m deeper; and its sd
    length : of fiber over which it does so, m
    distance, channel : along the fiber, m, and of the nearest channel
    x, y, z : m
    sigma_place : sd of the place in plan, m
    """

    kind: Literal["corner", "step"]
    amount: float
    sigma: float
    length: float
    distance: float
    channel: int
    x: float
    y: float
    z: float
    sigma_place: float

    @property
    def words(self) -> str:
        """What a user reads.

        >>> Corner("corner", -88.4, 1.0, 1.6, 140.0, 134, 52.0, 3.1, 0.9, 0.2).words
        'turns 88 degrees to the left at x = 52.0, y = 3.1 m (channel 134), within 0.4 m'
        >>> Corner("step", 0.88, 0.02, 2.5, 140.0, 125, 45.0, 3.1, 0.9, 0.1).words
        'goes 0.9 m deeper within 2.5 m of fiber at x = 45.0, y = 3.1 m (channel 125)'
        """
        where = f"at x = {self.x:.1f}, y = {self.y:.1f} m (channel {self.channel})"
        if self.kind == "corner":
            side = "right" if self.amount > 0 else "left"
            within = max(2 * self.sigma_place, 0.1)
            return f"turns {abs(self.amount):.0f} degrees to the {side} {where}, within {within:.1f} m"
        way = "deeper" if self.amount > 0 else "less deep"
        return f"goes {abs(self.amount):.1f} m {way} within {self.length:.1f} m of fiber {where}"


#: Grades of a run, see `solver.run.trust.Trust`, that may be relied on.
TRUSTED = ("good", "fair")
#: Why a channel is not constrained.
LOOSE = "Here neither data nor anchors decide, or the model does not explain what vehicles leave."


@dataclass(frozen=True)
class Placed:
    """A fiber's route alone.

    Parameters
    ----------
    channel, distance, route, constrained : as of `FitResult`
    covariance : [channel, 3, 3], m^2, of the 95 % corridor
    fit_covariance : of the fit alone, which takes its model for granted; None where no other is known
    grade, trust : what the run's checks say, see `solver.run.trust.Trust`: in a word, and in a sentence
    left_out : what the corridor leaves out, in a sentence; "" where it leaves out nothing
    corners : where the fiber turns, or goes deeper or less deep
    """

    channel: NDArray[np.int64]
    distance: NDArray[np.float64]
    route: NDArray[np.float64]
    covariance: NDArray[np.float64]
    constrained: NDArray[np.bool_]
    fit_covariance: NDArray[np.float64] | None = None
    grade: str = "good"
    trust: str = ""
    left_out: str = ""
    corners: tuple[Corner, ...] = ()

    @property
    def told(self) -> str:
        """What a file says of the whole route: what its checks say, and what its corridor leaves out."""
        return f"{self.trust} {self.left_out}".strip()

    @property
    def reliable(self) -> NDArray[np.bool_]:
        """Channels [channel] that may be relied on: data and anchors decide them, and no check of the run failed."""
        return self.constrained & (self.grade in TRUSTED)

    @property
    def reason(self) -> NDArray[np.str_]:
        """Why a channel [channel] is not to be relied on; of others what their corridor leaves out.

        >>> place = np.arange(2), np.zeros(2), np.zeros((2, 3)), np.zeros((2, 3, 3)), np.array([True, False])
        >>> Placed(*place, trust="No check failed.", left_out="It takes the model for granted.").reason.tolist()
        ['It takes the model for granted.', 'Here neither data nor anchors decide, or the model does not explain what \
vehicles leave.']
        """
        failed = "" if self.grade == "good" else self.trust.partition(" Next: ")[0]
        return np.select([self.reliable, self.constrained], [self.left_out, failed], f"{failed} {LOOSE}".strip())

    @property
    def sigma(self) -> NDArray[np.float64]:
        """Standard deviation [channel, 3] of x, y, z, m."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2)))

    @property
    def sigma_fit(self) -> NDArray[np.float64] | None:
        """The same of the fit alone."""
        if self.fit_covariance is None:
            return None
        return np.asarray(np.sqrt(np.diagonal(self.fit_covariance, axis1=1, axis2=2)))


@dataclass(frozen=True)
class FitResult:
    """A located fiber and how well the model explains the measurement.

    Parameters
    ----------
    method : name of the fit
    channel, distance : [channel], number and distance along the fiber (m) of the route's points
    route : [channel, 3], x, y, z, m
    covariance : [channel, 3, 3], m^2; NaN where the method gives none
    tails : [channel, 3, 3], m^2, what of it the tails of the prior on the shape add to the fit's own
    constrained : [channel] bool, False where only the smoothness of routes decides the lateral position, or where no
        fitted gauge lies
    data_share : [channel, 3], share of the posterior variance that data and anchors, not priors, decide; NaN likewise
    parameters : name -> Parameter
    vector : [parameter], all that was fitted, as `solver.fit.least_squares.State` packs it
    samples : [sample], rows of the record that were fitted
    fitted_channel : [fitted], channel numbers of the maps below
    measured, model : [sample, fitted], 1/s; measured is NaN where there is none
    noise : [fitted], standard deviation of the noise, 1/s
    weight : [sample, fitted], 0 to 1, what the robust likelihood left of each sample
    law : of the noise in time and across channels
    chi2 : misfit of the whitened residual, weights applied
    chi2_per_dof : the same over degrees of freedom
    cost : -2 ln of the posterior density where the fit ended, see `solver.fit.chain.Chain.cost`
    ambiguous_side : True where the mirror route on the other side of the traffic fits as well
    iterations, seconds, converged : how it went
    shared : shares of the variances of y and z that are common to all constrained places; None where not known
    corners : where the fiber turns, or goes deeper or less deep, of the fitted channels
    """

    method: str
    channel: NDArray[np.int64]
    distance: NDArray[np.float64]
    route: NDArray[np.float64]
    covariance: NDArray[np.float64]
    tails: NDArray[np.float64]
    constrained: NDArray[np.bool_]
    data_share: NDArray[np.float64]
    parameters: dict[str, Parameter]
    vector: NDArray[np.float64]
    samples: NDArray[np.int64]
    fitted_channel: NDArray[np.int64]
    measured: NDArray[np.float64]
    model: NDArray[np.float64]
    noise: NDArray[np.float64]
    weight: NDArray[np.float64]
    law: NoiseLaw
    chi2: float
    chi2_per_dof: float
    cost: float
    ambiguous_side: bool
    iterations: int
    seconds: float
    converged: bool
    shared: tuple[float, float] | None = None
    corners: tuple[Corner, ...] = ()

    @property
    def freedom(self) -> float:
        """Degrees of freedom: samples less parameters that they decide."""
        return self.chi2 / self.chi2_per_dof

    @property
    def sigma(self) -> NDArray[np.float64]:
        """Standard deviation [channel, 3] of x, y, z, m."""
        return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))

    def unexplained(self, at: Any = ...) -> NDArray[np.float64]:
        """Measured - model [sample, fitted], 1/s, or some of it (an index `at`); NaN where not measured."""
        return np.asarray(self.measured[at] - self.model[at])

    @property
    def residual(self) -> NDArray[np.float64]:
        """Measured - model [sample, fitted], in units of the noise; NaN where not measured."""
        return np.asarray(self.unexplained() / self.noise)
