"""What a full fit with a candidate stands for: its misfit, its evidence, what it may still hope for."""

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from solver.catalogue.catalogue import built_in
from solver.catalogue.trial_survey import trial_survey
from solver.criticism.bench import scorable
from solver.criticism.ending import Ending
from solver.criticism.marginal import Spectrum
from solver.criticism.policy import POLICY
from solver.criticism.refit import (
    FARTHER,
    Refit,
    as_located,
    counted,
    loss,
    misfit,
    too_large,
    with_effect,
)
from solver.criticism.score import Score
from solver.criticism.scorer import apart
from solver.criticism.sums import factor_of
from solver.effect import Parameter
from solver.fit.robust import HUBER
from solver.signal_path.extension import Slot

KNOWN = built_in()


def score(name: str, fall: float = 0.0, numbers: int = 1, trials: int = 1, **shape: float) -> Score:
    one = np.ones(numbers)
    left = Spectrum(np.full(numbers, 24.0), np.zeros(numbers))
    told = None, torch.zeros(0), left, 1.0
    return Score(KNOWN[name], shape, False, fall, numbers, trials, (numbers,), one, one, 1.0, *told)


def ended(name: str, numbers: list[float], fall: float = 100.0, *, converged: bool = True, step: float = 0.0) -> Refit:
    """A fit that ended with these numbers of the effect, in the order of its parameters; its next step predicts a fall.

    The first parameters have one number each, the last all the rest.
    """
    effect = KNOWN[name]
    parameters, first, slots = effect.parameters, 0, []
    for place, parameter in enumerate(parameters):
        count = 1 if place < len(parameters) - 1 else len(numbers) - first
        slots.append(Slot(effect, parameter, slice(first, first + count)))
        first += count
    at = SimpleNamespace(open=SimpleNamespace(decrement=step))
    state = SimpleNamespace(numbers=torch.tensor(numbers, dtype=torch.float64))
    solution: Any = SimpleNamespace(converged=converged, at=at, state=state)
    fit: Any = SimpleNamespace(extension=SimpleNamespace(slots=slots))
    return settled(Refit(score(name), fit, solution, fall, before=0.0))


def settled(refit: Refit, sharper: float = 0.0) -> Refit:
    """A fit whose numbers are told from 25 of the plausible ones, and all else by how much more sharply than before."""
    vars(refit)["ending"] = Ending(refit.score.spectrum, refit.before + sharper)
    return refit


@pytest.fixture(scope="module")
def flat() -> Any:
    """A fit whose residual is given, of 3 samples in 2 channels, that whitens nothing; its priors miss by 7."""
    return SimpleNamespace(
        whiten=lambda values: values,
        unexplained=lambda model: model,
        model=lambda state: state,
        prior=SimpleNamespace(total=lambda state: 7.0),
    )


SMALL, LARGE = 0.5 * HUBER, 3.0 * HUBER


def test_the_robust_misfit_is_a_square_and_then_a_line(flat):
    residual = torch.tensor([[SMALL, 0.0], [-LARGE, 0.0], [SMALL, -LARGE]], dtype=torch.float64)
    square, line = SMALL**2, 2 * HUBER * LARGE - HUBER**2
    found = [misfit(flat, row, torch.ones_like(row)) for row in residual[:, None]]  # type: ignore[arg-type]
    np.testing.assert_allclose(found, [square, line, square + line])
    assert loss(flat, residual, torch.ones_like(residual)) == pytest.approx(2 * square + 2 * line + 7)  # type: ignore[arg-type]


def test_the_robust_misfit_has_no_corner(flat):
    """Value and slope agree where the square ends."""
    at = torch.tensor([[HUBER - 1e-6], [HUBER], [HUBER + 1e-6]], dtype=torch.float64)
    low, middle, high = (misfit(flat, row, torch.ones_like(row)) for row in at[:, None])  # type: ignore[arg-type]
    assert middle == pytest.approx(HUBER**2)
    assert (middle - low) / 1e-6 == pytest.approx(2 * HUBER, rel=1e-5)
    assert (high - middle) / 1e-6 == pytest.approx(2 * HUBER, rel=1e-5)


def test_what_does_not_count_is_not_a_misfit(flat):
    residual = torch.tensor([[SMALL, LARGE]], dtype=torch.float64)
    first, half = torch.tensor([[1.0, 0.0]]), torch.tensor([[0.5, 0.0]])
    assert misfit(flat, residual, first) == pytest.approx(SMALL**2)  # type: ignore[arg-type]
    assert misfit(flat, residual, half) == pytest.approx((SMALL / 2) ** 2)  # type: ignore[arg-type]


