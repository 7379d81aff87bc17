"""The posterior over explanations, on cases whose answer is known in closed form."""

import numpy as np
import pytest

from solver.criticism.explanations import KINDS, Explanation, Posterior, Weighed, priors
from solver.criticism.marginal import Spectrum
from solver.criticism.policy import POLICY, Policy
from solver.criticism.probability_figure import probability_line


def effect(name: str, evidence: float, prior: float = 0.1) -> Explanation:
    return Explanation("effect", (name,), "ground", prior, evidence)


NOTHING = Explanation("nothing", (), "", 0.5, 0.0)


def shares(posterior: Posterior) -> dict[str, float]:
    return {one.effects[0] if one.effects else one.kind: one.probability for one in posterior.weighed}


def test_a_linear_toy_has_the_posterior_of_its_densities():
    """Two columns at an angle: which of them, or nothing, made the residual, by Bayes' rule on the whole vector."""
    rng = np.random.default_rng(2)
    columns = rng.normal(size=(25, 2)) @ np.array([[1.0, 0.4], [0.0, 0.9]])
    residual = rng.normal(size=25) + 0.6 * columns[:, 0]

    def density(whole: np.ndarray) -> float:
        return float(np.exp(-residual @ np.linalg.solve(whole, residual) / 2) / np.sqrt(np.linalg.det(whole)))

    spectra = [Spectrum(np.array([c @ c]), np.array([(c @ residual) ** 2])) for c in columns.T]
    found = Posterior.of([NOTHING, *(effect(n, s.evidence(1.0)) for n, s in zip("ab", spectra, strict=True))])
    nothing, *both = (density(np.eye(25)), *(density(np.eye(25) + np.outer(c, c)) for c in columns.T))
    weights = {"nothing": 0.5 * nothing, "a": 0.1 * both[0], "b": 0.1 * both[1]}
    total = sum(weights.values())
    hidden = {name: 0.1 * min(nothing, one) for name, one in zip("ab", both, strict=True)}
    expected = {name: (weights[name] - hidden[name]) / total for name in "ab"}
    expected["nothing"] = (weights["nothing"] + sum(hidden.values())) / total
    assert shares(found) == pytest.approx(expected)
    assert sum(shares(found).values()) == pytest.approx(1.0)


def test_what_does_not_show_counts_as_nothing():
    found = Posterior.of([NOTHING, *(effect(name, evidence) for name, evidence in [("a", 0.0), ("b", -3.0)])])
    assert shares(found) == {"nothing": 1.0, "a": 0.0, "b": 0.0}
    assert found.verdict == "adequate"


def test_nothing_is_no_surer_than_the_models_are_complete():
    """Whatever a record shows of them, something may be missing that none of them imitates."""
    overlooked = Explanation("overlooked", (), "", 0.05, 0.0)
    found = shares(Posterior.of([NOTHING, overlooked, effect("a", -50.0)]))
    assert found == pytest.approx({"nothing": 0.5 / 0.55, "overlooked": 0.05 / 0.55, "a": 0.0})
    assert shares(Posterior.of([NOTHING, overlooked, effect("a", 300.0)]))["a"] == pytest.approx(1.0)


def test_evidence_of_thousands_does_not_overflow():
    found = Posterior.of([NOTHING, effect("a", 5000.0), effect("b", 5000.0 - np.log(3))])
    assert shares(found) == pytest.approx({"nothing": 0.0, "a": 0.75, "b": 0.25})


def test_something_unknown_beside_a_known_effect_counts_as_that_until_it_shows():
    """Only what the record makes more probable than the known effect alone speaks for the unknown."""

    def weighed(more: float) -> Posterior:
        stand_in = Explanation("unknown", ("d", "a"), "cable", 0.1, 300.0 + more, ("a", 300.0))
        return Posterior.of([NOTHING, effect("a", 300.0), stand_in])

    assert shares(weighed(-1.0))["a"] == pytest.approx(1.0)
    shown = shares(weighed(np.log(9.0)))
    assert shown["d"] == pytest.approx(0.8) and shown["a"] == pytest.approx(0.2)
    assert weighed(30.0).verdict == "unknown-effect"


