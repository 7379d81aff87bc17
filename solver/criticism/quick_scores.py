"""The fast score of a catalogue: a few shapes of each effect, and the whole change of those that show most."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from solver.criticism.policy import POLICY
from solver.criticism.score import Score
from solver.criticism.scorer import Scorer, figures
from solver.effect import Effect
from solver.fit.side_by_side import side_by_side
from solver.signal_path.derivatives import Seen, described_alone
from solver.signal_path.extension import Extension

#: Shapes of each effect that are tried, and of those whose law takes long.
FEW, FEWEST = 4, 1


def quick_scores(
    scorer: Scorer, effects: Sequence[Effect], advance: Callable[[int], None] = lambda n: None
) -> list[Score]:
    """A score of every effect, highest evidence first; effects that do nothing in this survey are left out.

    Where an effect is and how wide matters little for how far the route may follow one that is too small to show. Of
    what shows, all shapes are tried where that does not take long, and the whole change where it is one number's.

    Parameters
    ----------
    scorer : at the fit
    effects : to score
    advance : called with 1 after each
    """

    def first(effect: Effect) -> dict[str, Any] | None:
        extension = scorer.fit.problem.extension([*scorer.fit.extension.effects, effect])
        shapes, trials = effect.tried(lambda: scorer.heard(extension))
        few, seen = (FEWEST, lumped(scorer.seen(extension))) if slow(scorer, extension) else (FEW, None)
        found = scorer.of_shapes(effect, thinned(shapes, few), extension, trials, seen)
        best = max((s for s in found if s.freedom), key=lambda s: s.evidence, default=None)
        return None if best is None else figures(best)

    def whole(score: Score) -> dict[str, Any]:
        effect = score.effect
        extension = scorer.fit.problem.extension([*scorer.fit.extension.effects, effect])
        every = [score] if slow(scorer, extension) else [score, *scorer.scores(effect)]
        return figures(scorer.reaching(max(every, key=lambda s: s.evidence)))

    found = side_by_side(first, effects, advance)
    table = [Score(effect, **one) for effect, one in zip(effects, found, strict=True) if one is not None]
    best = max((s.evidence for s in table), default=0.0)
    shown = [s for s in table if s.evidence > max(POLICY.found, best / POLICY.hope)]
    again = dict(zip((s.effect.name for s in shown), side_by_side(whole, shown), strict=True))
    table = [Score(s.effect, **again[s.effect.name]) if s.effect.name in again else s for s in table]
    return sorted(table, key=lambda s: -s.evidence)


def slow(scorer: Scorer, extension: Extension) -> bool:
    """Whether an effect, the last of an extension, has a law of the ground to be evaluated at every gauge and wheel."""
    seen, values = scorer.seen(extension), extension.local(scorer.numbers(extension, {}))
    ground = described_alone(seen.path, extension.slots[-1], values).ground
    return any(law is not None for law in (ground.response, ground.settlement, ground.radiation))


def lumped(seen: Seen) -> Seen:
    """The model with the forces of each vehicle in one place: a law of the ground takes a quarter of the time."""
    by = seen.local.by
    share = by.load.share.sum(-1, keepdim=True)
    position = (by.load.share[..., None] * by.load.position).sum(-2, keepdim=True) / share[..., None]
    rate = None if by.load.share_rate is None else by.load.share_rate.sum(-1, keepdim=True)
    load = replace(by.load, position=position, share=share, share_rate=rate, thrust=None, thrust_rate=None)
    return replace(seen, local=replace(seen.local, by=replace(by, load=load)))


def thinned(shapes: Sequence[dict[str, float]], most: int) -> list[dict[str, float]]:
    """At most so many shapes, from the middles of as many parts of a grid.

    >>> [one["place"] for one in thinned([{"place": float(n)} for n in range(8)], 4)]
    [1.0, 3.0, 5.0, 7.0]
    """
    count = min(most, len(shapes))
    return [shapes[int((n + 0.5) * len(shapes) / count)] for n in range(count)]
