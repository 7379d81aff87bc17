"""The covariance of a fit to few points, against fits of a straight line whose truth is known."""

import numpy as np
import pytest

from calib.posterior import FAR, MISREAD, posterior_covariance, scatter


def line(places):
    """Derivative [point, 2, 4] of two straight lines by their heights and slopes."""
    slope = np.zeros((len(places), 2, 4))
    slope[:, 0, 0] = slope[:, 1, 2] = 1
    slope[:, 0, 1] = slope[:, 1, 3] = places
    return slope


def fitted(places, rng, noise):
    """Error [4] of a least squares fit to noise, and its covariance."""
    slope, off = line(places), noise * rng.normal(size=(len(places), 2))
    found = np.linalg.lstsq(slope.reshape(-1, 4), off.ravel(), rcond=None)[0]
    covariance = posterior_covariance(off - slope @ found, slope, np.zeros(0), np.zeros((0, 4)))
    return found, covariance


@pytest.mark.parametrize(("noise", "least", "most"), [(1.0, 0.94, 0.99), (2.0, 0.86, 0.96)])
def test_two_sigma_hold_about_95_percent_however_few_the_points(noise, least, most):
    rng = np.random.default_rng(0)
    for count in (4, 6, 8):
        inside = []
        for _ in range(300):
            found, covariance = fitted(rng.uniform(-1, 1, count), rng, noise)
            inside.append(abs(found[1]) < 2 * np.sqrt(covariance[1, 1]))
        assert least < np.mean(inside) < most, count


def test_what_one_point_alone_decides_is_as_uncertain_as_its_being_misread():
    """Of four points, three at one place: their line's slope hangs on the fourth."""
    alone, checked = (
        posterior_covariance(np.zeros((4, 2)), line(np.array(places)), np.zeros(0), np.zeros((0, 4)))
        for places in ([0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 1.0, 1.0])
    )
    plain = scatter(0, 4) * np.array([4 / 3, 1.0])
    assert alone[1, 1] > 2 * plain[0] and checked[1, 1] < 1.3 * plain[1]


def test_a_point_that_others_contradict_widens_what_it_moved():
    slope = line(np.linspace(-1, 1, 6))
    off = np.zeros((6, 2))
    quiet = posterior_covariance(off, slope, np.zeros(0), np.zeros((0, 4)))
    off[5, 0] = FAR / 2
    assert posterior_covariance(off, slope, np.zeros(0), np.zeros((0, 4)))[1, 1] > 4 * quiet[1, 1]


def test_what_is_known_beforehand_is_not_scattered():
    slope, nothing = np.zeros((4, 2, 1)), np.full((4, 2), 9.0)
    assert posterior_covariance(nothing, slope, np.zeros(1), np.eye(1)) == pytest.approx(1.0)


@pytest.mark.parametrize("off", [0.0, 4.0, 12.0], ids=["good", "doubtful", "misread"])
def test_the_covariance_is_that_of_the_mixture_written_out(off):
    """Fits of every model, all points good or one of them `FAR` times as uncertain, weighed by their evidence."""
    places, rng = np.array([-1.0, -0.6, 0.1, 0.5, 1.0]), np.random.default_rng(3)
    slope, data = line(places), 0.5 * rng.normal(size=(5, 2))
    data[4, 0] += off
    design, flat = slope.reshape(-1, 4), data.ravel()
    least = np.linalg.lstsq(design, flat, rcond=None)[0]
    left = (flat - design @ least).reshape(5, 2)
    noise = scatter(float((left**2).sum()), 10 - 4)
    means, covariances, weights = [], [], []
    for misread in (None, *range(5)):
        variance = np.full((5, 2), noise)
        if misread is not None:
            variance[misread] *= 1 + FAR**2
        whitened = design / np.sqrt(variance.ravel())[:, None]
        covariances.append(np.linalg.inv(whitened.T @ whitened))
        means.append(covariances[-1] @ whitened.T @ (flat / np.sqrt(variance.ravel())))
        chi2 = ((flat - design @ means[-1]) ** 2 / variance.ravel()).sum()
        evidence = -chi2 / 2 - np.log(variance).sum() / 2 + np.linalg.slogdet(covariances[-1])[1] / 2
        weights.append(evidence + (0.0 if misread is None else np.log(MISREAD / (1 - MISREAD))))
    weight = np.exp(np.array(weights) - max(weights))
    away = np.array(means) - least
    wanted = np.einsum("m,mpq->pq", weight / weight.sum(), covariances + away[:, :, None] * away[:, None, :])
    found = posterior_covariance(-left, slope, np.zeros(0), np.zeros((0, 4)))
    np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-12)
