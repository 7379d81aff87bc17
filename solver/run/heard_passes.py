"""Vehicles that nobody listed, fitted beside those of the trajectories.

They are listened for in the record first, and then in what a fit of all that is known leaves: there a vehicle is heard
that drives close behind a louder one, and no vehicle has lobes.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from solver.fit.result import FitResult, Parameter
from solver.fit.stretches import TAIL
from solver.start.free_tracks import SAME_VEHICLE, Unlisted, is_heard, unlisted, unlisted_line
from solver.start.heard import Heard, Hearing, middle_times, pair
from solver.start.initialization import Initialization
from solver.start.section_tracks import unlisted_along
from solver.survey.das.record import DASRecord
from solver.trajectory.vehicle_pass import Pass
from vision.contract import InputError

if TYPE_CHECKING:
    from solver.run.passes_fit import Fitting, PassesFit
    from solver.run.run import Run

Array = NDArray[np.float64]
#: A record as the matched filter looks at it; and prior means of depth, m, and Poisson's ratio.
Shown = Callable[[DASRecord], DASRecord]
Priors = Mapping[str, float]

#: How often what a fit leaves is listened to, at most.
ROUNDS = 5
#: What weighs less than this share of the usual listed vehicle is no vehicle, but what a model leaves of one; nor is
#: what has a weight of less than so many sigmas.
LIGHTEST, SURE = 0.1, 4.0


def fit_hearing(
    fitting: "Fitting",
    passes: Sequence[Pass],
    shown: Shown,
    priors: Priors,
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
    rough, sections = fitting.found.rough, fitting.found.sections

    def listened(record: DASRecord, listed: Sequence[Pass], late: float | None) -> Unlisted:
        with fitting.timed("listen"):
            if rough is None:
                return unlisted_along(shown(record), sections, listed, **priors, tail=TAIL, late=late)
            return unlisted(shown(record), rough, listed, **priors, tail=TAIL, late=late)

    first = found = listened(fitting.record, passes, None)
    fit = fitting.of(in_order([*passes, *as_fitted(found.beside)]))
    for _ in range(ROUNDS):
        left = left_by(fitting.record, fit.result, fit.result.samples)
        found = listened(left, fit.passes, found.late)
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


def left_by(record: DASRecord, result: FitResult, rows: NDArray[np.int64]) -> DASRecord:
    """The record less the model of a fit, whose samples are these rows [sample] of it."""
    columns = np.searchsorted(record.channel, result.fitted_channel)
    left = np.array(record.strain_rate)
    left[np.ix_(rows, columns)] -= np.nan_to_num(result.model)
    return replace(record, strain_rate=left)


def heard_with(run: "Run", record: DASRecord, rough: Initialization, shown: Shown, priors: Priors) -> list[Heard]:
    """The vehicles of a run that have a weight, and those that are heard in what it leaves, in the order of time.

    A louder vehicle nearby hides one from the matched filter, and makes lobes that look like one; to a fit it does not.

    Parameters
    ----------
    record : that the run is of, at all times
    rough : route
    shown, priors : as of `fit_hearing`

    Raises
    ------
    InputError
        If the run is not of this record.
    """
    hearing, every = Hearing.of(shown(record), rough, **priors), passes_in(run, record)
    seen = [one for one in every if not is_heard(one)]
    known = [one for one in every if weighs(run.result, one, seen)]
    raw, middle = hearing.vehicles(), middle_times(seen, hearing.middle, record.row_time)
    ahead = np.nan_to_num(pair(raw, middle, np.array([one.speed for one in seen])).offset)
    fitted, whole = rows_in(run, record, run.time), float(record.row_time[-1])
    left = shown(left_by(record, run.result, fitted))
    more = unlisted(left, rough, known, **priors, tail=whole, late=float(ahead * record.sampling_rate)).beside
    if len(seen) < len(every):
        # Where this fit was listened to already, what is heard now had no weight in it.
        more = [one for one in more if not np.isin(one.rows, fitted).any()]
    found = []
    for one in [*known, *more]:
        (when,) = middle_times([one], hearing.middle, record.row_time)
        # Tracks of what was heard have the record's clock.
        there = hearing.along(when if is_heard(one) else when + ahead, one.speed)
        near = [other for other in raw if together(there, other)]
        found.append(min(near, key=lambda other: abs(other.time - there.time), default=there))
    inside = np.isin(np.rint([one.time * record.sampling_rate for one in raw]), fitted)
    found += [one for one, fit in zip(raw, inside, strict=True) if not fit and not any(together(one, o) for o in found)]
    return sorted((one for one in found if np.isfinite(one.time)), key=lambda one: one.time)


def rows_in(run: "Run", record: DASRecord, time: Array) -> NDArray[np.int64]:
    """Rows of a record at times of a run, s since the run's start."""
    late = (run.start - record.start) / np.timedelta64(1, "ns") * 1e-9
    return np.rint((time + late) * record.sampling_rate).astype(np.int64)


def passes_in(run: "Run", record: DASRecord) -> list[Pass]:
    """The passes that a run fitted, at the rows of a record; InputError if the run is of another."""
    rows, channels = rows_in(run, record, run.time[[0, -1]]), run.result.fitted_channel
    alike = abs(run.problem.sampling_rate / record.sampling_rate - 1) < 1e-6
    if not alike or rows[0] < 0 or rows[1] >= len(record.time) or not np.isin(channels, record.channel).all():
        raise InputError(f"{run.name}: the run is of another record; give one of this site")
    return [replace(one, rows=rows_in(run, record, run.problem.time_of(one.rows))) for one in run.problem.passes]


def together(one: Heard, other: Heard) -> bool:
    """Whether two that were heard are one vehicle."""
    return one.speed * other.speed > 0 and abs(one.time - other.time) * abs(other.speed) < SAME_VEHICLE


def weighs(result: FitResult, one: Pass, listed: Sequence[Pass]) -> bool:
    """Whether a pass has the weight of a vehicle, by that of the listed ones."""
    mine, others = sizes(result, one), [size for each in listed for size in sizes(result, each)]
    if not mine or not others:
        return bool(mine)
    usual = float(np.median([each.value for each in others]))
    return any(each.value > max(LIGHTEST * usual, SURE * each.sigma) for each in mine)


def sizes(result: FitResult, one: Pass) -> list[Parameter]:
    """Amplitudes of a pass: one, or on a long fiber one for each stretch."""
    name = f"amplitude[{one.track_id}"
    return [size for key, size in result.parameters.items() if key == f"{name}]" or key.startswith(f"{name} at x ")]
