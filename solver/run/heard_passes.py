"""Vehicles that nobody listed, put beside those of the trajectories."""

from collections.abc import Mapping, Sequence

from solver.fit.stretches import TAIL
from solver.start.first_routes import FirstRoutes
from solver.start.free_tracks import unlisted, unlisted_line
from solver.survey.das.record import DASRecord
from solver.trajectory.vehicle_pass import Pass


def with_unlisted(
    record: DASRecord, found: FirstRoutes, passes: Sequence[Pass], priors: Mapping[str, float], warnings: list[str]
) -> list[Pass]:
    """The passes and, with free tracks, those of vehicles that were heard among them and that nobody listed.

    Parameters
    ----------
    priors : prior means of depth, m, and Poisson's ratio
    warnings : what the user should read of them is added
    """
    if found.rough is None:
        return list(passes)
    more = unlisted(record, found.rough, passes, **priors, tail=TAIL)
    if line := unlisted_line(more, record.time):
        warnings.append(line)
    return sorted([*passes, *more.beside], key=lambda one: (int(one.rows[0]), one.track_id))
