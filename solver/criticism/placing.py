"""At which stage something unknown acts, by more than which discrepancy model explains it best."""

import torch

from solver.criticism.audit import NoiseAudit
from solver.criticism.score import outcome
from solver.criticism.scorer import Scorer
from solver.effect import Discrepancy, Effect

#: Correlation of the noise of neighboring channels above which it was mixed after it was read.
SHARED = 0.1
#: How much more of chi2 must fall with the same profile along the fiber than with the same along travel.
FIXED = 1.2


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
    mixed = model.mixes and len(across) > 1 and abs(across[1]) > SHARED
    if mixed or (model.levels and check.leveled):
        return "processing"
    if model.before_and_behind and fixed_to_fiber(discrepancy, scorer):
        return "interrogator"
    return model.stage or discrepancy.stage


def fixed_to_fiber(discrepancy: Effect, scorer: Scorer) -> bool:
    """Whether what is ahead for those who drive one way is behind for the others, rather than the same for all."""
    velocity = torch.tensor([one.velocity.mean(0).tolist() for one in scorer.fit.problem.passes])
    back = velocity @ velocity[0] < 0
    extension = scorer.fit.problem.extension([*scorer.fit.extension.effects, discrepancy])
    columns, counts = scorer.columns(discrepancy, {}, extension)
    projected = scorer.project([columns])[0]
    along_travel = torch.block_diag(*(torch.ones(count, 1, dtype=torch.float64) for count in counts))
    number = torch.arange(sum(counts)).reshape(len(counts), -1)
    turned = torch.where(back, number.roll(len(counts) // 2, 0), number)
    one, other = (outcome(projected.combined(mix), None)[0] for mix in (along_travel, along_travel[turned.flatten()]))
    return other > FIXED * one
