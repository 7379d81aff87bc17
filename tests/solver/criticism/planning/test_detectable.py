"""From what size on an effect shows, on scores written out."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from solver.catalogue.catalogue import built_in
from solver.criticism.marginal import Spectrum
from solver.criticism.planning.detectable import SHAPES, detectable, of, smallest
from solver.criticism.score import Score
from solver.effect import Setting

KNOWN = built_in()
SETTING = Setting(10.0, 1.0, x=20.0, along=20.0)


class Scores:
    """A scorer whose scores of one number have these sigmas, shape by shape; none where there are none."""

    variance = 1.0

    def __init__(self, *sigmas: float, variance: float = 1.0) -> None:
        self.sigmas, self.variance = sigmas, variance
        self.tried: list[dict[str, float]] = []
        problem = SimpleNamespace(extension=lambda effects: None, effects=(), base_parts=frozenset())
        self.fit = SimpleNamespace(problem=problem, extension=SimpleNamespace(effects=()))

    def heard(self, extension: Any) -> None:
        return None

    def of_shapes(self, effect: Any, shapes: list[dict[str, float]], extension: Any, trials: int) -> list[Score]:
        self.tried += shapes
        left, zero = Spectrum(np.ones(1), np.zeros(1)), torch.zeros(0)
        return [
            Score(
                effect,
                {},
                False,
                0.0,
                int(s > 0),
                trials,
                (1,),
                np.zeros(1),
                np.array([s]),
                s,
                None,
                zero,
                left,
                self.variance,
            )
            for s in self.sigmas
        ]


@pytest.mark.parametrize(("share", "visible"), [(0.49, "yes"), (0.51, "large"), (2.9, "large"), (3.1, "no")])
def test_an_effect_is_visible_by_its_usual_size(share: float, visible: str) -> None:
    effect = KNOWN["gauge_length"]
    p = effect.amplitudes[0]
    found = of(effect, SETTING, p.null, p.plausible, share * p.plausible, 0.3)
    assert found.visible == visible and found.retained_share == 0.3
    assert found.size / found.plausible == pytest.approx(share)
    assert (found.effect, found.title, found.stage) == (effect.name, effect.title, effect.stage)


def test_the_size_is_that_of_the_middle_shape_at_five_sigma() -> None:
    """Of 0.1, 0.2 and 0.9 of the plausible size the second, whatever their order."""
    effect = KNOWN["clock_offset"]
    p = effect.amplitudes[0]
    for order in ((0.9, 0.1, 0.2), (0.1, 0.2, 0.9)):
        scorer: Any = Scores(*(one * p.plausible for one in order))
        found = smallest(scorer, effect, SETTING)
        assert found.size / found.plausible == pytest.approx(5 * 0.2)
        assert found.retained_share == pytest.approx(0.2 * p.plausible)


def test_an_inexact_law_hides_more() -> None:
    effect = KNOWN["clock_offset"]
    p = effect.amplitudes[0]
    exact: Any = Scores(0.1 * p.plausible)
    loose: Any = Scores(0.1 * p.plausible, variance=4.0)
    assert smallest(loose, effect, SETTING).size == pytest.approx(2 * smallest(exact, effect, SETTING).size)


def test_no_size_shows_of_what_does_nothing() -> None:
    nothing: Any = Scores()
    found = smallest(nothing, KNOWN["gauge_length"], SETTING)
    assert (found.size, found.visible, found.retained_share) == (np.inf, "no", 0.0)


def test_no_size_shows_where_the_route_can_do_the_same() -> None:
    """A score that adds no number has no sigma either: that is no proof that any size would show."""
    effect = KNOWN["slack_spool"]
    p = effect.amplitudes[0]
    assert smallest(Scores(0.0, 0.0), effect, SETTING).visible == "no"  # type: ignore[arg-type]
    some: Any = Scores(0.0, 0.1 * p.plausible, 0.2 * p.plausible)
    assert smallest(some, effect, SETTING).size == pytest.approx(5 * 0.2 * p.plausible)


def test_a_few_shapes_of_the_grid_are_tried_from_end_to_end() -> None:
    effect = KNOWN["slack_spool"]
    shapes, _ = effect.tried(lambda: None)  # type: ignore[arg-type, return-value]
    assert effect.seek is None and len(shapes) > SHAPES
    scorer: Any = Scores(1.0)
    smallest(scorer, effect, SETTING)
    assert len(scorer.tried) == SHAPES
    assert scorer.tried[0] == shapes[0] and scorer.tried[-1] == shapes[-1]


def test_discrepancy_models_are_not_asked_for() -> None:
    scorer: Any = Scores(1.0)
    asked = [KNOWN["generic_gain"], KNOWN["clock_offset"], KNOWN["gauge_length"]]
    assert [one.effect for one in detectable(scorer, asked, SETTING)] == ["clock_offset", "gauge_length"]