def test_cases_of_one_name_are_added_and_the_most_probable_is_shown():
    two = Explanation("two", ("a", "b"), "ground", 0.1, 10.0 + np.log(3), ("a", 10.0))
    found = Posterior.of([NOTHING, effect("a", 10.0), two]).weighed[0]
    assert found == Weighed("two", ("a", "b"), "ground", pytest.approx(1.0, abs=1e-3))


@pytest.mark.parametrize(
    ("weighed", "verdict", "size"),
    [
        ([("nothing", 0.5), ("effect", 0.5)], "adequate", 2),
        ([("effect", 0.96), ("nothing", 0.04)], "missing-effect", 1),
        ([("effect", 0.6), ("effect", 0.37), ("unknown", 0.03)], "missing-effect", 2),
        ([("effect", 0.9), ("unknown", 0.1)], "inconclusive", 2),
        ([("effect", 0.6), ("nothing", 0.4)], "inconclusive", 2),
        ([("unknown", 0.3), ("unknown", 0.3), ("effect", 0.4)], "unknown-effect", 3),
        ([("fault", 0.99), ("nothing", 0.01)], "missing-effect", 1),
    ],
)
def test_the_verdict_is_read_off(weighed, verdict, size):
    found = Posterior(tuple(Weighed(kind, (str(n),), "", share) for n, (kind, share) in enumerate(weighed)))
    assert found.verdict == verdict
    assert len(found.smallest()) == size
    assert sum(one.probability for one in found.smallest()) >= POLICY.held


@pytest.mark.parametrize(
    ("kind", "alone", "beside", "verdict"),
    [
        # Missing with or without the unknown; beside another effect; a stand-in for a part of the unknown; not sure.
        ("effect", 0.86, ("x", "a"), "missing-effect"),
        ("effect", 0.86, ("x", "b"), "inconclusive"),
        ("effect", 0.49, ("x", "a"), "inconclusive"),
        ("two", 0.86, ("x", "a"), "inconclusive"),
        ("effect", 0.86, ("x",), "inconclusive"),
    ],
)
def test_a_known_effect_that_is_missing_either_way_is_named(kind, alone, beside, verdict):
    rest = 0.99 - alone if alone >= 0.5 else 0.47
    known, unknown = Weighed(kind, ("a",), "load", alone), Weighed("unknown", beside, "ground", rest)
    more = Weighed("overlooked", (), "", 1 - alone - rest)
    assert Posterior((known, unknown, more)).verdict == verdict


def test_prior_odds_are_spread_over_what_there_is():
    found = priors(Policy(), 40, 6, 3)
    assert set(found) == set(KINDS)
    counts = {"nothing": 1, "effect": 40, "two": 780, "fault": 3, "unknown": 6, "overlooked": 1}
    assert sum(found[kind] * counts[kind] for kind in KINDS) == pytest.approx(1.0)


def test_the_policy_is_small_and_every_number_of_it_is_explained():
    names, text = set(vars(Policy())), str(Policy.__doc__)
    assert len(names) <= 25
    explained = {name for line in text.splitlines() if " : " in line for name in line.split(" : ")[0].split(", ")}
    assert names == {name.strip() for name in explained}


def test_all_that_is_unknown_is_one_in_a_line_whatever_it_stands_beside():
    """Two stages, one of them beside an effect: their probabilities add up, and no effect is told for both."""
    twin = Weighed("unknown", ("generic_twin", "camber"), "cable", 0.2)
    echo = Weighed("unknown", ("generic_echo",), "interrogator", 0.1)
    line = probability_line([Weighed("nothing", (), "", 0.7), twin, echo], [])
    assert line == "Nothing that would show 70 %, Something unknown (cable) 30 %"
