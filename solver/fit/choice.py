"""Which of many passes to fit: those that tell most about the route, its depth and the ground.

Hundreds of vehicles say hardly more than the best twenty of them, and cost far more. A pass's normal equations at the
start of the fit, its own numbers eliminated, are its information; passes are taken one by one, each time the one with
which the variances are expected to fall most (greedy choice of sensors: Krause, Singh and Guestrin 2008, J. Mach.
Learn. Res. 9, 235). What all tracks may be off by alike counts as unknown, so that both directions are taken.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from solver.cable.fiber import GaugeEnds
from solver.fit.chain import Chain
from solver.fit.map_fit import MapFit
from solver.fit.parameter_layout import AXES
from solver.fit.problem import Problem
from solver.fit.some_passes import ALONE, alone_samples, by_itself
from solver.fit.state import State
from solver.signal_path.traffic import Traffic
from solver.trajectory.vehicle_pass import Pass

Array = NDArray[Any]

#: Passes above which some are chosen, and how few and how many these are.
MANY, FEWEST, MOST = 30, 10, 20
#: Mean fall of ln variance below which another pass is not worth its time.
WORTH = 0.01
#: Standard deviations of what all tracks may be off by alike: s on the clock, m along travel, m to the right of it.
ALIKE = (0.05, 0.3, 0.1)
#: Standard deviation of the place of a route of which nothing is known, m.
ANYWHERE = 10.0
#: Passes that test a route at most.
TESTED = 40
#: Meters between places of the fiber whose variances count.
EVERY = 5.0
#: What a kind of pass that is missing may differ in from a chosen one: m beside it, and how many times as heavy.
LANE, HEAVY = 3.5, 4.0
#: What is told, in the order of the targets.
TOLD = ("route", "depth", "ground")


@dataclass(frozen=True)
class Taken:
    """A pass that was chosen.

    Parameters
    ----------
    number : of the pass
    falls : mean fall of ln variance of each target
    """

    number: int
    falls: Array


def mean_ln_variance(covariance: Array, targets: Sequence[Array]) -> Array:
    """Mean ln variance of each target, from covariances [..., parameter, parameter]; a target is [place, parameter].

    >>> mean_ln_variance(np.diag([1.0, np.e]), [np.eye(2)[:1], np.eye(2)])
    array([0. , 0.5])
    """
    every = [np.log(np.einsum("pi,...ij,pj->...p", target, covariance, target)).mean(-1) for target in targets]
    return np.stack(every, -1)


def greedy(
    prior: Array,
    informations: Sequence[Array],
    targets: Sequence[Array],
    fewest: int = FEWEST,
    most: int = MOST,
    worth: float = WORTH,
) -> list[Taken]:
    """Choose passes one by one, each time the one with which the variances fall most.

    Parameters
    ----------
    prior : precision [parameter, parameter] of what is known without any pass
    informations : of each pass, [parameter, parameter]
    targets : matrices [place, parameter] of what is to be known; all count alike
    fewest, most : passes to take
    worth : mean fall of ln variance below which no more than the fewest are taken

    >>> taken = greedy(np.eye(2), [np.diag([1.0, 0]), np.diag([3.0, 0]), np.diag([0, 2.0])], [np.eye(2)], 2, 2)
    >>> [one.number for one in taken]
    [1, 2]
    """
    left, known, found = list(range(len(informations))), prior.copy(), list[Taken]()
    at = mean_ln_variance(np.linalg.inv(known), targets)
    while left and len(found) < most:
        falls = at - mean_ln_variance(np.linalg.inv(known + np.stack([informations[i] for i in left])), targets)
        best = int(falls.mean(-1).argmax())
        if len(found) >= fewest and falls[best].mean() < worth:
            break
        number = left.pop(best)
        known, at = known + informations[number], at - falls[best]
        found.append(Taken(number, falls[best]))
    return found


@dataclass(frozen=True)
class Informed:
    """A pass and what it tells.

    Parameters
    ----------
    chain, state : of the pass by itself, at the start
    matrix : information [parameter, parameter] on what passes share, and on what all tracks may be off by alike
    """

    chain: Chain
    state: State
    matrix: Array

    @classmethod
    def of(cls, fit: MapFit, state: State | None = None, way: int = 1) -> "Informed":
        """Of a pass by itself; `way` -1: as if it had gone the other way."""
        chain = Chain.single(fit)
        state = chain.start() if state is None else state
        normal = chain.visit(state).normal
        part, block = normal.parts[0], normal.blocks[0]
        mine, layout = chain.own_places[0].numpy(), chain.layout
        alike = np.zeros((len(mine), len(ALIKE)))
        alike[mine == layout["along"].start] = way * np.array([abs(fit.passes[0].speed), 1.0, 0.0])
        alike[mine == layout["across"].start, 2] = way
        data = part.own - np.diag(part.precision)
        cross = np.column_stack([part.cross, data @ alike])
        whole = np.block([[block.matrix, part.cross.T @ alike], [alike.T @ part.cross, alike.T @ data @ alike]])
        size = normal.size + normal.border
        where = np.concatenate([block.where(normal.size), size + np.arange(len(ALIKE))])
        matrix = np.zeros((size + len(ALIKE),) * 2)
        matrix[np.ix_(where, where)] = whole - cross.T @ np.linalg.solve(part.own, cross)
        return cls(chain, state, matrix)

    @property
    def prior(self) -> Array:
        """Precision [parameter, parameter] of the same without any pass."""
        chain, state = self.chain, self.state
        size = chain.size + len(chain.border)
        matrix = np.zeros((size + len(ALIKE),) * 2)
        for block in chain.known(state, chain.prior.precision(state)):
            where = block.where(chain.size)
            matrix[np.ix_(where, where)] += block.matrix
        route = np.arange(chain.size)
        matrix[route, route] += ANYWHERE**-2
        alike = size + np.arange(len(ALIKE))
        matrix[alike, alike] = np.array(ALIKE) ** -2
        return matrix

    def targets(self) -> dict[str, Array]:
        """What is to be known, by name: matrices [place, parameter]."""
        chain, distance = self.chain, self.chain.problem.distance
        step = max(1, round(EVERY / self.chain.problem.channel_spacing))
        at = chain.basis.at(distance[step // 2 :: step])
        count = len(self.matrix)
        every = np.zeros((AXES, len(at), count))
        for axis in range(AXES):
            every[axis][:, axis : chain.size : AXES] = at
        found = {"route": np.concatenate(every[:2]), "depth": every[2]}
        ratio = chain.layout["poisson_ratio"].start
        if bool(chain.free[ratio]):
            ground = np.zeros((1, count))
            ground[0, chain.size + int(chain.rank(torch.tensor([ratio]))[0])] = 1.0
            found["ground"] = ground
        return found


@dataclass(frozen=True)
class Choice:
    """Some of many passes.

    Parameters
    ----------
    passes : all of them
    taken : those chosen, the most telling first
    names : of what is told, in the order of the falls
    missing : kind of pass in words -> falls that one more, of that kind, could be expected to bring
    """

    passes: Sequence[Pass]
    taken: Sequence[Taken]
    names: Sequence[str]
    missing: Sequence[tuple[str, Array]]

    @property
    def numbers(self) -> list[int]:
        """Of the passes chosen."""
        return [one.number for one in self.taken]

    @property
    def others(self) -> list[int]:
        """Numbers of passes to test the route by: all of the rest, or every so many of them."""
        enough = [rows.sum() >= ALONE for rows in alone_samples(self.passes)]
        rest = [i for i in range(len(self.passes)) if i not in set(self.numbers) and enough[i]]
        return rest[:: max(1, -(-len(rest) // TESTED))]


def beside(problem: Problem, informed: Informed, offset: float, heavier: float, way: int) -> Informed:
    """A pass that nobody recorded: the same at some meters to the right, times as heavy, one way or the other."""
    base = informed.chain.problem
    (one,) = base.passes
    heading = one.velocity / np.linalg.norm(one.velocity, axis=1, keepdims=True).clip(1e-9)
    right = np.column_stack([-heading[:, 1], heading[:, 0]])
    moved = [replace(one, position=one.position + offset * right)]
    fit = MapFit(replace(base, passes=moved, traffic=Traffic.of(moved)), basis=problem.basis)
    vehicles = informed.state.vehicles
    state = replace(informed.state, vehicles=replace(vehicles, amplitude=heavier * vehicles.amplitude))
    heard = replace(fit.problem, record=fit.model(state).numpy())
    return Informed.of(MapFit(heard, basis=problem.basis), state, way)


def choose(
    problem: Problem, advance: Callable[[int], None] = lambda n: None, *, fewest: int = FEWEST, most: int = MOST
) -> Choice:
    """Choose the passes of a survey that tell most, from where its fit begins.

    Parameters
    ----------
    problem : the survey; `advance` is called with 1 after each of its passes
    fewest, most : passes to take

    Returns
    -------
    choice : no pass is taken that is near the fiber without other vehicles for fewer than `ALONE` samples
    """
    group, numbers = [], []
    for number, (one, rows) in enumerate(zip(problem.passes, alone_samples(problem.passes), strict=True)):
        if rows.sum() >= ALONE:
            group.append(by_itself(problem, one, rows))
            numbers.append(number)
        else:
            advance(1)
    if not group:
        return Choice(problem.passes, [], TOLD, [])
    basis, found = problem.basis, list[Informed]()
    ends = GaugeEnds.of(basis, problem.distance, problem.gauge_length, problem.curved)
    for single in group:
        found.append(Informed.of(MapFit(single, basis=basis, ends=ends)))
        advance(1)
    targets, prior = found[0].targets(), found[0].prior
    names, matrices = list(targets), list(targets.values())
    taken = greedy(prior, [one.matrix for one in found], matrices, fewest, most)
    known = prior + sum(found[one.number].matrix for one in taken)
    at = mean_ln_variance(np.linalg.inv(known), matrices)
    missing = []
    for words, other in unrecorded(problem, found[taken[0].number]):
        missing.append((words, at - mean_ln_variance(np.linalg.inv(known + other.matrix), matrices)))
    missing.sort(key=lambda kind: -float(kind[1].mean()))
    return Choice(problem.passes, [replace(one, number=numbers[one.number]) for one in taken], names, missing)


def unrecorded(problem: Problem, best: Informed) -> list[tuple[str, Informed]]:
    """Kinds of pass that differ from a chosen one in one way, in words, and what each would tell."""
    (one,) = best.chain.problem.passes
    route = problem.start
    place = one.position.mean(0)
    near = route[np.hypot(*(route[:, :2] - place).T).argmin(), :2] - place
    heading = one.velocity.mean(0) / np.linalg.norm(one.velocity.mean(0)).clip(1e-9)
    right = float(np.sign(near @ np.array([-heading[1], heading[0]]))) or 1.0
    ahead = "+x" if heading[0] < 0 else "-x"
    # A vehicle just above the fiber would tell most, and drives nowhere.
    nearer = right * min(LANE, float(np.hypot(*near)) / 2)
    kinds: tuple[tuple[str, float, float, int], ...] = (
        (f"toward {ahead}", 0.0, 1.0, -1),
        (f"{abs(nearer):.1f} m nearer to the fiber", nearer, 1.0, 1),
        (f"{LANE:g} m farther from the fiber", -right * LANE, 1.0, 1),
        ("of a heavier vehicle", 0.0, HEAVY, 1),
    )
    return [(words, beside(problem, best, offset, heavier, way)) for words, offset, heavier, way in kinds]
