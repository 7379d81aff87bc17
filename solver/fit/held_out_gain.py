"""Whether passes that a fit has not seen are explained better with an effect than without it."""

from dataclasses import astuple, dataclass, replace

import numpy as np
import torch

from solver.fit.carried import End, chained
from solver.fit.held_out import Fold, Make, dealt, shown
from solver.fit.least_squares import Solution
from solver.fit.side_by_side import side_by_side
from solver.fit.track_trust import strict_tracks, track_spread

#: Standard deviations by which the misfit rises where an effect is refused.
REFUSED = 2.0


@dataclass(frozen=True)
class HeldOutGain:
    """Fall of the misfit of held-out passes by an effect.

    Parameters
    ----------
    fall : of chi2
    freedom : degrees of freedom
    blurred, blur : by how much more the uncertainty of what was fitted adds to the misfit with the effect than without
        it, and the variance of that
    change : squared length of the change of the whitened residual
    """

    fall: float
    freedom: float
    blurred: float
    blur: float
    change: float

    @property
    def per_dof(self) -> float:
        """Fall of chi2 per degree of freedom."""
        return self.fall / self.freedom

    def refuses(self, variance: float) -> bool:
        """Whether the misfit rises by more than chance, where the noise counts as so much.

        A change d of the prediction changes chi2 by |d|^2 +- 2 |d| sigmas where either is right (Vuong 1989,
        Econometrica 57, 307); what few passes leave uncertain adds `blur`.

        >>> [HeldOutGain(fall, 1e4, 1.0, 2.0, 25.0).refuses(1.0) for fall in (-30.0, -15.0, 25.0)]
        [True, False, False]
        """
        return self.fall + self.blurred < -REFUSED * float(np.sqrt((4 * self.change + self.blur) * variance))


def held_out_gain(without: End, with_it: End) -> HeldOutGain | None:
    """Fall of the misfit of held-out passes by what one model has and another lacks, where those fitted show it.

    Tracks are trusted as the model without it has them, in both.

    Parameters
    ----------
    without, with_it : fits of all passes, and where they ended

    Returns
    -------
    None where there are fewer than two passes, or no fold in which the passes that are fitted show what is added
    """
    before, after = ((chained(fit), state) for fit, state in (without, with_it))
    spread = track_spread(before[0].passes, before[1].vehicles.along.numpy())
    less, more = (strict_tracks(chain.problem, spread) for chain, _ in (before, after))
    known = {one.name for one in less.effects}
    if len(less.passes) < 2:
        return None

    def compared(make: Make) -> HeldOutGain | None:
        fold, ground, silent = shown(make, more, after)
        if {one.name for one in more.effects} - known <= set(silent):
            return None
        new, changed = fold.judged(ground, end := fold.ended(ground, after)), residuals(fold, end)
        fold = make(replace(less, effects=tuple(one for one in less.effects if one.name not in silent)))
        ground = fold.fitted(before)
        old, left = fold.judged(ground, end := fold.ended(ground, before)), residuals(fold, end)
        change = sum(float((left[key] - changed[key]).square().sum()) for key in left.keys() & changed.keys())
        blur = abs(new.blur - old.blur)
        return HeldOutGain(old.chi2 - new.chi2, new.freedom, new.blurred - old.blurred, blur, change)

    found = [one for one in side_by_side(compared, dealt(more)) if one is not None]
    if not found:
        return None
    return HeldOutGain(*(sum(numbers) for numbers in zip(*map(astuple, found), strict=True)))


def residuals(fold: Fold, end: Solution) -> dict[tuple[int, int], torch.Tensor]:
    """Whitened residual [channel] of each stretch and sample where held-out passes are alone."""
    found: dict[tuple[int, int], torch.Tensor] = {}
    for link, alone, residual in zip(fold.held.links, fold.alone(), end.at.residuals, strict=True):
        samples = link.fit.problem.traffic.samples
        found |= {(link.stretch, int(samples[row])): residual[row] for row in torch.nonzero(alone)[:, 0].tolist()}
    return found
