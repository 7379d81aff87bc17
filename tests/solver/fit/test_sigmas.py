"""What a fit says of its own uncertainty, against dense linear algebra on a survey that is linear and made by hand."""

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import torch

from solver.cable.fiber import SplineBasis
from solver.fit.normal import Normal
from solver.fit.normal_parts import Block, Part
from solver.fit.parameter_prior import RouteRows
from solver.fit.posterior import Posterior, gauge_coverage, lateral_share
from solver.fit.prior import Rows
from solver.fit.state import Weights
from solver.fit.visit import Visit

BASIS = SplineBasis.even(0.0, 30.0, 10.0)
ROUTE = 3 * BASIS.size
#: All that is fitted: the route, one number that all share, two vehicles with two numbers each.
SIZE = ROUTE + 1 + 2 * 2
OWN = [np.array([ROUTE + 1, ROUTE + 2]), np.array([ROUTE + 3, ROUTE + 4])]
ROWS = 120


@dataclass(frozen=True)
class Linear:
    """Data [row] = `design` [row, SIZE] @ numbers + noise of variance 1, priors, and an anchor of three coordinates.

    Parameters
    ----------
    design, shape, anchor : [row, SIZE], of the data, of the prior on the route's shape and of the anchor
    precision : [SIZE], of the other priors; 0 for the route
    """

    design: np.ndarray
    shape: np.ndarray
    anchor: np.ndarray
    precision: np.ndarray

    @property
    def prior(self) -> np.ndarray:
        """Normal matrix [SIZE, SIZE] of the priors, the anchor left out."""
        return self.shape.T @ self.shape + np.diag(self.precision)

    @property
    def covariance(self) -> np.ndarray:
        """The whole posterior's [SIZE, SIZE], where the noise is as large as stated."""
        return np.linalg.inv(self.design.T @ self.design + self.anchor.T @ self.anchor + self.prior)

    def posterior(self, misfit: float, missed: float = 0.0) -> Posterior:
        """The posterior of a fit that leaves so much chi2, and the anchor `missed` sigmas away along each axis."""
        shared = np.arange(ROUTE + 1)
        normal = self.design.T @ self.design
        parts = [
            Part(
                normal[np.ix_(own, own)] + np.diag(self.precision[own]),
                normal[np.ix_(own, shared)],
                np.zeros(2),
                self.precision[own],
                0,
            )
            for own in OWN
        ]
        known = [
            Block(0, ROUTE, np.zeros(0, int), (rows.T @ rows)[:ROUTE, :ROUTE]) for rows in (self.shape, self.anchor)
        ]
        known.append(Block(0, 0, np.zeros(1, int), self.precision[ROUTE : ROUTE + 1, None]))
        block = Block(0, ROUTE, np.zeros(1, int), normal[np.ix_(shared, shared)])
        state = SimpleNamespace(coefficients=torch.zeros(BASIS.size, 3, dtype=torch.float64))
        every = torch.ones(ROWS, 1, dtype=torch.float64)
        visit = Visit(
            cast(Any, state),
            misfit,
            misfit,
            Normal(ROUTE, 1, [block], known, parts, np.zeros(ROUTE + 1)),
            np.zeros(1, bool),
            [np.zeros(2, bool)] * 2,
            [Weights(every, every)],
            [],
            [],
        )
        return Posterior(cast(Any, self.chain(missed)), visit)

    def chain(self, missed: float) -> SimpleNamespace:
        """What a posterior asks of its fit."""

        def rows(matrix: np.ndarray, residual: float) -> list[RouteRows]:
            off = torch.full((len(matrix),), residual, dtype=torch.float64)
            return [RouteRows(0, Rows(off, torch.from_numpy(matrix[:, :ROUTE])))]

        return SimpleNamespace(
            basis=BASIS,
            border=torch.tensor([ROUTE]),
            mean=torch.zeros(SIZE, dtype=torch.float64),
            own_places=[torch.from_numpy(own) for own in OWN],
            rank=lambda where: np.zeros(len(where), int),
            prior=SimpleNamespace(
                held=False,
                shape=lambda coefficients: rows(self.shape, 0.0),
                anchored=lambda state: rows(self.anchor, missed),
                precision=lambda state: torch.from_numpy(self.precision),
                led=lambda state, distance: (
                    torch.from_numpy(distance),
                    torch.zeros(len(distance), 0, dtype=torch.float64),
                    torch.zeros(0, dtype=torch.int64),
                ),
            ),
        )


@pytest.fixture(scope="module")
def survey() -> Linear:
    """Of each row one vehicle's numbers are part; priors decide about as much as the data."""
    random = np.random.default_rng(2)
    design = random.normal(size=(ROWS, SIZE)) * 0.4
    for first, own in enumerate(OWN):
        design[first::2, own] = 0.0
    shape, anchor = np.zeros((20, SIZE)), np.zeros((3, SIZE))
    shape[:, :ROUTE] = random.normal(size=(20, ROUTE))
    anchor[:, :ROUTE] = np.kron(BASIS.at(np.array([12.0])), np.eye(3))
    return Linear(design, shape, anchor, np.concatenate([np.zeros(ROUTE), np.full(1, 5.0), np.full(4, 20.0)]))


