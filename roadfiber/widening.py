"""A run's corridor with what its model may lack: what `locate` and `add` end with."""

import time
from dataclasses import replace
from typing import TYPE_CHECKING

from vision.contract.errors import InputError

if TYPE_CHECKING:
    from solver.run.run import Run

#: Kinds of corridors: with what the model may lack, or the fit's own, which takes its model for granted.
FULL, FIT = "full", "fit"


def check_corridor(kind: str) -> None:
    """Refuse another kind than "full" and "fit".

    Raises
    ------
    InputError
        For any other.
    """
    if kind not in (FULL, FIT):
        raise InputError(f"corridor {kind}: not known; give {FULL} or {FIT}")


def with_corridor(run: "Run", kind: str) -> "Run":
    """The run with a corridor of a kind and its local misfit told, and the seconds that it took among its timings."""
    from solver.criticism.comparison.local_misfit import with_local_misfit
    from solver.criticism.quick_corridor import widened, widening_steps
    from vision.contract import progress

    begun = time.perf_counter()
    if kind == FULL:
        with progress("weighing what the model may lack", widening_steps(run)) as advance:
            run = widened(run, advance)
    run = with_local_misfit(run)
    timings = run.facts["timings"] | {"corridor": time.perf_counter() - begun}
    return replace(run, facts=run.facts | {"timings": timings})
