"""Score tests of effects at the end of a fit: each by itself, and in the shape that explains most."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from solver.criticism.directions import Directions
from solver.criticism.fields import alike
from solver.criticism.marginal import Spectrum
from solver.criticism.policy import POLICY
from solver.criticism.score import Outcome, Score, mixes, one_sided, outcome
from solver.criticism.sums import Sums
from solver.effect import Effect
from solver.fit.side_by_side import side_by_side
from solver.fit.windowed import Windowed
from solver.signal_path.extension import Extension
from solver.signal_path.local import Seen

Array = NDArray[np.float64]

#: Sizes, of plausible ones, at which the whole change by an effect is tried; and where nothing is fitted beside it.
FAR, FAR_ALONE = (1.0, 3.0), (0.5, 1.0, 2.0, 3.0)
#: What an effect of plausible size must change at least, sigmas over all samples, to be more than rounding.
FEEBLE = 0.1
#: Values of directions that are projected at once: few take as long as that many.
BATCH = 1 << 23
#: Stages whose effects are in proportion to their numbers, once tracks may shift.
NEAR_STAGES = ("trajectory", "load")
#: Shapes of a grid above which the best few are refined, how many, and in how many rounds: full fits refine the rest.
FINE, STARTS, HALVINGS = 8, 2, 1


class Made(NamedTuple):
    """Directions of one shape.

    Attributes
    ----------
    shape : values of its shape parameters
    sums : of its columns
    counts : how many numbers each amplitude has
    columns : [sample * channel + anchor, number], whitened; None where only sums were kept
    """

    shape: dict[str, float]
    sums: Sums
    counts: list[int]
    columns: Windowed | None


@dataclass(frozen=True)
class Plan:
    """What is tried of an effect.

    Parameters
    ----------
    effect : to score
    extension : with it beside what is in the model
    shapes : to try
    trials : how many there are of it
    like : makes of the model that which is differentiated
    """

    effect: Effect
    extension: Extension
    shapes: list[dict[str, float]]
    trials: int
    like: Callable[[Seen], Seen]


class Scorer(Directions):
    """Score tests of effects at the end of one fit."""

    def spectrum(self, effect: Effect, shape: dict[str, float]) -> Spectrum:
        """What the fit leaves of each of an effect's numbers, of one shape."""
        extension = self.fit.problem.extension([*self.fit.extension.effects, effect])
        columns, counts = self.columns(effect, shape, extension)
        each = torch.eye(sum(counts), dtype=torch.float64)
        sizes = sizes_of(effect, counts, each)
        return outcome(self.project([columns])[0], None, sizes, alike(effect, counts, self.tracks)).spectrum

    def scores(self, effect: Effect, near: Mapping[str, float] | None = None) -> Iterator[Score]:
        """The best shape of an effect, of all or near one, with separate and with shared numbers of passes."""
        extension = self.fit.problem.extension([*self.fit.extension.effects, effect])
        shapes, trials = effect.tried(lambda: self.heard(extension))
        fine = len(shapes) > FINE and effect.seek is None
        shapes = shapes if near is None else [dict(near)]
        tried = list(self.of_shapes(effect, shapes, extension, trials))
        for shared in {score.shared for score in tried}:
            ranked = sorted((s for s in tried if s.shared == shared), key=lambda s: -s.fall)
            if fine:
                ranked = [self.refined(s, extension, trials) if s.beyond_noise else s for s in apart(ranked)]
            yield max(ranked, key=lambda s: s.fall)

    def of_shapes(
        self,
        effect: Effect,
        shapes: Sequence[dict[str, float]],
        extension: Extension,
        trials: int,
        like: Callable[[Seen], Seen] = lambda seen: seen,
    ) -> Iterator[Score]:
        """Scores of each shape, with separate and with shared numbers of passes; none where it does nothing.

        `like` is as of `columns`.
        """
        yield from self.of_plans([Plan(effect, extension, list(shapes), trials, like)])[0]

    def of_plans(self, plans: Sequence[Plan]) -> list[list[Score]]:
        """Scores of each of some plans, as of `of_shapes`: what was fitted is read once for many shapes."""
        scores: list[list[Score]] = [[] for _ in plans]
        some: list[tuple[int, dict[str, float], Windowed, list[int]]] = []
        held = 0.0

        def score() -> None:
            found = zip(some, self.summed([one for _, _, one, _ in some]), strict=True)
            made = [(n, Made(shape, sums, counts, one)) for (n, shape, one, counts), sums in found]
            for number in dict.fromkeys(n for n, _ in made):
                plan, mine = plans[number], [one for n, one in made if n == number]
                scores[number] += self.of_made(plan.effect, mine, plan.trials)
            some.clear()

        for number, plan in enumerate(plans):
            for shape in plan.shapes:
                columns, counts = self.columns(plan.effect, shape, plan.extension, like=plan.like)
                if not feeble(plan.effect, columns.norm):
                    some.append((number, shape, columns, counts))
                    held += columns.extent * columns.rows
                if held >= BATCH:
                    score()
                    held = 0.0
        score()
        return scores

    def of_made(self, effect: Effect, made: "Sequence[Made]", trials: int) -> Iterator[Score]:
        """Scores of shapes whose directions are already computed, with the signals of the best of them."""
        found = [(score, one.columns) for one in made for score in self.of_one(effect, one, trials)]
        best = set[int]()
        for shared in {score.shared for score, _ in found}:
            mine = [number for number, (score, _) in enumerate(found) if score.shared == shared]
            best |= {max(mine, key=lambda n: found[n][0].fall), max(mine, key=lambda n: found[n][0].evidence)}
        for number, (score, columns) in enumerate(found):
            if number in best and columns is not None:
                score = replace(score, signal=self.kept(columns.times(torch.from_numpy(score.estimate))))
            yield score

    def of_one(self, effect: Effect, one: Made, trials: int) -> Iterator[Score]:
        """Scores of one shape, without their signals."""
        projected = self.left(one.sums)
        heard = projected.gram.diagonal().numpy() > projected.least
        for shared, mix in mixes(effect, one.counts):
            sizes = sizes_of(effect, one.counts, mix)
            near = None if shared else alike(effect, one.counts, self.tracks)
            signs = one_sided(effect, [1] * len(one.counts) if shared else one.counts)
            found = outcome(projected.combined(mix), signs, sizes, near)
            of = mix.argmax(1).numpy()
            estimate, sigma = found.estimate[of], np.where(heard, found.sigma[of], np.nan)
            crossed = one.sums.crossed @ torch.from_numpy(estimate)
            found = found._replace(estimate=estimate, sigma=sigma)
            yield self._score(effect, found, one.shape, shared, tuple(one.counts), trials, None, crossed)

    def _score(
        self,
        effect: Effect,
        found: Outcome,
        shape: dict[str, float],
        shared: bool,
        counts: tuple[int, ...],
        trials: int,
        signal: Windowed | None,
        crossed: Tensor,
    ) -> Score:
        numbers = counts, found.estimate, found.sigma, found.retained
        told = signal, crossed, found.spectrum, self.variance
        return Score(effect, shape, shared, found.fall, found.freedom, trials, *numbers, *told)

    def kept(self, signal: Tensor) -> Windowed:
        """A signal [sample * channel + anchor] where it acts."""
        return Windowed.of(signal[:, None], self.fit.data.shape[1])

    def refined(self, score: Score, extension: Extension, trials: int) -> Score:
        """A better shape near a score's: steps along each shape parameter, from half the grid's spacing down."""
        shapes, step = score.effect.shapes, {p.name: p.spacing / 2 for p in score.effect.shapes}
        seen = [score.shape]
        for _ in range(HALVINGS):
            for p, sign in product(shapes, (1, -1)):
                value = float(np.clip(score.shape[p.name] + sign * step[p.name], p.lower, p.upper))
                shape = score.shape | {p.name: value}
                # From where a step was taken, the one the other way leads back.
                if any(np.allclose(list(shape.values()), list(one.values()), rtol=1e-9) for one in seen):
                    continue
                seen.append(shape)
                near = self.of_shapes(score.effect, [shape], extension, trials)
                score = max([score, *(one for one in near if one.shared == score.shared)], key=lambda s: s.fall)
            step = {name: size / 2 for name, size in step.items()}
        return score

    def reaching(self, score: Score) -> Score:
        """The score of the whole change that an effect of one number makes at some size, where that says more.

        Filters along the fiber and many effects of the ground are far from linear in their number, and the route may
        hide what a small one does.
        """
        effect = score.effect
        near = effect.stage in NEAR_STAGES and not self.alone
        if effect.generic or near or [p.scope for p in effect.amplitudes] != ["one"]:
            return score
        extension = self.fit.problem.extension([*self.fit.extension.effects, effect])
        base, p = self.numbers(extension, score.shape), effect.amplitudes[0]
        where = next(slot.where for slot in extension.slots if slot.effect is effect and slot.parameter is p)
        sizes = (p.null + sign * size * p.plausible for size in (FAR_ALONE if self.alone else FAR) for sign in (1, -1))
        tried = [value for size in sizes if (value := float(np.clip(size, p.lower, p.upper))) != p.null]
        columns = []
        for value in tried:
            numbers = base.clone()
            numbers[where] = value
            columns.append(self.change(extension, base, numbers))
        for value, column, sums in zip(tried, columns, self.summed(columns), strict=True):
            step = value - p.null
            found = outcome(self.left(sums), np.ones(1), torch.tensor([p.plausible / abs(step)]).double())
            if found.fall > score.fall:
                signal = self.kept(column.times(torch.from_numpy(found.estimate)))
                crossed = sums.crossed @ torch.from_numpy(found.estimate)
                found = found._replace(estimate=step * found.estimate, sigma=abs(step) * found.sigma)
                score = self._score(effect, found, score.shape, False, score.counts, score.trials, signal, crossed)
        return score


