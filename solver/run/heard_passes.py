"""Vehicles that nobody listed, fitted beside those of the trajectories.

They are listened for in the record first, and then in what a fit of all that is known leaves: there a vehicle is heard
that drives close behind a louder one, and no vehicle has lobes.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from solver.fit.result import FitResult
from solver.fit.stretches import TAIL
from solver.start.free_tracks import Unlisted, is_heard, unlisted, unlisted_line
from solver.survey.das.record import DASRecord
from solver.trajectory.vehicle_pass import Pass

if TYPE_CHECKING:
    from solver.run.passes_fit import Fitting, PassesFit

#: How often what a fit leaves is listened to, at most.
ROUNDS = 5
#: What weighs less than this share of the usual listed vehicle is no vehicle, but what a model leaves of one; nor is
#: what has a weight of less than so many sigmas.
LIGHTEST, SURE = 0.1, 4.0


def fit_hearing(
    fitting: "Fitting",
    passes: Sequence[Pass],
    shown: Callable[[DASRecord], DASRecord],
    priors: Mapping[str, float],
    as_fitted: Callable[[Sequence[Pass]], list[Pass]],
) -> "PassesFit":
    """Fit the passes and, with free tracks, vehicles that nobody listed and that strain the fiber while they do.

    Parameters
    ----------
    passes : of the trajectories
    shown : a record as the matched filter looks at it
    priors : prior means of depth, m, and Poisson's ratio
    as_fitted : passes with the wheels that the model has
    """
    rough = fitting.found.rough
    if rough is None:
        return fitting.of(passes)

    def listened(record: DASRecord, listed: Sequence[Pass], late: float | None) -> Unlisted:
        with fitting.timed("listen"):
            return unlisted(shown(record), rough, listed, **priors, tail=TAIL, late=late)

    first = found = listened(fitting.record, passes, None)
    fit = fitting.of(in_order([*passes, *as_fitted(found.beside)]))
    for _ in range(ROUNDS):
        found = listened(left_by(fitting.record, fit.result), fit.passes, found.late)
        if not found.beside:
            break
        again = fitting.of(in_order([*fit.passes, *as_fitted(found.beside)]))
        light = {one.track_id for one in found.beside if not weighs(again.result, one, passes)}
        if len(light) == len(found.beside) or not again.result.converged:
            break
        fit = fitting.of([one for one in again.passes if one.track_id not in light]) if light else again
    # What is too faint to be followed in the record may be a lobe, and in what is left the rest of a vehicle.
    told = replace(first, beside=[one for one in fit.passes if is_heard(one)], lost=min(first.lost, found.lost))
    if line := unlisted_line(told, fitting.record.time):
        fit.warnings.insert(0, line)
    return fit


def in_order(passes: Sequence[Pass]) -> list[Pass]:
    """Passes by time."""
    return sorted(passes, key=lambda one: (int(one.rows[0]), one.track_id))


def left_by(record: DASRecord, result: FitResult) -> DASRecord:
    """The record less the model of a fit, where there is one."""
    rows, columns = result.samples, np.searchsorted(record.channel, result.fitted_channel)
    left = record.strain_rate.astype(float)
    left[np.ix_(rows, columns)] -= np.nan_to_num(result.model)
    return replace(record, strain_rate=left)


def weighs(result: FitResult, one: Pass, listed: Sequence[Pass]) -> bool:
    """Whether a pass has the weight of a vehicle, by that of the listed ones."""
    fitted = {name: size for each in listed if (size := result.parameters.get(name := f"amplitude[{each.track_id}]"))}
    mine = result.parameters.get(f"amplitude[{one.track_id}]")
    if mine is None or not fitted:
        return mine is not None
    usual = float(np.median([each.value for each in fitted.values()]))
    return mine.value > max(LIGHTEST * usual, SURE * mine.sigma)
