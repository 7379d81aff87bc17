"""How parameters that act on the whole strain-rate map change it: filters, gains, mixing, instrument limits."""

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from solver.signal_path.autodiff import pushed_all, pushing
from solver.signal_path.extension import Slot, Values
from solver.signal_path.observation import together

if TYPE_CHECKING:
    from solver.signal_path.local import Seen

#: Share of the largest change that is rounding.
ROUNDING = 1e-10

#: From a parameter's value to all values.
Changed = Callable[[Tensor], Values]
#: From a change of a parameter's value to that of the observed map [sample, channel].
Moved = Callable[[Tensor], Tensor]


def acts_on_map(seen: "Seen", slot: Slot, values: Values) -> bool:
    """Whether an effect acts on the whole map."""
    if slot.effect.stage in ("trajectory", "load"):
        return False
    alone = seen.path.described_alone(slot.effect, values)
    gained = isinstance(alone.interrogator.gain, Tensor)
    return bool(gained or alone.along_fiber or alone.in_time or alone.nonlinear or alone.processing.steps)


def moving(seen: "Seen", slot: Slot, changed: Changed, here: Tensor) -> Moved:
    """Changes of the observed map with a parameter, about its value `here`."""
    path, alone = seen.path, seen.local.alone
    stages, own = path.described(changed(here)), path.described_alone(slot.effect, changed(here))
    gained = isinstance(own.interrogator.gain, Tensor)
    if not (own.along_fiber or own.nonlinear or gained or stages.nonlinear or stages.processing.steps):
        return partial(refiltered, seen, changed, here)
    along = pushing(lambda value: (path.described(changed(value)).observed(alone, seen.samples),), here)
    return lambda way: along(way)[0]


def refiltered(seen: "Seen", changed: Changed, here: Tensor, way: Tensor) -> Tensor:
    """Change of the map with filters in time: it is linear in what these make of each frequency."""

    def transfer(s: Tensor) -> Tensor:
        def factor(value: Tensor) -> tuple[Tensor]:
            return (torch.view_as_real(together(seen.path.described(changed(value)).in_time, s)),)

        return torch.view_as_complex(pushed_all(factor, here, way)[0].contiguous())

    return seen.path.described(changed(here)).filtered_by(transfer).observed(seen.local.alone, seen.samples)


def by_channel(moved: Moved, here: Tensor, chosen: Tensor | slice | None) -> Tensor | None:
    """Derivative of the map [sample, channel] by a parameter's value at the channel itself; None where others matter.

    A direction drawn at random tells: only where each channel depends on its own value alone is its change in
    proportion to its share of the direction.

    Parameters
    ----------
    moved : change of the map in a direction [computed channel]
    here : the parameter's values
    chosen : which of the computed channels were measured; all where None
    """
    drawn = torch.rand(here.shape, generator=torch.Generator().manual_seed(1), dtype=torch.float64) + 0.5
    each, some = moved(torch.ones_like(here)), moved(drawn)
    expected = each * (drawn if chosen is None else drawn[chosen])
    return each if bool((some - expected).abs().max() <= ROUNDING * some.abs().max()) else None