def apart(ranked: Sequence[Score]) -> list[Score]:
    """The best few [score] that are not neighbors on the grid of shapes."""
    chosen: list[Score] = []
    for score in ranked:
        near = (
            all(abs(score.shape[p.name] - other.shape[p.name]) < 1.5 * p.spacing for p in score.effect.shapes)
            for other in chosen
        )
        if not any(near):
            chosen.append(score)
        if len(chosen) == STARTS:
            break
    return chosen


def score_all(
    scorer: Scorer,
    effects: Sequence[Effect],
    advance: Callable[[int], None] = lambda n: None,
    near: Mapping[str, Mapping[str, float]] | None = None,
) -> list[Score]:
    """Best score of every effect, highest evidence first; effects that do nothing in this survey are left out.

    Parameters
    ----------
    scorer : at a fit
    effects : to be scored
    advance : called with 1 after each
    near : shapes that the best ones are sought near, by effect; of others all shapes are tried
    """

    def best(effect: Effect) -> dict[str, Any] | None:
        ranked = sorted(scorer.scores(effect, (near or {}).get(effect.name)), key=lambda s: s.evidence)
        return figures(ranked[-1]) if ranked else None

    found = side_by_side(best, effects, advance)
    table = [Score(effect, **one) for effect, one in zip(effects, found, strict=True) if one is not None]
    if any(s.evidence > POLICY.found for s in table):
        reached = side_by_side(lambda score: figures(scorer.reaching(score)), table)
        table = [Score(score.effect, **one) for score, one in zip(table, reached, strict=True)]
    return sorted((s for s in table if s.freedom), key=lambda s: -s.evidence)


