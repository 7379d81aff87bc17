"""What of a run is drawn on the rungs above it: the residual of one pass, small, and how far its anchors are off."""

from dataclasses import dataclass

import numpy as np

from solver.run.report.misfit import misfit_of, rows_of, whole_range
from solver.run.run import Run
from solver.run.rung import Glimpse

#: Rows and columns of the residual at most.
CELLS = 48


@dataclass(frozen=True)
class Miss:
    """How far the route is from an anchor: m, and in sigmas of the anchor."""

    length: float
    sigmas: float


def misses(run: Run) -> dict[str, Miss]:
    """How far the route is from each anchor, by its name."""
    result, found = run.result, dict[str, Miss]()
    for one in run.anchors:
        place = np.array([np.interp(one.channel, result.channel, column) for column in result.route.T])
        off = place - [one.x, one.y, one.z]
        sigma = np.array([one.sigma_xy, one.sigma_xy, one.sigma_z])
        found[one.name] = Miss(float(np.linalg.norm(off)), float(np.linalg.norm(off / sigma)))
    return found


def glimpse_of(run: Run, track: str = "") -> Glimpse:
    """What is drawn of a run.

    Parameters
    ----------
    run : to look at
    track : pass that is drawn; the one that fits worst where it is none of the run's
    """
    # Loads Matplotlib, as of the page of a run.
    from vision.contract.drawing import coarse

    off = tuple((name, round(m.length, 4), round(m.sigmas, 3)) for name, m in misses(run).items())
    by_track = {one.track_id: one for one in run.passes}
    if not by_track:
        return Glimpse("", (), off)
    if track not in by_track:
        by_pass = np.nan_to_num(misfit_of(run.result, run.passes).by_pass)
        track = run.passes[int(by_pass.argmax())].track_id
    rows = rows_of(run.result, by_track[track])
    if not len(rows):
        return Glimpse(track, (), off)
    image = coarse(whole_range(run.result, run.result.unexplained(rows) / run.result.noise), CELLS)
    cells = tuple(tuple(round(v, 1) if np.isfinite(v) else None for v in row) for row in image.tolist())
    return Glimpse(track, cells, off)
