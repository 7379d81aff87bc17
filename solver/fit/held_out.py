"""How well a route found from some passes explains the passes it never saw."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
import torch

from solver.extension import Slot
from solver.fit.chain import Chain, Link
from solver.fit.least_squares import solve
from solver.fit.map_fit import MapFit, vehicles_of
from solver.fit.problem import Problem
from solver.fit.state import State
from solver.fit.windows import FIRST, is_long, nearby, part, parts, some
from solver.trajectory import Pass

FOLDS = 2
#: Scopes of numbers that single passes have of their own.
SINGLE = ("pass", "track")
#: Standard deviations of chi2 from its mean at which an effect shows in the passes that are seen.
SHOWN = 2.0


def own_samples(link: Link, others: Sequence[Pass]) -> torch.Tensor:
    """Samples [sample] of a link in which no other vehicle is within reach."""
    problem = link.fit.problem
    near = [found.rows for one in others if (found := nearby(one, problem.start)) is not None]
    mine = np.unique(np.concatenate([one.rows for one in problem.passes]))
    rest = np.concatenate([np.setdiff1d(problem.traffic.samples, mine), *near])
    return torch.from_numpy(~np.isin(problem.traffic.samples, rest))


def in_both(chain: Chain, new: Chain) -> Iterator[tuple[Slot, torch.Tensor, torch.Tensor]]:
    """Parameters of the effects that two chains share, and where the numbers of each hold them."""
    known = {(s.effect.name, s.parameter.name): at for s, at in zip(slots_of(chain), chain.slots, strict=True)}
    for slot, here in zip(slots_of(new), new.slots, strict=True):
        if (old := known.get((slot.effect.name, slot.parameter.name))) is not None:
            yield slot, old, here


def slots_of(chain: Chain) -> Sequence[Slot]:
    """Parameters of the effects in a chain."""
    return chain.links[0].fit.extension.slots


def shared_numbers(chain: Chain, state: State, new: Chain) -> torch.Tensor:
    """Numbers of the effects that all passes share, for a fit of other passes; those of single passes at their null."""
    numbers = new.prior.numbers.clone()
    for slot, old, here in in_both(chain, new):
        if slot.parameter.scope not in SINGLE and len(old) == len(here):
            numbers[here] = state.numbers[old]
    return numbers


def unshown(fit: MapFit, state: State) -> list[str]:
    """Effects, the same for all passes, that a fit cannot tell from none (test of Wald 1943, Trans. AMS 54, 426)."""
    common = [one for one in fit.extension.effects if all(p.scope not in SINGLE for p in one.amplitudes)]
    if not common:
        return []
    covariance = torch.linalg.inv(fit.normal(state)[0])
    place = torch.full((len(fit.mean),), -1)
    place[fit.free] = torch.arange(int(fit.free.sum()))
    place = place[len(place) - len(state.numbers) :]
    found = []
    for effect in common:
        sizes = [s for s in fit.extension.slots if s.effect is effect and not s.parameter.is_shape]
        away = torch.cat([state.numbers[s.where] - s.parameter.null for s in sizes])
        mine = torch.cat([place[s.where] for s in sizes])
        mine, away = mine[mine >= 0], away[mine >= 0]
        wald = float(away @ torch.linalg.solve(covariance[mine[:, None], mine], away))
        if wald < len(mine) + SHOWN * (2 * len(mine)) ** 0.5:
            found.append(effect.name)
    return found


def legs(chain: Chain) -> list[tuple[int, str, int]]:
    """What tells a vehicle in a stretch from all others: first channel, track, first row."""
    return [
        (int(link.fit.problem.channel[0]), one.track_id, int(one.rows[0]))
        for link in chain.links
        for one in link.fit.problem.passes
    ]


def carried(chain: Chain, state: State, new: Chain) -> State:
    """A state as a start for a fit of some of its passes; what is smooth along a pass begins at null."""
    known = {leg: number for number, leg in enumerate(legs(chain))}
    keep = torch.tensor([known[leg] for leg in legs(new)])
    numbers = shared_numbers(chain, state, new)
    for slot, old, here in in_both(chain, new):
        if slot.parameter.scope == "pass":
            numbers[here] = state.numbers[old][keep]
    return State(state.coefficients, vehicles_of(state.vehicles, keep), state.poisson_ratio, numbers)


def by_direction(passes: Sequence[Pass]) -> np.ndarray:
    """Numbers [pass] of the passes, those of one direction first: dealt by turns, each group gets both.

    >>> from types import SimpleNamespace
    >>> by_direction([SimpleNamespace(velocity=np.array([[v, 0.1]])) for v in (9.0, -12.0, 15.0, -17.0)]).tolist()
    [0, 2, 1, 3]
    """
    velocity = np.array([one.velocity.mean(0) for one in passes])
    return np.argsort(velocity @ velocity[0] < 0, kind="stable")


def split(problem: Problem, group: np.ndarray) -> tuple[Chain, Chain, list[Pass]]:
    """Chains of the passes that are seen and of a group [pass] that is held out, and the former."""
    others = np.setdiff1d(np.arange(len(problem.passes)), group)
    held = Chain.of(part(problem, group), known_ground=True)
    return Chain.of(part(problem, others)), held, [problem.passes[i] for i in others]


def dealt(problem: Problem) -> tuple[Chain, Chain, list[Pass]]:
    """The same of a long fiber: crowds of each stretch are dealt by turns, and some of either half are enough."""
    seen, held = (
        [some(mine, FIRST) for stretch in parts(problem) if (mine := stretch[first::FOLDS])] for first in (1, 0)
    )
    return Chain.of(problem, groups=seen), Chain.of(problem, known_ground=True, groups=held), []


def held_out_chi2(
    problem: Problem,
    advance: Callable[[int], None] = lambda n: None,
    *,
    folds: int = FOLDS,
    at: tuple[MapFit | Chain, State] | None = None,
) -> float | None:
    """Chi2 per degree of freedom of held-out passes, each refitting only its own amplitude, shift and wheels.

    Passes are dealt to `folds` groups; each group is left out once, the route and all that is common to passes fitted
    to the others and then held. Effects that these do not show are left out of the model: they can say nothing of the
    group. A long fiber has samples enough in one group. `advance` is called with 1 after each.

    Parameters
    ----------
    problem : the survey
    at : where the fit of all passes ended, to begin from; from the rough route where None

    Returns
    -------
    None where there are fewer than two passes, or never one vehicle alone
    """
    count = len(problem.passes)
    if count < 2:
        return None
    misfit = freedom = 0.0
    whole = at and (at[0] if isinstance(at[0], Chain) else Chain.single(at[0]), at[1])
    every, folds = by_direction(problem.passes), min(folds, count)
    for group in [None] if is_long(problem) else [np.sort(every[first::folds]) for first in range(folds)]:
        seen, unseen, rest = dealt(problem) if group is None else split(problem, group)
        ground = solve(seen, carried(*whole, seen) if whole else seen.start()).state
        if group is not None and (silent := unshown(seen.links[0].fit, ground)):
            # What does not show in the passes that are seen can say nothing of the others.
            fewer = replace(problem, effects=tuple(one for one in problem.effects if one.name not in silent))
            seen, unseen, rest = split(fewer, group)
            ground = solve(seen, carried(*whole, seen) if whole else seen.start()).state
        start = unseen.start_at(ground.coefficients, ground.poisson_ratio, shared_numbers(seen, ground, unseen))
        if whole:
            start = replace(start, vehicles=carried(*whole, unseen).vehicles)
        end = solve(unseen, start)
        for link, model, weights in zip(unseen.links, end.at.models, end.at.weights, strict=True):
            alone = own_samples(link, rest)
            misfit += float((link.fit.whitened_of(model, weights)[alone] ** 2).sum())
            freedom += float((weights.good * weights.soft)[alone].sum())
        # What held-out passes are shifted or changed by is misfit too: a clock that is off shows there.
        misfit += unseen.prior.cost(end.state)
        freedom -= int(unseen.free.sum())
        advance(1)
    return misfit / freedom if freedom > 0 else None