def feeble(effect: Effect, norm: float) -> bool:
    """Whether what an effect of plausible size changes is no more than rounding, by the norm of its directions."""
    return norm * max(p.plausible for p in effect.amplitudes) <= FEEBLE


def sizes_of(effect: Effect, counts: Sequence[int], mix: Tensor) -> Tensor:
    """Plausible sizes [combination] of an effect's numbers, combined over passes or each by itself.

    `counts` says how many numbers each amplitude has.
    """
    kinds = zip(effect.amplitudes, counts, strict=True)
    sizes = torch.cat([torch.full((count,), p.plausible, dtype=torch.float64) for p, count in kinds])
    return (sizes[:, None] * mix).max(0).values


def figures(score: Score) -> dict[str, Any]:
    """A score without its effect, which is code and stays where it is."""
    return {f.name: getattr(score, f.name) for f in fields(score) if f.name != "effect"}


def similarity(scorer: Scorer, one: Score, other: Score) -> float:
    """Correlation of what the fit leaves of two effects' signals, 0 to 1."""
    assert one.signal is not None and other.signal is not None
    pair = Windowed.beside([one.signal, other.signal])
    left = scorer.project([pair])[0].information
    return float(left[0, 1].abs() / (left[0, 0] * left[1, 1]).clamp_min(1e-300).sqrt())
