"""One route from several runs."""

from solver.run.combined import Combined
from solver.run.combined import combine as combine_runs
from solver.run.run import Run

__all__ = ["Combined", "combine"]


def combine(*runs: Run) -> Combined:
    """Combine runs of one fiber, of several days or cameras, into one route.

    The normal equations of all runs are summed, so that the route is the one that a single fit of all passes finds, and
    not an average: what one run tells of a place counts as much as it is sure of it. Priors and anchors count once.
    Where runs differ by more than their sigmas, they are named and all sigmas are widened.

    Parameters
    ----------
    runs : two or more, of one fiber in one frame, of other vehicles each

    Returns
    -------
    combined : its `route`, `table` (how far each run is from it), `plot()`, `to_geojson()`, `save()`

    Raises
    ------
    InputError
        If runs have different frames, channels or effects, share vehicles, or were made by another method than spline.

    Examples
    --------
    >>> rf.combine(run)
    Traceback (most recent call last):
    vision.contract.errors.InputError: combine: give two runs at least, of one fiber
    """
    return combine_runs(*runs)
