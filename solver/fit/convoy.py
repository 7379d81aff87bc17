"""Crowds of vehicles one after the other, whose noise hangs together: their equations, summed crowd by crowd.

What a crowd changes in the record ends with it, but the noise is told from samples before. So the last samples of one
crowd, not yet whitened, are carried on to the next: the sums are those of all crowds at once, and no derivative of all
passes is ever held.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor

from solver.fit.robust import huber, joint_scale, near_noise, solved_amplitudes
from solver.fit.state import Evaluation, State, Weights
from solver.fit.windowed import Windowed

if TYPE_CHECKING:
    from solver.fit.links import Link

#: Bytes of local derivatives that are kept from a look to its equations; beyond, they are computed again.
KEPT = 2e8


def carried(links: Sequence["Link"], columns: Iterable[tuple[Tensor, Tensor]]) -> Iterator[tuple[Tensor, Tensor]]:
    """Whiten maps link by link: numbers [column] of the columns, and the maps [column, sample, channel] of each.

    A link's whitened samples hold what the links before changed in the samples that it looks back at: the columns of
    those are added to its own.
    """
    known, tail = torch.zeros(0, dtype=torch.int64), torch.zeros(0, 0, 0, dtype=torch.float64)
    for link, (mine, values) in zip(links, columns, strict=True):
        if back := len(link.back):
            past = tail[:, -back:]
            both = torch.isin(known, mine)
            more = ~both & (past != 0).any(-1).any(-1)
            whole = values.new_zeros(len(mine) + int(more.sum()), back + values.shape[1], values.shape[2])
            whole[: len(mine), back:] = values
            place = {int(number): column for column, number in enumerate(mine.tolist())}
            whole[[place[number] for number in known[both].tolist()], :back] = past[both]
            whole[len(mine) :, :back] = past[more]
            values, mine = whole, torch.cat([mine, known[more]])
        yield mine, link.whiten(values)
        known, tail = mine, values[:, -link.whiten.memory :] if link.whiten.memory else values[:, :0]


def whitened(links: Sequence["Link"], maps: Iterable[Tensor]) -> list[Tensor]:
    """Whiten maps [sample, channel], one of each link."""
    one = torch.zeros(1, dtype=torch.int64)
    return [white[0] for _, white in carried(links, ((one, values[None]) for values in maps))]


@dataclass(frozen=True)
class Glance:
    """What the vehicles of a link do at its state.

    Parameters
    ----------
    link, state : its own
    evaluation : there; without the derivatives by the route where there is no room for them
    whole : it has them all
    """

    link: "Link"
    state: State
    evaluation: Evaluation
    whole: bool

    @classmethod
    def at(cls, link: "Link", state: State, room: float) -> "Glance":
        """Evaluate a link; `room` is how many bytes of derivatives may be kept."""
        found = link.fit.evaluate(state)
        if found.local.bytes <= room:
            return cls(link, state, found, True)
        return cls(link, state, replace(found, local=found.local.shifts), False)

    @property
    def full(self) -> Evaluation:
        """The evaluation with all derivatives."""
        return self.evaluation if self.whole else self.link.fit.evaluate(self.state)

    def with_amplitudes(self, amplitude: Tensor) -> "Glance":
        """The same with other amplitudes [pass]."""
        return Glance(self.link, *self.link.fit.strengthened(self.state, self.evaluation, amplitude), whole=self.whole)


def glances(links: Sequence["Link"], states: Sequence[State]) -> list[Glance]:
    """Evaluate links, each at its state, and keep what there is room for."""
    found, room = [], KEPT
    for link, state in zip(links, states, strict=True):
        found.append(Glance.at(link, state, room))
        room -= found[-1].evaluation.local.bytes
    return found


def best_amplitudes(
    links: Sequence["Link"], alone: Iterable[Tensor], weights: Sequence[Weights]
) -> tuple[list[Tensor], list[Tensor]]:
    """Amplitudes [pass] of each link's vehicles that fit best, all links together, and what they leave.

    Parameters
    ----------
    alone : of each link, maps [pass, sample, channel] of its vehicles of unit amplitude
    weights : of each link's samples

    Returns
    -------
    amplitudes [pass] of each link, and the whitened, weighted residual [sample, channel] of each
    """
    counts = [len(link.fit.passes) for link in links]
    numbers = torch.arange(sum(counts)).split(counts)
    maps = (one * w.good for one, w in zip(alone, weights, strict=True))
    data = whitened(links, (link.fit.data * w.good for link, w in zip(links, weights, strict=True)))
    matrix, right = torch.zeros(sum(counts), sum(counts)).double(), torch.zeros(sum(counts)).double()
    kept = []
    for (mine, columns), seen, w in zip(carried(links, zip(numbers, maps, strict=True)), data, weights, strict=True):
        scale = w.soft.sqrt()
        columns, seen = columns * scale, seen * scale
        flat = columns.flatten(1)
        matrix[mine[:, None], mine] += flat @ flat.T
        right[mine] += flat @ seen.flatten()
        kept.append((mine, columns, seen))
    found = solved_amplitudes(matrix, right)
    left = [seen - torch.tensordot(found[mine], columns, 1) for mine, columns, seen in kept]
    return list(found.split(counts)), left


def settled(glances_: Sequence[Glance], weights: Sequence[Weights]) -> list[Glance]:
    """The same with the amplitudes that fit best by given weights; what clips is not linear, and stays as it is."""
    if any(one.link.fit.path.described(one.evaluation.values).nonlinear for one in glances_):
        return list(glances_)
    links = [one.link for one in glances_]
    maps = (one.link.fit.alone(one.evaluation.local.alone, one.evaluation.values) for one in glances_)
    amplitudes, _ = best_amplitudes(links, maps, weights)
    return [one.with_amplitudes(amplitude) for one, amplitude in zip(glances_, amplitudes, strict=True)]


def weighed(
    links: Sequence["Link"], glances_: Sequence[Glance], before: Sequence[Weights] | None
) -> tuple[list[Weights], list[Tensor]]:
    """Weights of the samples of each link, on one scale of all, and their whitened, weighted residual.

    Parameters
    ----------
    before : the weights a step before; None where there was none
    """
    measured = [link.fit.measured for link in links]
    compared = [one.link.fit.compared(one.evaluation) for one in glances_]
    sizes = [d / link.fit.problem.noise / v.sqrt() for link, (d, v) in zip(links, compared, strict=True)]
    scale = joint_scale(sizes, measured)
    was = [None] * len(links) if before is None else [one.good for one in before]
    goods = [there * near_noise(size, scale, one) for there, size, one in zip(measured, sizes, was, strict=True)]
    residuals = whitened(links, (d * good for (d, _), good in zip(compared, goods, strict=True)))
    softs = [there / v for there, (_, v) in zip(measured, compared, strict=True)]
    sizes = [r * soft.sqrt() for r, soft in zip(residuals, softs, strict=True)]
    scale = joint_scale(sizes, measured)
    softs = [soft * huber(size, there, scale) for soft, size, there in zip(softs, sizes, measured, strict=True)]
    weights = [Weights(good, soft) for good, soft in zip(goods, softs, strict=True)]
    return weights, [r * soft.sqrt() for r, soft in zip(residuals, softs, strict=True)]


def jacobians(
    glances_: Sequence[Glance], weights: Sequence[Weights], free: Tensor
) -> Iterator[tuple[Tensor, Windowed]]:
    """Whitened, weighted derivatives [observation, column] by the chain's free parameters [column], link by link.

    Parameters
    ----------
    free : [parameter] bool, of the chain
    """
    if len(glances_) == 1:
        # Nothing is carried on: of the many derivatives of many vehicles a few at a time are whitened.
        ((one, w),) = zip(glances_, weights, strict=True)
        mine, full = one.link.fit.free, one.full
        chosen = free[one.link.where]
        yield one.link.where[chosen], one.link.fit.whitened_columns(one.state, full, w).taking(chosen[mine])
        return

    def raw() -> Iterator[tuple[Tensor, Tensor]]:
        for one, w in zip(glances_, weights, strict=True):
            fit, full = one.link.fit, one.full
            where = torch.nonzero(free[one.link.where]).flatten()
            columns = fit.jacobian(one.state, full.local, full.values)
            columns = columns if len(where) == len(columns) else columns[where]
            yield one.link.where[where], columns.mul_(w.good)

    links = [one.link for one in glances_]
    for (where, columns), w in zip(carried(links, raw()), weights, strict=True):
        yield where, Windowed.whole(columns.mul_(w.soft.sqrt()).flatten(1))


class Sums:
    """Normal equations of a convoy, summed link by link.

    Parameters
    ----------
    own, shared : which of the chain's parameters are of its vehicles alone, and which it shares
    """

    def __init__(self, own: Tensor, shared: Tensor):
        self.own, self.shared = own, shared
        own_count, count = len(own), len(shared)
        self.matrix, self.cross = np.zeros((own_count, own_count)), np.zeros((own_count, count))
        self.block = np.zeros((count, count))
        self.right, self.shared_right = np.zeros(own_count), np.zeros(count)
        size = 1 + max(int(one.max()) if len(one) else -1 for one in (own, shared))
        self._place = np.full(size, -1)
        self._place[own.numpy()] = np.arange(own_count)
        self._place[shared.numpy()] = own_count + np.arange(count)

    def add(self, where: Tensor, jacobian: Windowed, residual: Tensor) -> None:
        """Add derivatives [observation, column] by some parameters `where` [column], and the residual there."""
        place = self._place[where.numpy()]
        mine, ours = np.flatnonzero(place < len(self.own)), np.flatnonzero(place >= len(self.own))
        own, shared = place[mine], place[ours] - len(self.own)
        matrix, right = jacobian.gram.numpy(), jacobian.along(residual).numpy()
        self.matrix[np.ix_(own, own)] += matrix[np.ix_(mine, mine)]
        self.cross[np.ix_(own, shared)] += matrix[np.ix_(mine, ours)]
        self.block[np.ix_(shared, shared)] += matrix[np.ix_(ours, ours)]
        self.right[own] += right[mine]
        self.shared_right[shared] += right[ours]
