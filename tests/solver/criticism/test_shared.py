"""One cause along all of a fiber, or each stretch its own."""

import pytest

from solver.catalogue.plain_words import Told
from solver.criticism.explanations import Weighed
from solver.criticism.shared import Shared, pooled

KNOWN = 50


def stretch(**probable: float) -> list[Weighed]:
    """Explanations of a stretch: effects by name, the rest is nothing."""
    found = [Weighed("effect", (name,), "interrogator", share) for name, share in probable.items()]
    return [*found, Weighed("nothing", (), "", 1 - sum(probable.values()))]


def test_what_hardly_shows_in_each_stretch_shows_in_all_of_them_together() -> None:
    found = Shared.of([stretch(gauge=0.3, coupling=0.01)] * 4, KNOWN)
    assert found.weighed[0].effects == ("gauge",) and found.weighed[0].probability > 0.95 and found.alike > 0.9
    assert sum(one.probability for one in found.weighed) == pytest.approx(1)


def test_nothing_in_all_stretches_is_nothing_together() -> None:
    found = Shared.of([stretch(gauge=0.001)] * 3, KNOWN)
    assert found.weighed[0].kind == "nothing" and found.weighed[0].probability > 0.99 and found.alike > 0.5


def test_stretches_that_lack_different_effects_are_not_alike() -> None:
    found = Shared.of([stretch(gauge=0.9999, coupling=1e-5), stretch(gauge=1e-5, coupling=0.9999)], KNOWN)
    assert found.alike < 0.1


def test_an_effect_that_acts_on_nothing_in_a_stretch_is_neither_supported_nor_spoken_against_there() -> None:
    alone = Shared.of([stretch(slip=0.99)], KNOWN)
    both = Shared.of([stretch(slip=0.99), stretch()], KNOWN)
    odds = [one.weighed[0].probability / (1 - one.weighed[0].probability) for one in (alone, both)]
    assert both.weighed[0].effects == ("slip",) and odds[1] == pytest.approx(odds[0])


def test_something_unknown_is_shared_by_its_stage_and_pairs_by_what_explains_most() -> None:
    unknown = [Weighed("unknown", (f"generic_{n}",), "ground", 0.999) for n in "ab"]
    assert Shared.of([[one, Weighed("nothing", (), "", 0.001)] for one in unknown], KNOWN).weighed[0].stage == "ground"
    pair = [Weighed("two", ("gauge", "slip"), "interrogator", 0.999), Weighed("nothing", (), "", 0.001)]
    best = Shared.of([pair, stretch(gauge=0.999)], KNOWN).weighed[0]
    assert (best.kind, best.effects) == ("effect", ("gauge",))


def test_probabilities_that_were_rounded_to_zero_are_no_error() -> None:
    found = Shared.of([stretch(gauge=1.0)] * 3, KNOWN)
    assert found.weighed[0].effects == ("gauge",) and found.alike == pytest.approx(1, abs=1e-3)


def test_sizes_are_pooled_by_their_precision() -> None:
    told = [Told("", "", size, sigma, 0.0, "m") for size, sigma in ((10.0, 0.1), (10.4, 0.2))]
    mean, sigma, scatter = pooled(told)
    assert (
        mean == pytest.approx(10.08)
        and sigma == pytest.approx(0.0894, abs=1e-4)
        and scatter == pytest.approx(1.789, abs=1e-3)
    )
    assert pooled(told[:1]) == pytest.approx((10.0, 0.1, 0.0))
