"""Which effects a planned survey could see, by the linear algebra of the score test."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from solver.catalogue.plain_words import told
from solver.criticism.bench import scorable
from solver.criticism.candidate import first_kind, score_candidate
from solver.criticism.scorer import Scorer
from solver.effect import Effect, Setting
from solver.fit.side_by_side import side_by_side

#: Shapes of an effect that are tried: its size is told for the middle one of them.
SHAPES = 5


@dataclass(frozen=True)
class Detectable:
    """The smallest size of an effect that a planned survey would show.

    Parameters
    ----------
    effect, title, stage : as in the catalogue
    size : smallest that shows at 5 sigma, in `unit`; infinite where no size would
    unit : that people know
    plausible : the usual size, in `unit`
    visible : "yes" where half the usual size shows, "large" where three times the usual size does, else "no"
    retained_share : of its signal that the route does not take up
    """

    effect: str
    title: str
    stage: str
    size: float
    unit: str
    plausible: float
    visible: str
    retained_share: float


def detectable(
    scorer: Scorer, effects: Sequence[Effect], setting: Setting, advance: Callable[[int], None] = lambda n: None
) -> list[Detectable]:
    """The smallest size of each physical effect that is not in the model, by stage as the catalogue has them."""
    asked = [one for one in scorable(scorer.fit.problem, effects) if not one.generic]
    return side_by_side(lambda one: smallest(scorer, one, setting), asked, advance)


def smallest(scorer: Scorer, effect: Effect, setting: Setting) -> Detectable:
    """The smallest size of one effect that shows: the median over some of its shapes."""
    extension = scorer.fit.problem.extension([*scorer.fit.extension.effects, effect])
    shapes, trials = effect.tried(lambda: scorer.heard(extension))
    few = np.unique(np.linspace(0, len(shapes) - 1, SHAPES).round().astype(int))
    scores = list(scorer.of_shapes(effect, [shapes[i] for i in few], extension, trials))
    parameter = effect.amplitudes[0]
    if not any(one.freedom for one in scores):  # the route, or all that is fitted, can do the same
        return of(effect, setting, parameter.null, parameter.plausible, np.inf, 0.0)
    fewest = min(one.freedom for one in scores if one.freedom)
    sizes = [score_candidate(one, None).detectable_size if one.freedom else np.inf for one in scores]
    found = sorted((size, i) for i, size in enumerate(sizes) if scores[i].freedom in (0, fewest))
    size, middle = found[(len(found) - 1) // 2]
    parameter, _ = first_kind(scores[middle])
    return of(effect, setting, parameter.null, parameter.plausible, size, scores[middle].retained)


def of(effect: Effect, setting: Setting, null: float, plausible: float, size: float, retained: float) -> Detectable:
    """What is told of the smallest size of an effect."""
    shown, usual = (told(effect, setting, estimate=null, sigma=1.0, detectable=one) for one in (size, plausible))
    visible = "yes" if size < 0.5 * plausible else "large" if size < 3 * plausible else "no"
    return Detectable(
        effect.name, effect.title, effect.stage, shown.detectable, shown.unit, usual.detectable, visible, retained
    )
