"""What is known of the effects' numbers before the data speak."""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import torch
from torch import Tensor

from solver.fit.prior import Prior
from solver.signal_path.extension import Extension, Slot

#: Scopes of numbers that single passes have of their own.
SINGLE = ("pass", "track")


def sd_of(slot: Slot, prior: Prior) -> float:
    """Standard deviation of an effect's numbers before the data speak."""
    grid = slot.parameter.grid
    plausible = max(grid) - min(grid) if len(grid) > 1 else slot.parameter.plausible
    stated = prior.effect_sd.get(f"{slot.effect.name}.{slot.parameter.name}", plausible)
    return prior.jitter if slot.effect.slow_error else stated


@dataclass(frozen=True)
class Numbers:
    """Prior and bounds of the effects' numbers.

    Parameters
    ----------
    mean, sd : [number]
    lower, upper : [number], bounds
    single : [number] bool, which are of single passes
    """

    mean: Tensor
    sd: Tensor
    lower: Tensor
    upper: Tensor
    single: Tensor

    @classmethod
    def of(cls, extension: Extension, prior: Prior) -> "Numbers":
        """All numbers of the effects in a model, in its order."""
        mean = extension.numbers()
        return cls.joined([cls.of_slot(slot, mean[slot.where], prior) for slot in extension.slots])

    @classmethod
    def of_slot(cls, slot: Slot, mean: Tensor, prior: Prior) -> "Numbers":
        """Those of one parameter, with their means [number]."""
        sd, lower, upper = (
            torch.full_like(mean, value) for value in (sd_of(slot, prior), slot.parameter.lower, slot.parameter.upper)
        )
        return cls(mean, sd, lower, upper, torch.full((len(mean),), slot.parameter.scope in SINGLE))

    @classmethod
    def joined(cls, parts: Sequence["Numbers"]) -> "Numbers":
        """Some, one after the other."""
        none = torch.zeros(0, dtype=torch.float64)
        every = [cls(none, none, none, none, none.bool()), *parts]
        return cls(*(torch.cat([getattr(one, each.name) for one in every]) for each in fields(cls)))

    def __len__(self) -> int:
        return len(self.mean)

    def bounded(self, numbers: Tensor) -> Tensor:
        """The nearest numbers [number] within their bounds."""
        return numbers.clamp(self.lower, self.upper)
