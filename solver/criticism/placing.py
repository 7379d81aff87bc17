"""The stage at which something unknown acts: the discrepancy model that explains it best does not alone decide."""

from functools import reduce

import torch

from solver.criticism.audit import NoiseAudit
from solver.criticism.policy import POLICY
from solver.criticism.score import outcome
from solver.criticism.scorer import Scorer
from solver.criticism.sums import Sums
from solver.effect import Discrepancy, Effect


def stage_of(discrepancy: Effect, scorer: Scorer, check: NoiseAudit) -> str:
    """Stage at which what a discrepancy model explains acts.

    What mixes or levels the channels' noise too comes after the reading; what is the same along the fiber, whichever
    way vehicles drive, is not a matter of the vehicles.

    Parameters
    ----------
    discrepancy : a discrepancy model
    scorer : at the fit without it
    check : of the noise
    """
    model, across = discrepancy.discrepancy or Discrepancy(), scorer.fit.problem.law.across
    mixed = model.mixes and len(across) > 1 and abs(across[1]) > POLICY.mixed
    if mixed or (model.levels and check.leveled):
        return "processing"
    if model.before_and_behind and fixed_to_fiber(discrepancy, scorer):
        return "interrogator"
    return declared_stage(discrepancy)


def declared_stage(discrepancy: Effect) -> str:
    """Stage at which what a discrepancy model stands for acts by its declaration.

    >>> from solver.catalogue.catalogue import built_in
    >>> declared_stage(built_in()["generic_train"])
    'load'
    """
    return (discrepancy.discrepancy or Discrepancy()).stage or discrepancy.stage


def levels(discrepancy: Effect) -> bool:
    """Whether a discrepancy model changes how strongly all channels are read."""
    return discrepancy.discrepancy is not None and discrepancy.discrepancy.levels


def fixed_to_fiber(discrepancy: Effect, scorer: Scorer) -> bool:
    """Whether what is ahead of vehicles in one direction is behind those in the other, rather than ahead of all."""
    velocity = torch.tensor([one.velocity.mean(0).tolist() for one in scorer.fit.problem.passes])
    back = velocity @ velocity[0] < 0
    extension = scorer.fit.problem.extension([*scorer.fit.extension.effects, discrepancy])
    each = (scorer.columns(discrepancy, {}, extension, part) for part in scorer.parts)
    told, numbers = zip(*((scorer.summed([columns])[0], counts) for columns, counts in each), strict=True)
    projected, counts = scorer.left(reduce(Sums.plus, told)), numbers[0]
    along_travel = torch.block_diag(*(torch.ones(count, 1, dtype=torch.float64) for count in counts))
    number = torch.arange(sum(counts)).reshape(len(counts), -1)
    turned = torch.where(back, number.roll(len(counts) // 2, 0), number)
    size = torch.ones(len(counts), dtype=torch.float64)
    mixes = along_travel, along_travel[turned.flatten()]
    one, other = (outcome(projected.combined(mix), None, size).fall for mix in mixes)
    return other > POLICY.fixed * one
