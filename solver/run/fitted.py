"""The fit of a run, ready to be continued."""

import torch

from solver.fit.map_fit import MapFit
from solver.fit.state import State
from solver.fit.stretches import ONE_STRETCH, is_long
from solver.run.run import Run
from vision.contract import InputError


def too_long(run: Run) -> str:
    """Why the model of a run cannot be criticized as a whole, and what to do; empty where it can."""
    if not is_long(run.problem):
        return ""
    length = run.problem.distance[-1] - run.problem.distance[0]
    return (
        f"run of {length:.0f} m of fiber: a model is criticized over {ONE_STRETCH:.0f} m at most; "
        "name a stretch as channels in site.toml and locate that"
    )


def fitted(run: Run) -> tuple[MapFit, State]:
    """The fit of a run and where it ended.

    Raises
    ------
    InputError
        If the run is of a long fiber, where effects would have to be the same along all of it; if it holds other
        numbers than its model has; or if code of its model was not given.
    """
    if words := too_long(run):
        raise InputError(words)
    fit = MapFit(run.problem)
    if len(run.result.vector) != len(fit.mean):
        raise InputError(
            f"run: holds {len(run.result.vector)} fitted numbers, and its model has {len(fit.mean)}; "
            "give the plugin it was made with, or run `roadfiber locate` again"
        )
    return fit, fit.state_of(torch.from_numpy(run.result.vector))
