"""Prediction filters: predictors of every order, and what they make of maps."""

import numpy as np
import torch
from scipy.linalg import solve_toeplitz, toeplitz

from solver.noise.prediction import PredictionFilter, levinson

BLOCKS = [slice(0, 7), slice(7, 9), slice(9, 30)]


def test_levinson_predicts_as_the_toeplitz_equations_do():
    lag = np.arange(12)
    covariance = 2.0 * 0.7**lag * np.cos(0.9 * lag) + 0.5 * (lag == 0)
    rows = levinson(covariance)
    for order in (1, 4, 11):
        weights = solve_toeplitz(covariance[:order], covariance[1 : order + 1])
        error = covariance[0] - weights @ covariance[1 : order + 1]
        np.testing.assert_allclose(rows[order], np.append(1.0, -weights) / np.sqrt(error), atol=1e-12)


def test_predictors_of_all_orders_are_the_inverse_cholesky_factor():
    covariance = 0.6 ** np.arange(9) + 0.2 * (np.arange(9) == 0)
    rows = levinson(covariance)
    matrix = np.zeros((9, 9))
    for row, weights in enumerate(rows):
        matrix[row, : row + 1] = weights[::-1]
    np.testing.assert_allclose(matrix @ toeplitz(covariance) @ matrix.T, np.eye(9), atol=1e-12)


def matrix_of(covariance: np.ndarray) -> np.ndarray:
    """The filter of all samples of `BLOCKS` as a matrix [sample, sample]."""
    rows, matrix = levinson(covariance), np.zeros((30, 30))
    for block in BLOCKS:
        for s in range(block.start, block.stop):
            weights = rows[min(s - block.start, len(rows) - 1)]
            matrix[s, s - len(weights) + 1 : s + 1] = weights[::-1]
    return matrix


def test_maps_are_filtered_each_block_from_its_own_start():
    covariance = 0.7 ** np.arange(5)
    maps = torch.from_numpy(np.random.default_rng(1).normal(size=(2, 3, 30, 4)))
    maps[0, :, 3:20] = 0
    expected = torch.from_numpy(matrix_of(covariance)) @ maps
    torch.testing.assert_close(PredictionFilter.of(covariance, BLOCKS)(maps), expected)
    torch.testing.assert_close(PredictionFilter.of(covariance, BLOCKS, lead=8)(maps), expected[..., 8:, :])


def test_gradients_are_filtered_the_other_way():
    maps = torch.from_numpy(np.random.default_rng(2).normal(size=(2, 30, 3))).requires_grad_()
    by = PredictionFilter.of(0.7 ** np.arange(5), BLOCKS, lead=4)
    assert torch.autograd.gradcheck(by, maps)


def test_along_a_direction_another_filter_acts_and_factors_around_both():
    rng, covariance = np.random.default_rng(3), 0.7 ** np.arange(5)
    other = covariance + 0.4 * 0.9 ** np.arange(5)
    maps = torch.from_numpy(rng.normal(size=(3, 30, 4)))
    maps[1, :, :2], maps[2, 5:] = 0, 0
    before, after = (torch.from_numpy(rng.uniform(0.5, 2, size=(samples, 4))) for samples in (30, 22))
    direction = rng.normal(size=4)
    direction /= np.linalg.norm(direction)
    plain = PredictionFilter.of(covariance, BLOCKS, lead=8)
    by = plain.along(direction, PredictionFilter.of(other, BLOCKS, lead=8)).between(before, after)
    own, both = (torch.from_numpy(matrix_of(one)) for one in (covariance, other))
    along = torch.from_numpy(np.outer(direction, direction))
    expected = own @ (maps * before) + (both - own) @ (maps * before) @ along
    torch.testing.assert_close(by(maps), expected[:, 8:] * after)
    assert torch.autograd.gradcheck(by, maps.clone().requires_grad_())


def test_what_is_not_a_number_stays_so():
    maps = torch.zeros(1, 30, 2, dtype=torch.float64)
    maps[0, 2, 1] = float("nan")
    found = PredictionFilter.of(0.7 ** np.arange(5), BLOCKS)(maps)[0]
    assert found[2:7, 1].isnan().any() and not found[:, 0].isnan().any()