def test_samples_count_less_where_the_model_is_not_sure():
    added = torch.tensor([[0.0, 3.0, 8.0]])
    fit: Any = SimpleNamespace(added_variance=lambda local, model: added)
    at: Any = SimpleNamespace(weights=SimpleNamespace(good=torch.tensor([[1.0, 1.0, 0.0]])), local=None, model=None)
    assert counted(fit, at).tolist() == [[1.0, 0.5, 0.0]]


def test_evidence_is_of_the_full_fit_and_hope_of_its_next_step():
    """Half the fall, less what the size is told from: 25 of the plausible ones."""
    done = ended("camber", [0.1], 80.0, converged=True, step=5.0)
    assert done.evidence == done.hoped == pytest.approx(40 - np.log(25) / 2)
    going = settled(replace(done, solution=ended("camber", [0.1], converged=False, step=5.0).solution))
    assert going.evidence == done.evidence
    assert going.hoped == pytest.approx(40 + POLICY.hope * 25.0 / 2 - np.log(25) / 2)
    assert done.standing(-10.0) == pytest.approx(35 - np.log(25) / 2)


def test_a_size_pays_to_its_prior_however_inexact_the_base_model_is():
    """Four times what is plausible costs eight, whatever the noise counts as."""
    p = KNOWN["camber"].parameters[0]
    one = ended("camber", [p.null + 4 * p.plausible], 80.0)
    assert one.paid == pytest.approx(16.0)
    loose = settled(replace(one, score=replace(one.score, variance=2.0)))
    assert loose.evidence == pytest.approx((80 + 16) / 2 / 2 - 8 - np.log(13) / 2)


def test_what_lets_all_else_be_told_less_sharply_is_more_probable():
    """Of a layer that the depth follows more depths are left: e-fold odds for each e-fold of all that may be."""
    one = ended("camber", [0.1], 80.0)
    assert settled(replace(one), -3.0).evidence == pytest.approx(one.evidence + 3)


def test_numbers_are_told_from_those_of_the_shape():
    name = next(n for n, one in KNOWN.items() if one.shapes and len(one.amplitudes) == 1 and not one.generic)
    effect = KNOWN[name]
    values = [10.0 + place for place in range(len(effect.parameters))]
    one = ended(name, values)
    shaped = {p.name: v for p, v in zip(effect.parameters, values, strict=True) if p.is_shape}
    sized = [v for p, v in zip(effect.parameters, values, strict=True) if not p.is_shape]
    assert one.shape == shaped and one.estimate.tolist() == sized
    assert one.single == (len(sized) == 1)


def test_a_discrepancy_model_is_never_single():
    name = next(n for n, one in KNOWN.items() if one.generic)
    assert not ended(name, [0.1] * len(KNOWN[name].parameters)).single


@pytest.mark.parametrize(("rms", "large"), [(0.9, False), (1.1, True)])
def test_many_numbers_are_too_large_by_their_root_mean_square(rms, large):
    free = Parameter("bend", "m", 0.5)
    numbers = 0.5 * POLICY.extreme * rms * np.sqrt(2) * np.sin(np.linspace(0, 2 * np.pi, 40, endpoint=False))
    assert too_large(free, numbers) is large
    assert too_large(Parameter("bend", "m", 0.5, lower=-1.0), numbers) is False, "bounds keep it"
    shifted = Parameter("bend", "m", 0.5, null=1.0)
    assert too_large(shifted, 1.0 + numbers) is large


@pytest.mark.parametrize(("size", "pushed"), [(0.5, False), (0.0, True), (1.0, True)])
def test_one_number_at_its_bound_was_pushed_there(size, pushed):
    name = next(
        n
        for n, one in KNOWN.items()
        if len(one.parameters) == 1 and np.isfinite([one.parameters[0].lower, one.parameters[0].upper]).all()
    )
    p = KNOWN[name].parameters[0]
    assert ended(name, [p.lower + size * (p.upper - p.lower)]).pushed is pushed


@dataclass(frozen=True)
class Numbers:
    """As much of a state as is moved."""

    numbers: torch.Tensor


