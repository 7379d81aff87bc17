"""At which stage something unknown acts, by more than which discrepancy model explains it best."""

import torch

from solver.catalogue.catalogue import GAINS, MEANT_FOR, MIXING
from solver.criticism.audit import NoiseAudit
from solver.criticism.score import outcome
from solver.criticism.scorer import Scorer
from solver.effect import Effect

#: Correlation of the noise of neighboring channels above which it was mixed after it was read.
SHARED = 0.1
#: Discrepancy models of what is ahead of a vehicle (half of their numbers) and behind it (the others), pass by pass.
AHEAD_AND_BEHIND = ("generic_train",)
#: How much more of chi2 must fall with the same profile along the fiber than with the same along travel.
FIXED = 1.2


def stage_of(discrepancy: Effect, scorer: Scorer, check: NoiseAudit) -> str:
    """Stage at which what a discrepancy model explains acts.

    What mixes or levels the channels' noise too comes after the reading; what is the same along the fiber, whichever
    way vehicles drive, is no matter of the vehicles.

    Parameters
    ----------
    discrepancy : an effect of the catalogue
    scorer : at the fit without it
    check : of the noise
    """
    across = scorer.fit.problem.law.across
    mixed = discrepancy.name in MIXING and len(across) > 1 and abs(across[1]) > SHARED
    if mixed or (discrepancy.name in GAINS and check.leveled):
        return "processing"
    if discrepancy.name in AHEAD_AND_BEHIND and fixed_to_fiber(discrepancy, scorer):
        return "interrogator"
    return MEANT_FOR.get(discrepancy.name, discrepancy.stage)


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
