"""The network with the default's likelihood ends where the default does."""

import numpy as np
import pytest
from simulated import case_of

from solver.fit.spline import fit_spline
from solver.published.whitened_network import STEPS, fit_whitened_network
from solver.run.methods import METHODS, method_of
from solver.simulator import Scenario, simulate
from vision.contract import InputError


def test_it_ends_where_the_spline_does() -> None:
    case = case_of(simulate(Scenario(seed=3, view=(0.0, 40.0), channels=121, passes=3, snr_db=12.0)))
    steps = list[int]()
    found, spline = fit_whitened_network(case.problem, steps.append), fit_spline(case.problem)
    assert found.converged and len(steps) == found.iterations == 5 * STEPS
    assert found.cost == pytest.approx(spline.cost, abs=0.5)
    off = np.abs(found.route - spline.route) / spline.sigma
    assert off.max() < 0.3
    assert found.sigma == pytest.approx(spline.sigma, rel=0.1)


def test_one_round_is_not_enough_and_says_so() -> None:
    case = case_of(simulate(Scenario(seed=3, view=(0.0, 30.0), channels=111, passes=2, snr_db=20.0)))
    assert not fit_whitened_network(case.problem, rounds=1).converged


@pytest.mark.parametrize(
    ("method", "likelihood", "said"),
    [
        ("splines", None, "--method splines: not known; choose one of spline, network"),
        ("network-whitened", None, "--method network-whitened: not known"),
        ("network", "white", "--likelihood white: not known; choose one of published, whitened"),
        ("spline", "whitened", "--likelihood whitened: is for --method network"),
    ],
)
def test_what_is_not_known_is_one_line(method: str, likelihood: str | None, said: str) -> None:
    with pytest.raises(InputError, match=said):
        method_of(method, likelihood)
    assert {method_of("spline"), method_of("network"), method_of("network", "whitened")} == set(METHODS)
