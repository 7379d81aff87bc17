"""The fast score of a catalogue: a few shapes of each effect, and the whole change of those that show most."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import torch

from solver.criticism.policy import POLICY
from solver.criticism.record_parts import RecordPart
from solver.criticism.score import Score
from solver.criticism.scorer import Made, Plan, Scorer, feeble, figures
from solver.criticism.sums import Sums
from solver.effect import Effect
from solver.fit.side_by_side import in_groups, side_by_side
from solver.signal_path.extension import Extension
from solver.signal_path.local import Seen
from solver.survey.memory import give_back

#: Shapes of each effect that are tried, and of those whose law takes long.
FEW, FEWEST = 4, 1
#: Effects that are scored together.
GROUP = 8


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
    plans = [planned(scorer, effect) for effect in effects]
    found = best_of(scorer, plans, advance)

    def whole(score: Score) -> dict[str, Any]:
        effect = score.effect
        extension = scorer.fit.problem.extension([*scorer.fit.extension.effects, effect])
        every = [score] if slow(scorer, extension) else [score, *scorer.scores(effect)]
        return figures(scorer.reaching(max(every, key=lambda s: s.evidence)))

    table = [Score(effect, **one) for effect, one in zip(effects, found, strict=True) if one is not None]
    best = max((s.evidence for s in table), default=0.0)
    shown = [s for s in table if s.evidence > max(POLICY.found, best / POLICY.hope)]
    again = dict(zip((s.effect.name for s in shown), side_by_side(whole, shown), strict=True))
    table = [Score(s.effect, **again[s.effect.name]) if s.effect.name in again else s for s in table]
    return sorted(table, key=lambda s: -s.evidence)


def planned(scorer: Scorer, effect: Effect) -> Plan:
    """A few of an effect's shapes, fewer of what takes long."""
    extension = scorer.fit.problem.extension([*scorer.fit.extension.effects, effect])
    shapes, trials = effect.tried(lambda: scorer.heard(extension))
    if slow(scorer, extension):
        return Plan(effect, extension, thinned(shapes, FEWEST), trials, lumped)
    return Plan(effect, extension, thinned(shapes, FEW), trials, lambda seen: seen)


def best_of(scorer: Scorer, plans: Sequence[Plan], advance: Callable[[int], None]) -> list[dict[str, Any] | None]:
    """Figures of each effect's best score, or None where it does nothing: of a long record from sums over its parts."""

    def best(scores: Iterable[Score]) -> dict[str, Any] | None:
        found = max((s for s in scores if s.freedom), key=lambda s: s.evidence, default=None)
        return None if found is None else figures(found)

    if len(scorer.parts) == 1:
        return in_groups(lambda some: [best(scores) for scores in scorer.of_plans(some)], plans, GROUP, advance)
    total: list[list[Sums]] = []
    for part in scorer.parts:
        more = side_by_side(partial(sums_of, scorer, part), plans)
        together = zip(total or more, more, strict=True)
        total = [[a.plus(b) for a, b in zip(*both, strict=True)] for both in together] if total else more
        scorer.forget()
    found = []
    for plan, sums in zip(plans, total, strict=True):
        counts = counts_of(plan)
        made = zip(plan.shapes, sums, strict=True)
        some = [Made(shape, one, counts, None) for shape, one in made if not feeble(plan.effect, one.norm)]
        found.append(best(scorer.of_made(plan.effect, some, plan.trials)))
        advance(1)
    return found


def sums_of(scorer: Scorer, part: RecordPart, plan: Plan) -> list[Sums]:
    """Sums of each shape over a part of the record."""
    sums = []
    for shape in plan.shapes:
        columns, _ = scorer.columns(plan.effect, shape, plan.extension, part, plan.like)
        if part.reach != "sample":
            # Of many samples at once: what made them is as large as they are.
            give_back()
        sums += scorer.summed([columns])
        del columns
    give_back()
    return sums


def counts_of(plan: Plan) -> list[int]:
    """How many numbers each amplitude has."""
    mine = (s for s in plan.extension.slots if s.effect is plan.effect and not s.parameter.is_shape)
    return [slot.where.stop - slot.where.start for slot in mine]


def with_signals(scorer: Scorer, table: Sequence[Score]) -> list[Score]:
    """Scores with their signals, of which a long record's were not kept."""
    bare = [(score, planned(scorer, score.effect)) for score in table if score.signal is None]
    signals = [torch.zeros(len(scorer.residual), dtype=torch.float64)] * len(bare)
    for part in scorer.parts:
        for number, (score, plan) in enumerate(bare):
            columns, _ = scorer.columns(plan.effect, score.shape, plan.extension, part, plan.like)
            signals[number] = signals[number] + columns.times(torch.from_numpy(score.estimate))
    told = {s.effect.name: scorer.kept(signal) for (s, _), signal in zip(bare, signals, strict=True)}
    return [replace(s, signal=told.get(s.effect.name, s.signal)) for s in table]


def slow(scorer: Scorer, extension: Extension) -> bool:
    """Whether an effect, the last of an extension, has a law of the ground to be evaluated at every gauge and wheel."""
    path, values = scorer.fit.path.with_effects(extension), extension.local(scorer.numbers(extension, {}))
    ground = path.described_alone(extension.slots[-1].effect, values).ground
    return any(law is not None for law in (ground.response, ground.settlement, ground.radiation))


def lumped(seen: Seen) -> Seen:
    """The model with the forces of each vehicle in one place: a law of the ground takes a quarter of the time."""
    local = seen.local
    load = local.every_load
    share = load.share.sum(-1, keepdim=True)
    position = (load.share[..., None] * load.position).sum(-2, keepdim=True) / share[..., None]
    rate = None if load.share_rate is None else load.share_rate.sum(-1, keepdim=True)
    loads = replace(load, position=position, share=share, share_rate=rate, thrust=None, thrust_rate=None)
    return replace(seen, local=replace(local, loads=loads))


def thinned(shapes: Sequence[dict[str, float]], most: int) -> list[dict[str, float]]:
    """At most so many shapes, from the middles of as many parts of a grid.

    >>> [one["place"] for one in thinned([{"place": float(n)} for n in range(8)], 4)]
    [1.0, 3.0, 5.0, 7.0]
    """
    count = min(most, len(shapes))
    return [shapes[int((n + 0.5) * len(shapes) / count)] for n in range(count)]
