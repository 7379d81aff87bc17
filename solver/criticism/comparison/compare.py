"""Compare a run's model with the measurement."""

from solver.criticism.comparison.cells import cells_of
from solver.criticism.comparison.comparison import Comparison
from solver.criticism.comparison.power import power_of
from solver.criticism.comparison.region_search import TRIED, regions_of
from solver.criticism.comparison.split import split_of
from solver.criticism.comparison.stack import stack_of
from solver.run.run import Run
from vision.contract import progress


def compare(run: Run) -> Comparison:
    """Compare a run's model with the measurement.

    Everything is computed of the residual as the fit weighed it: divided by the noise, whitened in time and across
    channels, and with the robust weights, so that noise alone has unit variance.

    Parameters
    ----------
    run : as `solver.run.folder.read_run` reads it

    Returns
    -------
    comparison : where, when and how model and measurement differ

    Notes
    -----
    What the fit could absorb by moving the route is no longer in the residual: a comparison shows what is left, and the
    score tests of `roadfiber diagnose` say what was absorbed.
    """
    with progress("comparing model and measurement", 3 + 2 * TRIED) as advance:
        cells = cells_of(run)
        advance(1)
        split = split_of(run, cells)
        advance(1)
        stack, power = stack_of(run, cells), power_of(run, cells)
        advance(1)
        misfit = run.facts["chi2_per_dof"], run.facts["noise_floor"]
        return Comparison(regions_of(run, cells, advance), split, stack, power, cells.level, *misfit)