@pytest.mark.parametrize(
    ("name", "numbers", "starts"),
    [
        ("long_vehicle", [0.3, 0.0, 0.2, 12.0], [[1.0, 1.0, 1.0, 12.0]]),
        ("gauge_length", [0.1], [[pytest.approx(-0.3)], [pytest.approx(0.3)]]),
    ],
)
def test_far_starts_are_as_far_as_is_plausible_of_all_passes(name, numbers, starts):
    """Axles over 11 m fell behind from a third of the load, and lead from all of it."""
    parameters = KNOWN[name].parameters
    slots = [Slot(KNOWN[name], parameters[0], slice(0, len(numbers) - len(parameters) + 1))]
    slots += [Slot(KNOWN[name], one, slice(len(numbers) - 1, len(numbers))) for one in parameters[1:]]
    fit: Any = SimpleNamespace(
        extension=SimpleNamespace(slots=slots), bounded=lambda state: state, settled=lambda state, weights: state
    )
    solution: Any = SimpleNamespace(state=Numbers(torch.tensor(numbers, dtype=torch.float64)))
    one = replace(ended("gauge_length", [0.1]), score=score(name), fit=fit, solution=solution)
    assert one.single
    assert [state.numbers.tolist() for state in one.extremes("weights")] == starts  # type: ignore[arg-type]
    assert not replace(one, score=score("channel_coupling")).single, "a field along the fiber"


def test_a_second_start_is_farther_from_null():
    one = ended("gauge_length", [0.12])
    state = Numbers(torch.tensor([0.12], dtype=torch.float64))
    solution: Any = SimpleNamespace(state=state)
    fit: Any = SimpleNamespace(
        extension=one.fit.extension, bounded=lambda state: state, settled=lambda state, weights: (state, weights)
    )
    there: Any = replace(one, fit=fit, solution=solution).farther("weights")  # type: ignore[arg-type]
    null = KNOWN["gauge_length"].parameters[0].null
    assert there[0].numbers.tolist() == [pytest.approx(null + FARTHER * (0.12 - null))]
    assert there[1] == "weights", "the vehicles' weights go with it"
    assert state.numbers.tolist() == [0.12], "where it ended stays"


def test_a_candidate_is_one_effect_more_and_ranked_with_more_noise_than_located():
    problem = replace(trial_survey()[0].problem, signal_noise=0.02)
    more = with_effect(with_effect(problem, KNOWN["camber"]), KNOWN["lowpass"])
    assert [one.name for one in more.effects] == [*(one.name for one in problem.effects), "camber", "lowpass"]
    assert as_located(problem).signal_noise == 0.0 and problem.signal_noise == 0.02


def test_what_is_in_the_model_is_not_scored():
    every = list(KNOWN.values())
    problem: Any = SimpleNamespace(effects=(KNOWN["camber"],), base_parts={"wheels"})
    left = {one.name for one in scorable(problem, every)}
    assert left == set(KNOWN) - {"camber", "wheel_layout"}


def grid(*places: float) -> list[Score]:
    """Scores of an effect at some values of its one shape, in steps of its grid, best first."""
    name = next(n for n, one in KNOWN.items() if len(one.shapes) == 1)
    p = KNOWN[name].shapes[0]
    return [score(name, **{p.name: p.lower + steps * p.spacing}) for steps in places]


@pytest.mark.parametrize(
    ("steps", "kept"),
    [
        ((5.0, 6.0, 4.0, 9.0), [0, 3]),  # neighbors of the best are left out
        ((5.0, 6.6), [0, 1]),
        ((5.0, 6.4), [0]),
        ((0.0, 3.0, 6.0), [0, 1]),  # no more than two
    ],
)
def test_shapes_are_refined_from_the_best_that_are_not_neighbors(steps, kept):
    scores = grid(*steps)
    assert apart(scores) == [scores[place] for place in kept]


def test_a_normal_matrix_has_its_own_factor_and_a_singular_one_that_of_nearly_it():
    torch.manual_seed(1)
    root = torch.randn(5, 5, dtype=torch.float64)
    sound = root @ root.T + torch.eye(5)
    torch.testing.assert_close(factor_of(sound), torch.linalg.cholesky(sound), rtol=0, atol=0)
    flat = root[:, :2] @ root[:, :2].T
    found = factor_of(flat - 1e-13 * torch.eye(5))
    torch.testing.assert_close(found @ found.T, flat, rtol=1e-8, atol=1e-8)
