"""The prior of all that is fitted: means, standard deviations, and the cost of departing from them."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from solver.cable.fiber import DEGREE, SplineBasis
from solver.fit.numbers import Numbers
from solver.fit.parameter_layout import AXES, Layout, of_route
from solver.fit.prior import Prior, Rows, anchor_rows, shape_rows, track_cost, track_precision
from solver.fit.state import State
from solver.load.wheel_layout import layout_of
from solver.signal_path.extension import NONE, Extension
from solver.signal_path.traffic import Vehicles
from solver.survey.anchors import Anchor
from solver.trajectory.vehicle_pass import Pass

#: What is wrong with a whole track: the passes together tell how large it is.
TRACK_ERRORS = ("along", "across")
#: A longer route has a mean depth of its own every so many meters.
OWN_DEPTH = 200.0


@dataclass(frozen=True)
class RouteRows:
    """Rows of a prior on the coefficients from number `first` on, and on some `other` parameters [other]."""

    first: int
    rows: Rows
    other: Tensor = field(default_factory=lambda: torch.zeros(0, dtype=torch.int64))

    @property
    def count(self) -> int:
        """How many of the route's parameters they are of."""
        return self.rows.jacobian.shape[1] - len(self.other)

    @property
    def gram(self) -> NDArray[np.float64]:
        """Their normal matrix."""
        return np.asarray((self.rows.jacobian.T @ self.rows.jacobian).numpy())

    @property
    def route(self) -> slice:
        """Which of the route's parameters they are of."""
        return of_route(self.first, self.count // AXES)

    @property
    def where(self) -> Tensor:
        """Which parameters they are of."""
        return torch.cat([torch.arange(self.route.start, self.route.stop), self.other])


@dataclass(frozen=True)
class ParameterPrior:
    """Priors on a state.

    Parameters
    ----------
    basis : of the route
    prior : what was known before
    passes : whose vehicles are fitted
    anchors : known points of the fiber
    anchor_distance : [anchor], m along the fiber
    numbers : of the effects
    held : whether all but the vehicles is left as it is
    extension : whose effects may lead the fiber at the anchors elsewhere; None: they do not
    """

    basis: SplineBasis
    prior: Prior
    passes: Sequence[Pass]
    anchors: Sequence[Anchor]
    anchor_distance: np.ndarray
    numbers: Numbers
    held: bool = False
    extension: Extension | None = None

    @cached_property
    def layout(self) -> Layout:
        """Where the vector of all parameters holds what."""
        return Layout(self.basis.size, len(self.passes), len(self.numbers))

    @cached_property
    def mean(self) -> Tensor:
        """[parameter]."""
        route = torch.zeros(self.basis.size, 3, dtype=torch.float64)
        nu = torch.tensor(self.prior.poisson_ratio[0], dtype=torch.float64)
        return State(route, Vehicles.of(self.passes), nu, self.numbers.mean).vector()

    @cached_property
    def sd(self) -> Tensor:
        """[parameter]; inf for the route, whose prior is on its shape, 0 where a value is fixed."""
        layouts = [layout_of(one.vehicle_class, one.wheelbase) for one in self.passes]
        numbers = self.numbers
        known = {
            "route": 0.0 if self.held else torch.inf,
            "amplitude": torch.inf,
            **{name: getattr(self.prior, name) / self.trusted(name) for name in TRACK_ERRORS},
            "wheelbase": torch.tensor([layout.wheelbase_sd for layout in layouts], dtype=torch.float64),
            "front_share": torch.tensor([layout.front_share_sd for layout in layouts], dtype=torch.float64),
            "poisson_ratio": 0.0 if self.held else self.prior.poisson_ratio[1],
            "numbers": torch.where(numbers.single, numbers.sd, 0.0) if self.held else numbers.sd,
        }
        sd = torch.zeros(self.layout.size, dtype=torch.float64)
        for name, value in known.items():
            sd[self.layout[name]] = value
        return sd

    def trusted(self, name: str) -> Tensor:
        """Share [pass] of a track's error `along` or `across` that counts: less where all of it may be off besides."""
        size = getattr(self.prior, name)
        return size / torch.tensor([np.hypot(size, one.offset) for one in self.passes], dtype=torch.float64)

    @cached_property
    def free(self) -> Tensor:
        """[parameter] bool, what is fitted."""
        return self.sd > 0

    @cached_property
    def bounds(self) -> tuple[Tensor, Tensor]:
        """Lowest and highest values [parameter]; infinite where there is none."""
        lower = torch.full((self.layout.size,), -torch.inf, dtype=torch.float64)
        upper = -lower
        lower[self.layout["numbers"]], upper[self.layout["numbers"]] = self.numbers.lower, self.numbers.upper
        return lower, upper

    def precision(self, state: State) -> Tensor:
        """Precision [parameter] of the priors; those on the tracks' errors depend on how large they all are."""
        precision = self.sd**-2
        for name in TRACK_ERRORS:
            if bool(self.free[where := self.layout[name]].all()) and self.passes:
                share, size = self.trusted(name), getattr(self.prior, name)
                errors = share * getattr(state.vehicles, name)
                precision[where] = share**2 * track_precision(errors, size, self.prior.track_freedom)
        return precision

    def cost(self, state: State) -> float:
        """-2 ln of the prior density of all but the route, but for a constant."""
        sd, tracks = self.sd.clone(), 0.0
        for name in TRACK_ERRORS:
            if bool(self.free[where := self.layout[name]].all()) and self.passes:
                sd[where] = torch.inf
                errors = self.trusted(name) * getattr(state.vehicles, name)
                tracks += track_cost(errors, getattr(self.prior, name), self.prior.track_freedom)
        shift = (state.vector() - self.mean)[self.free] / sd[self.free]
        return float((shift**2).sum()) + tracks

    @cached_property
    def pieces(self) -> list[tuple[int, SplineBasis]]:
        """First coefficient and basis of each stretch of the route that has a mean depth of its own."""
        basis = self.basis
        count = max(1, round((basis.stop - basis.start) / OWN_DEPTH))
        places = np.linspace(basis.start, basis.stop, count + 1)
        cuts = np.abs(basis.breaks[:, None] - places).argmin(0).tolist()
        return [(first, basis.part(first, last)) for first, last in pairwise(cuts)]

    def shape(self, coefficients: Tensor) -> list[RouteRows]:
        """Rows of the prior on the route's shape."""
        return [
            RouteRows(first, shape_rows(part, self.prior, coefficients[first : first + part.size]))
            for first, part in self.pieces
        ]

    def led(self, state: State, distance: np.ndarray) -> tuple[Tensor, Tensor, Tensor]:
        """Where effects lead the fiber that counts as `distance` [place], m: how far along the route.

        With the derivatives [place, other] by those parameters [other] that may change it.
        """
        extension = self.extension or NONE
        numbers = self.layout.where("numbers")
        every = [numbers[slot.where] for slot in extension.moving]
        other = torch.cat([torch.zeros(0, dtype=torch.int64), *every])
        return *extension.moves(state.numbers, torch.from_numpy(distance)), other

    def anchored(self, state: State) -> list[RouteRows]:
        """Rows of the anchors, at the places to which effects lead the fiber."""
        place, by_number, other = self.led(state, self.anchor_distance)
        basis, found = self.basis, []
        if len(self.pieces) == 1:
            return [RouteRows(0, anchor_rows(basis, self.anchors, place, by_number, state.coefficients), other)]
        for number, anchor in enumerate(self.anchors):
            first = int(basis.interval(float(place[number])))
            part, one = basis.part(first, first + 1), slice(number, number + 1)
            near = state.coefficients[first : first + DEGREE + 1]
            found.append(RouteRows(first, anchor_rows(part, [anchor], place[one], by_number[one], near), other))
        return found

    def anchor_misfit(self, state: State) -> np.ndarray:
        """Chi2 [anchor] of the anchors."""
        residual = [one.rows.residual.reshape(AXES, -1) for one in self.anchored(state)]
        return (torch.cat(residual, 1) ** 2).sum(0).numpy()

    def route_rows(self, state: State) -> list[RouteRows]:
        """Rows of the priors on the route: its shape and its anchors."""
        return [*self.shape(state.coefficients), *self.anchored(state)]

    def route_cost(self, state: State) -> float:
        """-2 ln of the prior density of the route and of the anchors, but for a constant."""
        return sum(float((one.rows.residual**2).sum()) for one in self.route_rows(state))

    def total(self, state: State) -> float:
        """-2 ln of the prior density of all and of the anchors, but for a constant."""
        return self.cost(state) + self.route_cost(state)
