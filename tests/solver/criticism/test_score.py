"""The score test's linear algebra, against least squares done by brute force."""

import numpy as np
import pytest
import torch

from solver.catalogue.catalogue import built_in
from solver.criticism.marginal import Spectrum
from solver.criticism.score import NOTED, Projected, Score, mixes, one_sided, outcome

RNG = np.random.default_rng(8)
ONES = torch.ones(3, dtype=torch.float64)


def projected(columns: np.ndarray, fitted: np.ndarray, residual: np.ndarray) -> Projected:
    """What a fit of some columns leaves of others."""
    left = columns - fitted @ np.linalg.lstsq(fitted, columns, rcond=None)[0]
    return Projected(
        *(torch.from_numpy(np.asarray(part)) for part in (left.T @ residual, left.T @ left, columns.T @ columns))
    )


@pytest.fixture
def case() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Columns that are tested, columns that were fitted, and the residual of that fit."""
    fitted, columns = RNG.normal(size=(60, 5)), RNG.normal(size=(60, 3)) * [1.0, 1e4, 1e-5]
    data = RNG.normal(size=60) + columns @ [2.0, 1e-4, 0.0]
    return columns, fitted, data - fitted @ np.linalg.lstsq(fitted, data, rcond=None)[0]


def test_the_predicted_fall_is_that_of_fitting_everything_again(case):
    """Of a linear problem it is exact, whatever the units of the columns."""
    columns, fitted, residual = case
    fall, freedom, estimate, sigma, retained, _ = outcome(projected(columns, fitted, residual), None, ONES)
    whole = np.hstack([fitted, columns])
    solution = np.linalg.lstsq(whole, residual, rcond=None)[0]
    again = residual - whole @ solution
    covariance = np.linalg.inv(whole.T @ whole)
    assert fall == pytest.approx(residual @ residual - again @ again, rel=1e-9)
    assert freedom == 3 and 0 < retained <= 1
    np.testing.assert_allclose(estimate, solution[5:], rtol=1e-8)
    np.testing.assert_allclose(sigma, np.sqrt(covariance.diagonal()[5:]), rtol=1e-8)


def test_what_the_fit_can_do_itself_has_no_fall(case):
    """A column that the fitted ones span is left out, and does not disturb another."""
    columns, fitted, residual = case
    spanned = np.column_stack([fitted @ [1.0, -2.0, 0.5, 0.0, 3.0], columns[:, 0]])
    alone = outcome(projected(columns[:, :1], fitted, residual), None, ONES[:1])
    both = outcome(projected(spanned, fitted, residual), None, ONES[:2])
    assert both[1] == 1 and both[0] == pytest.approx(alone[0], rel=1e-6)
    assert both[4] == pytest.approx(alone[4] / 2, rel=1e-6)


def test_retained_is_the_share_that_no_fitted_column_follows():
    """At an angle of 30 degrees from the fitted direction a quarter of the square is left."""
    fitted = np.array([[1.0], [0.0]])
    column = np.array([[np.cos(np.pi / 6)], [np.sin(np.pi / 6)]])
    assert outcome(projected(column, fitted, np.array([0.0, 1.0])), None, ONES[:1]).retained == pytest.approx(0.25)


@pytest.mark.parametrize(("sign", "falls"), [(1, True), (-1, False), (None, True)])
def test_a_size_on_the_wrong_side_of_its_bound_has_no_fall(sign, falls):
    column, residual = np.array([[1.0], [2.0]]), np.array([3.0, 0.5])
    signs = None if sign is None else np.array([float(sign)])
    found = outcome(projected(column, np.zeros((2, 1)), residual), signs, ONES[:1])
    assert found.estimate[0] == pytest.approx(0.8)
    assert found.fall == pytest.approx(3.2 if falls else 0.0)
    assert (found.spectrum.evidence(1.0) > 0) is falls


def test_combined_directions_are_those_of_summed_columns(case):
    columns, fitted, residual = case
    mix = torch.tensor([[1.0], [1.0], [0.0]], dtype=torch.float64)
    one = projected(columns, fitted, residual).combined(mix)
    other = projected(columns @ mix.numpy(), fitted, residual)
    for mine, theirs in ((one.score, other.score), (one.information, other.information), (one.gram, other.gram)):
        torch.testing.assert_close(mine, theirs, rtol=1e-9, atol=1e-9)


def test_the_spectrum_is_that_of_plausible_sizes(case):
    """Whatever the units: the evidence of numbers and of what they are in units of plausible sizes is the same."""
    columns, fitted, residual = case
    size = torch.tensor([2.0, 1e-4, 10.0], dtype=torch.float64)
    mine = outcome(projected(columns, fitted, residual), None, size).spectrum
    theirs = outcome(projected(columns * size.numpy(), fitted, residual), None, ONES).spectrum
    assert mine.evidence(1.5) == pytest.approx(theirs.evidence(1.5), rel=1e-9)
    left = columns * size.numpy() - fitted @ np.linalg.lstsq(fitted, columns * size.numpy(), rcond=None)[0]
    whole = np.eye(60) * 1.5 + left @ left.T
    ratio = residual @ residual / 1.5 - residual @ np.linalg.solve(whole, residual) + 60 * np.log(1.5)
    assert mine.scaled(1.5, 1.0) == pytest.approx((ratio - np.linalg.slogdet(whole)[1]) / 2, rel=1e-8)


def test_mixes_share_one_number_over_passes_where_there_is_one_per_pass():
    per_pass = next(one for one in built_in().values() if any(p.scope == "pass" for p in one.amplitudes))
    (apart, each), (shared, sums) = mixes(per_pass, [3] * len(per_pass.amplitudes))
    assert (apart, shared) == (False, True)
    assert torch.equal(each, torch.eye(3 * len(per_pass.amplitudes), dtype=torch.float64))
    assert sums.shape == (3 * len(per_pass.amplitudes), len(per_pass.amplitudes)) and bool((sums.sum(0) == 3).all())
    plain = next(one for one in built_in().values() if all(p.scope == "one" for p in one.amplitudes))
    assert len(list(mixes(plain, [1] * len(plain.amplitudes)))) == 1


def test_only_a_null_on_a_bound_is_one_sided():
    for effect in built_in().values():
        signs = one_sided(effect, [2] * len(effect.amplitudes)).reshape(-1, 2)
        told = [1.0 if p.null == p.lower else -1.0 if p.null == p.upper else 0.0 for p in effect.amplitudes]
        assert np.array_equal(signs, np.column_stack([told, told]))


def test_of_many_numbers_those_of_a_wrong_sign_are_nothing():
    """The others are what explains most without them."""
    rng = np.random.default_rng(3)
    columns, fitted = rng.normal(size=(40, 3)), rng.normal(size=(40, 2))
    columns[:, 1] += columns[:, 0]
    data = columns @ [2.0, -1.5, -1.0]
    residual = data - fitted @ np.linalg.lstsq(fitted, data, rcond=None)[0]
    one = projected(columns, fitted, residual)
    free, found = outcome(one, None, ONES), outcome(one, np.array([1.0, 1.0, 0.0]), ONES)
    np.testing.assert_allclose(free.estimate, [2.0, -1.5, -1.0])
    without = outcome(projected(columns[:, [0, 2]], fitted, residual), None, ONES[:2])
    np.testing.assert_allclose(found.estimate, [without.estimate[0], 0.0, without.estimate[1]], atol=1e-12)
    assert found.fall == pytest.approx(without.fall) and found.fall < free.fall


@pytest.mark.parametrize(("fall", "beyond"), [(1 + NOTED * 2**0.5 - 0.01, False), (1 + NOTED * 2**0.5 + 0.01, True)])
def test_a_fall_is_noted_from_four_standard_deviations_on(fall, beyond):
    one = next(iter(built_in().values()))
    left = Spectrum(np.array([3.0]), np.array([3.0 * fall]))
    score = Score(one, {}, False, fall, 1, 20, (1,), np.ones(1), np.ones(1), 1.0, None, torch.zeros(1), left, 2.0)
    assert bool(score.beyond_noise) is beyond
    assert score.evidence == pytest.approx(left.evidence(2.0) - np.log(20))