def test_sigmas_grow_with_the_misfit_as_the_birge_ratio_and_never_shrink(survey: Linear) -> None:
    """Noise twice as large as stated leaves four times the chi2, and sigmas that are twice as large."""
    spare = ROWS - np.trace(survey.covariance @ (np.linalg.inv(survey.covariance) - survey.prior))
    stated = np.sqrt(np.diagonal(survey.covariance))
    at = np.array([3.0, 14.0, 27.0])
    places = np.kron(BASIS.at(at), np.eye(3)).reshape(len(at), 3, -1)
    route = places @ survey.covariance[:ROUTE, :ROUTE] @ places.transpose(0, 2, 1)
    for noise, grown in ((1.0, 1.0), (2.0, 2.0), (0.5, 1.0)):
        posterior = survey.posterior(noise**2 * spare)
        assert posterior.chi2_per_dof == pytest.approx(noise**2)
        np.testing.assert_allclose(posterior.sigmas().numpy()[ROUTE:], grown * stated[ROUTE:], rtol=1e-9)
        np.testing.assert_allclose(posterior.route(at)[1], grown**2 * route, rtol=1e-9)


def test_errors_are_as_large_as_sigmas_say_whatever_the_noise_is() -> None:
    """Estimates scatter about the truth by their sigmas though the noise is three times what the fit was told."""
    random = np.random.default_rng(5)
    design = random.normal(size=(ROWS, SIZE))
    for first, own in enumerate(OWN):
        design[first::2, own] = 0.0
    loose = Linear(design, np.zeros((0, SIZE)), np.zeros((0, SIZE)), np.full(SIZE, 1e-9))
    squares = []
    for _ in range(60):
        data = 3.0 * random.normal(size=ROWS)
        found, misfit, _, _ = np.linalg.lstsq(design, data)
        squares.append((found[ROUTE:] / loose.posterior(float(misfit[0])).sigmas().numpy()[ROUTE:]) ** 2)
    # The mean of 300 squares scatters by 8 %.
    assert np.mean(squares) == pytest.approx(1.0, abs=0.25)


def test_anchors_that_are_missed_widen_all_as_the_misfit_does(survey: Linear) -> None:
    stated = survey.posterior(0.0).sigmas()
    np.testing.assert_allclose(survey.posterior(0.0, missed=3.0).sigmas(), 3.0 * stated, rtol=1e-9)
    np.testing.assert_allclose(survey.posterior(0.0, missed=0.5).sigmas(), stated, rtol=1e-9)


def test_data_and_anchors_decide_what_priors_leave(survey: Linear) -> None:
    """The trace of the posterior's covariance times the information of data and anchors."""
    information = survey.design.T @ survey.design + survey.anchor.T @ survey.anchor
    expected = np.trace(survey.covariance @ information)
    assert 0.3 * SIZE < expected < 0.9 * SIZE
    assert survey.posterior(1.0).decided == pytest.approx(expected, rel=1e-9)


def test_the_priors_part_of_a_route_s_variance_is_what_draws_of_the_priors_alone_move_it(survey: Linear) -> None:
    """Covariance C, priors' information P: an error of the priors' means, of covariance P, moves the fit by C P C."""
    at = np.array([1.0, 11.0, 16.0, 29.0])
    places = np.kron(BASIS.at(at), np.eye(3)).reshape(len(at), 3, -1)
    _, _, prior, shape = survey.posterior(0.0).route(at)
    for part, information in ((prior, survey.prior), (shape, survey.shape.T @ survey.shape)):
        moved = (survey.covariance @ information @ survey.covariance)[:ROUTE, :ROUTE]
        np.testing.assert_allclose(part, places @ moved @ places.transpose(0, 2, 1), rtol=1e-8)


def test_the_lateral_share_is_of_the_way_across_the_route() -> None:
    """Of a route that goes diagonally the prior decides nothing along it and 30 % of the variance across it."""
    route = np.arange(5.0)[:, None] * np.array([1.0, 1.0, 0.0])
    along, across = np.array([1.0, 1.0, 0.0]) / 2**0.5, np.array([-1.0, 1.0, 0.0]) / 2**0.5
    total = 9.0 * np.outer(along, along) + 4.0 * np.outer(across, across)
    prior = 0.3 * 4.0 * np.outer(across, across)
    share = lateral_share(route, np.tile(total, (5, 1, 1)), np.tile(prior, (5, 1, 1)))
    np.testing.assert_allclose(share, 0.7)


def test_no_place_beyond_the_gauges_of_fitted_channels_counts_as_measured() -> None:
    """An anchor 36 m beyond the last of them made places between count, 8 m off at 0.4 m claimed."""
    fitted = np.array([4, 5, 6, 8, 9, 20, 21])
    problem = cast("Any", SimpleNamespace(channel=fitted, gauge_length=4.0, channel_spacing=1.0))
    assert np.arange(25)[~gauge_coverage(problem, np.arange(25))].tolist() == [0, 1, 12, 13, 14, 15, 16, 17, 24]
    short = cast("Any", SimpleNamespace(channel=fitted, gauge_length=2.0, channel_spacing=5.0))
    assert np.arange(25)[gauge_coverage(short, np.arange(25))].tolist() == fitted.tolist()
