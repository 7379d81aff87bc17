"""What explanations add to a route's corridor, on moves that are given."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from solver.catalogue.catalogue import built_in
from solver.criticism import corridor
from solver.criticism.corridor import Corridor, hidden_size, sideways
from solver.criticism.disagreement import Disagreement
from solver.criticism.explanations import Posterior, Weighed, priors
from solver.criticism.marginal import Spectrum
from solver.criticism.policy import POLICY
from solver.run.run_corridor import DISAGREEMENT

KNOWN = built_in()
#: Along x.
ROUTE = np.array([[0.0, 4.0, 1.0], [1.0, 4.0, 1.0], [2.0, 4.0, 1.0]])


def scored(name: str, size: float, information: float = 24.0, variance: float = 1.0) -> Any:
    """A score whose one number came out as so many plausible sizes."""
    plausible = KNOWN[name].amplitudes[0].plausible
    left = Spectrum(np.array([information]), np.array([(size * information) ** 2]))
    return SimpleNamespace(
        effect=KNOWN[name],
        counts=(1,),
        estimate=np.array([size * plausible]),
        sigma=np.ones(1),
        spectrum=left,
        variance=variance,
    )


def added(
    monkeypatch: pytest.MonkeyPatch,
    moves: dict[str, np.ndarray],
    sizes: dict[str, float],
    *weighed: Weighed,
    away: np.ndarray | None = None,
) -> Any:
    """What is added where each effect, which came out as so large, moves the route so."""
    monkeypatch.setattr(corridor, "moves", lambda bench, name, tried: moves[name])
    monkeypatch.setattr(corridor, "route_of", lambda fit, state: ROUTE)
    problem = SimpleNamespace(channel=np.array([4, 5, 6]))
    bench: Any = SimpleNamespace(
        table=[scored(name, size) for name, size in sizes.items()],
        scorer=SimpleNamespace(fit=SimpleNamespace(problem=problem), state=None),
    )
    return Corridor.of(bench, {}, Posterior(weighed), away)


def test_an_explanation_adds_its_move_as_probable_as_it_is(monkeypatch):
    move = np.array([[0.0, 1.0, 0.0], [0.0, 2.0, 0.5], [0.0, 0.0, 0.0]])
    weighed = Weighed("effect", ("lowpass",), "interrogator", 0.8), Weighed("nothing", (), "", 0.2)
    found = added(monkeypatch, {"lowpass": move}, {"lowpass": 1.0}, *weighed)
    np.testing.assert_allclose(found.covariance[1], 0.8 * np.outer(move[1], move[1]))
    assert (found.widest, found.share) == ("lowpass", 1.0)
    assert found.at(np.array([0, 5, 9]))[:, 1, 1].tolist() == pytest.approx([0.8, 3.2, 0.0])


def test_a_fit_that_ends_elsewhere_than_the_corridors_route_counts_as_that_far_away(monkeypatch):
    """Whether nothing is missing or an effect is."""
    move, away = np.tile([0.0, 1.0, 0.0], (3, 1)), np.tile([0.0, 0.5, 0.0], (3, 1))
    weighed = Weighed("effect", ("lowpass",), "interrogator", 0.6), Weighed("nothing", (), "", 0.4)
    found = added(monkeypatch, {"lowpass": move}, {"lowpass": 1.0}, *weighed, away=away)
    np.testing.assert_allclose(found.covariance[:, 1, 1], 0.6 * 1.5**2 + 0.4 * 0.5**2)


def test_what_moves_the_route_along_itself_is_not_what_widens_its_corridor(monkeypatch):
    moves = {"lowpass": np.tile([0.0, 0.1, 0.0], (3, 1)), "gauge_length": np.tile([9.0, 0.0, 0.0], (3, 1))}
    weighed = [Weighed("effect", (name,), "interrogator", 0.5) for name in moves]
    found = added(monkeypatch, moves, dict.fromkeys(moves, 1.0), *weighed)
    assert (found.widest, found.share) == ("lowpass", 1.0)


def test_the_corridor_of_a_certain_explanation_holds_the_route_that_it_leads_to(monkeypatch):
    move = np.tile([0.0, 1.4, 0.3], (3, 1))
    found = added(monkeypatch, {"lowpass": move}, {"lowpass": 1.0}, Weighed("effect", ("lowpass",), "", 1.0))
    sigma = np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2))
    assert (np.abs(move) <= 1.96 * sigma + 1e-12).all()


def test_what_is_too_small_to_show_adds_its_plausible_move_as_probable_as_it_was_before(monkeypatch):
    """The survey tells a plausible size to a fifth: a twenty-fifth of its square is left open."""
    move = np.tile([0.0, 0.3, 0.0], (3, 1))
    found = added(monkeypatch, {"lowpass": 0.1 * move}, {"lowpass": 0.1}, Weighed("nothing", (), "", 1.0))
    expected = priors(POLICY, 1, 1, 1)["effect"] / 25 * 0.09
    np.testing.assert_allclose(found.covariance[:, 1, 1], expected)


def test_a_discrepancy_model_that_does_not_show_adds_nothing(monkeypatch):
    move = np.ones((3, 3))
    found = added(monkeypatch, {"generic_delay": move}, {"generic_delay": 0.1}, Weighed("nothing", (), "", 1.0))
    assert not found.covariance.any() and (found.widest, found.share) == ("", 0.0)


def test_what_came_out_as_nothing_is_left_out_not_infinite():
    assert hidden_size(scored("lowpass", 0.0)) == 0.0
    assert hidden_size(scored("lowpass", 0.2)) == pytest.approx(1 / 25 / 0.04)
    assert hidden_size(scored("lowpass", 0.2, variance=6.0)) == pytest.approx(6 / 30 / 0.04)


def test_a_fault_that_is_mended_moves_the_route_too():
    across = sideways(ROUTE[:2])
    small = Corridor(np.arange(2), np.tile(np.diag([9.0, 0.01, 0.0]), (2, 1, 1)), across, "lowpass", 1.0)
    found = small.with_move("cycle_skips", np.tile([0.0, 0.5, 0.0], (2, 1)))
    assert found.covariance[0].diagonal().tolist() == pytest.approx([9.0, 0.26, 0.0])
    assert found.widest == "cycle_skips" and found.share == pytest.approx(0.25 / 0.26)
    still = small.with_move("cycle_skips", np.tile([0.0, 0.05, 0.0], (2, 1)))
    assert still.widest == "lowpass" and still.share == pytest.approx(0.8)
    doubted = small.with_move("cycle_skips", np.tile([0.0, 0.5, 0.0], (2, 1)), 0.2)
    assert doubted.covariance[0, 1, 1] == pytest.approx(0.01 + 0.2 * 0.25)


def test_numbers_of_vehicles_that_did_not_pass_widen_nothing():
    """An effect with a number per vehicle class, one of which passed and is heard as above."""
    one = scored("lowpass", 0.2)
    one.counts, one.sigma = (3,), np.array([np.nan, 1.0, np.nan])
    one.estimate = np.array([0.0, one.estimate[0], 0.0])
    one.spectrum = Spectrum(np.array([0.0, 0.0, 24.0]), np.zeros(3))
    assert hidden_size(one) == pytest.approx(1 / 25 / 0.04)


def test_vehicles_may_disagree_with_the_model_of_each_explanation(monkeypatch):
    """With the fitted one as far as the route stays, with a fit in full where there is one, with a score else."""
    factors = {"scorer": 5.0, "lowpass": 3.0, "shear_lag": 2.0}
    monkeypatch.setattr(corridor, "Directions", lambda fit, state, variance: fit)
    own = np.tile(np.eye(3), (2, 1, 1))

    def of(there: Any, score: Any = None) -> Disagreement:
        return Disagreement(factors[there.name if score is None else score.effect.name], own)

    monkeypatch.setattr(Disagreement, "of", of)
    scorer = SimpleNamespace(name="scorer", variance=1.0)
    bench: Any = SimpleNamespace(scorer=scorer, table=[scored("lowpass", 1.0), scored("shear_lag", 1.0)])
    solution = SimpleNamespace(state=None)
    tried: Any = {"lowpass": SimpleNamespace(fit=SimpleNamespace(name="lowpass"), solution=solution)}
    weighed = (
        Weighed("effect", ("lowpass",), "interrogator", 0.5),
        Weighed("effect", ("shear_lag",), "cable", 0.2),
        Weighed("effect", ("gauge_length",), "interrogator", 0.01),
        Weighed("overlooked", (), "", 0.1),
        Weighed("unknown", ("generic_delay",), "interrogator", 0.1),
        Weighed("nothing", (), "", 0.09),
    )
    plain = Corridor(np.arange(2), np.zeros((2, 3, 3)), sideways(ROUTE[:2]), "", 0.0)
    found = plain.with_disagreement(bench, tried, Posterior(weighed))
    np.testing.assert_allclose(found.covariance, (0.29 * 4 + 0.5 * 2 + 0.2 * 1) * own)
    assert (found.widest, found.share) == (DISAGREEMENT, 1.0)
