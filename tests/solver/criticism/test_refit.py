"""What full fits with a candidate are trusted with."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from roadfiber import growing
from solver.cable.cable import Cable
from solver.catalogue.catalogue import built_in
from solver.catalogue.trial_survey import trial_survey
from solver.criticism.candidate import score_candidate
from solver.criticism.ending import Ending
from solver.criticism.marginal import Spectrum
from solver.criticism.race import race
from solver.criticism.refit import Refit, with_effect
from solver.criticism.score import Score
from solver.criticism.scorer import Scorer
from solver.criticism.verdict_words import ADVICE
from solver.effect import FAMILIES, Parameter, Surroundings, effect
from solver.fit.least_squares import solve
from solver.fit.map_fit import MapFit
from solver.fit.posterior import Posterior
from solver.signal_path.extension import Slot, Values


def tried(name: str, fall: float) -> Refit:
    """A candidate whose full fit lowered the misfit by so much."""
    one = np.array([1.0])
    left = Spectrum(np.ones(1), np.full(1, fall))
    score = Score(built_in()[name], {}, False, fall, 1, 1, (1,), one, one, 1.0, None, torch.zeros(0), left, 1.0)
    with_it: Any = SimpleNamespace(fit="with", solution=SimpleNamespace(state=None))
    return settled(Refit(score, with_it.fit, with_it.solution, fall, before=0.0))


def settled(found: Refit) -> Refit:
    """A full fit that paid nothing, and ended with one number told from those plausible as its score says."""
    vars(found)["paid"] = 0.0
    vars(found)["ending"] = Ending(found.score.spectrum, 0.0)
    return found


def test_a_full_fit_gives_the_sigma_and_the_score_what_would_have_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    found = tried("gauge_length", 41.0)
    monkeypatch.setattr(Refit, "estimate", property(lambda self: np.array([1.0])))
    monkeypatch.setattr(Refit, "sigma", property(lambda self: np.array([0.02])))
    monkeypatch.setattr(Refit, "shape", property(lambda self: {}))
    said = score_candidate(found.score, found)
    assert (said.verdict, said.sigma) == ("present", 0.02)
    # What would have shown is as the score test says: 5 sigmas of 1 are beyond the effect's bounds, those of 0.05 not.
    assert said.detectable_size == float("inf")
    sharper = replace(found.score, sigma=np.array([0.05]))
    assert score_candidate(sharper, found).detectable_size == pytest.approx(0.25)


@pytest.mark.parametrize(
    ("fall", "decrement", "more", "goes_on"),
    [
        (20.0, 9.0, 0.0, True),  # its next steps are large
        (20.0, 2.0, 90.0, True),  # small ones, which go on
        (20.0, 2.0, 30.0, False),
        (-900.0, 2.0, np.inf, True),  # too early to tell
    ],
)
def test_a_fit_goes_on_as_long_as_it_may_lead(fall: float, decrement: float, more: float, goes_on: bool) -> None:
    """Where the score test says that it may: a layer's fit falls slowly, and had been given up."""
    ended: Any = SimpleNamespace(converged=False, at=SimpleNamespace(open=SimpleNamespace(decrement=decrement)))
    found = tried("layered_ground", 200.0)
    one = settled(replace(found, fall=fall, solution=ended))
    assert one.may_reach(30.0, more) is goes_on
    doubtful = settled(replace(one, score=tried("layered_ground", 10.0).score))
    assert doubtful.may_reach(30.0, more) is (decrement == 9.0)


@pytest.mark.parametrize(
    ("name", "numbers", "impossible"),
    [
        ("track_bend", [2.0, -1.8, 2.2, -2.3], True),
        ("track_bend", [2.0, -0.3, 0.2, -0.3], False),
        # What has bounds keeps to them; one number may surprise.
        ("braking", [0.6, 0.5, 0.6, 0.5], False),
        ("clock_offset", [0.5], False),
        ("poisson_ratio", [built_in()["poisson_ratio"].parameters[0].upper], True),
    ],
)
def test_a_size_that_cannot_be(name: str, numbers: list[float], impossible: bool) -> None:
    """A bend of all tracks by two meters had been named where the road's roughness had moved the route."""
    found = tried(name, 1000.0)
    slot = Slot(found.effect, found.effect.parameters[0], slice(0, len(numbers)))
    fit: Any = SimpleNamespace(extension=SimpleNamespace(slots=[slot]))
    solution: Any = SimpleNamespace(state=SimpleNamespace(numbers=torch.tensor(numbers, dtype=torch.float64)))
    assert replace(found, fit=fit, solution=solution).pushed is impossible


def test_every_family_comes_with_how_to_separate_it() -> None:
    assert set(ADVICE) == set(FAMILIES)


@effect(
    "ripple",
    "cable",
    [Parameter("wavenumber", "1/m", 0.05, lower=0, upper=1)],
    physics="The gain swings along the fiber.",
    source="made for this test",
)
def ripple(cable: Cable, p: Values, survey: Surroundings) -> Cable:
    """The misfit has many minima in the wavenumber."""
    swing = torch.sin(p["wavenumber"] * (survey.distance - survey.distance.mean()))
    return replace(cable, gain=cable.gain * (1 + 0.6 * swing))


def test_a_fit_that_ends_short_begins_again_farther_off() -> None:
    sound, truth = trial_survey()
    with_it = MapFit(with_effect(sound.problem, ripple))
    signal = with_it.model(replace(truth, numbers=torch.tensor([0.11], dtype=torch.float64))).numpy()
    level = float(np.sqrt(np.mean(signal**2))) / 10
    record = level * np.random.default_rng(1).normal(size=sound.problem.record.shape)
    record[sound.problem.traffic.samples] += signal
    fit = MapFit(replace(sound.problem, record=record, noise=torch.full_like(sound.problem.noise, level)))
    scorer = Scorer(fit, solve(fit, fit.start()).state)
    (score,) = scorer.scores(ripple)
    # From where the score test leads there is a minimum between it and the truth.
    assert score.estimate[0] < 0.03
    assert race(scorer, [score])["ripple"].estimate[0] == pytest.approx(0.11, abs=0.002)


def test_the_clocks_sigma_grows_with_the_misfit_as_those_of_a_run_do(monkeypatch: pytest.MonkeyPatch) -> None:
    fit, state = trial_survey()
    rng = np.random.default_rng(0)
    model = fit.model(state).detach().numpy()
    record = fit.problem.record.copy()
    record[fit.problem.traffic.samples] = model + rng.normal(size=model.shape)
    at = MapFit(replace(fit.problem, record=record)), state
    monkeypatch.setattr(growing, "fitted", lambda run: at)
    sigmas = []
    for size in (1.0, 3.0):
        monkeypatch.setattr(Posterior, "scale", size**2)
        sigmas.append(growing.clock_offset(SimpleNamespace())[1])  # type: ignore[arg-type]
    assert sigmas[1] == pytest.approx(3 * sigmas[0]) and sigmas[0] > 0
