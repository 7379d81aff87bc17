"""What is fitted of a survey: its smooth passes, its rough routes, and a problem for each of these."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from solver.effect import Effect
from solver.fit.choice import Choice
from solver.fit.pose import pose, with_common_errors, with_slow_errors
from solver.fit.prior import Prior
from solver.fit.problem import Problem
from solver.fit.some_passes import only
from solver.load.wheel_layout import not_known
from solver.start.alignment import NotFollowingError
from solver.start.first_routes import FirstRoutes, find_first_routes
from solver.start.initialization import ClocksApartError, initialize
from solver.survey.anchors import Anchor
from solver.survey.das.record import DASRecord, channel_ranges
from solver.survey.das.rounding import told
from solver.survey.dead_channels import dead_channels
from solver.survey.survey import Survey
from solver.trajectory.agreement import slow_line, suspicions
from solver.trajectory.passes import smooth_passes
from solver.trajectory.vehicle_pass import Pass
from vision.contract import InputError

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]

#: m
FOOT = 0.3048
#: s by which clocks may differ, so far apart that what is between them is found too; no more of the record is read.
LATE = (-90.0, -60.0, -30.0, 30.0, 60.0, 90.0)


def smoothed(tracks: "pd.DataFrame", record: DASRecord, wheels: bool, warnings: list[str]) -> list[Pass]:
    """Smooth passes of the tracks; without `wheels` in the model every vehicle is a point load.

    Parameters
    ----------
    warnings : lines for the user are added
    """
    passes = smooth_passes(tracks, record, warnings=warnings)
    if wheels:
        warnings += not_known([one.vehicle_class for one in passes])
    else:
        passes = as_points(passes)
    if slow := slow_line(record, passes):
        warnings.append(slow)
    return passes


def as_points(passes: Sequence[Pass]) -> list[Pass]:
    """The passes of vehicles that are point loads."""
    return [replace(one, vehicle_class="vehicle") for one in passes]


def matched(
    record: DASRecord,
    passes: Sequence[Pass],
    anchors: Sequence[Anchor],
    priors: Mapping[str, float],
    warnings: list[str],
    *,
    raw: DASRecord,
) -> FirstRoutes:
    """Channels and rough routes by the matched filter; an error says what may be wrong with the files.

    Parameters
    ----------
    record : as the matched filter looks at it
    priors : prior means of depth, m, and Poisson's ratio
    warnings : lines for the user are added
    raw : the record as it came

    Raises
    ------
    InputError
        If no vehicle is seen in the record where the trajectories say.
    """
    try:
        return find_first_routes(record, passes, anchors, **priors, warnings=warnings)
    except InputError as error:
        if isinstance(error, NotFollowingError):
            for changed, late, words in mistaken(record, passes):
                if (more := ahead(record, changed, priors)) is not None:
                    raise InputError(f"{error.said}; it would if {words.format(-late - more)}") from error
        raise InputError(f"{error}{suspicions(raw, passes)}") from error


def mistaken(record: DASRecord, passes: Sequence[Pass]) -> Iterator[tuple[list[Pass], float, str]]:
    """Passes without a mistake that is often made, by how many seconds they are earlier, and the mistake in words."""

    def changed(change: Callable[[Array], Array]) -> list[Pass]:
        return [
            replace(one, position=change(one.position), velocity=change(one.velocity), sigma=change(one.sigma))
            for one in passes
        ]

    yield changed(lambda xy: FOOT * xy), 0.0, "x and y of the trajectories were in feet: give them in m"
    yield changed(lambda xy: xy / FOOT), 0.0, "gauge_length and channel_spacing were in feet: give them in m"
    words = "vehicles drove along x instead of y: see x_azimuth in [frame], or whether x and y are exchanged"
    yield changed(lambda xy: xy[:, ::-1]), 0.0, words
    words = "{:+.0f} s were added to the tracks' times: the clocks differ, or the times of a file are not as it says"
    for late in LATE:
        rows = round(late * record.sampling_rate)
        yield [part for one in passes if (part := earlier(one, rows, len(record.time)))], late, words


def earlier(one: Pass, rows: int, samples: int) -> Pass | None:
    """A pass some rows earlier, as far as a record of so many samples goes; None where nothing in view is left."""
    at = one.rows - rows
    keep = (at >= 0) & (at < samples)
    if not one.in_view[keep].any():
        return None
    kept = {name: getattr(one, name)[keep] for name in ("position", "velocity", "sigma", "in_view")}
    return replace(one, rows=at[keep], **kept)


def ahead(record: DASRecord, passes: Sequence[Pass], priors: Mapping[str, float]) -> float | None:
    """By how many seconds tracks are ahead of a record most of which follows them; None where it does not."""
    try:
        return initialize(record, passes, **priors, sure=True).clock_ahead
    except ClocksApartError as error:
        return error.ahead
    except InputError:
        return None


def problems_of(
    survey: Survey,
    record: DASRecord,
    passes: Sequence[Pass],
    found: FirstRoutes,
    effects: Sequence[Effect],
    warnings: list[str],
) -> list[Problem]:
    """A problem for each rough route.

    Parameters
    ----------
    survey : that is located
    record : its record, rounded samples dithered, in which dead channels are looked for
    passes : that are fitted
    found : channels, anchors and rough routes
    effects : of the model, parts of the base model among them
    warnings : lines for the user are added: dead channels, coarsely rounded samples
    """
    ground, raw = survey.ground, survey.record
    prior = Prior(depth=ground.depth, poisson_ratio=(ground.poisson_ratio, Prior.poisson_ratio[1]))
    dead = dead_channels(record, found.channel)
    if len(dead):
        warnings.append(
            f"{channel_ranges(dead)} left out, nearly silent where their neighbors record vehicles; "
            "the route there depends on their neighbors"
        )
    begun = pose(raw, passes, found.anchors, found.routes[0], found.channel, prior, dead)
    if raw.rounding:
        warnings += told(raw.rounding.at(begun.channel - raw.channel[0]), begun.noise.numpy())
    # All starts share noise and samples, so that their misfits compare.
    alive = np.isin(found.channel, begun.channel)
    begun = replace(
        begun,
        effects=tuple(one for one in effects if not one.base_part),
        curved=any(one.base_part == "bends" for one in effects),
        coil=found.coil,
    )
    if survey.camera is not None:
        begun = with_common_errors(begun)
    # Of many passes, a few may be chosen.
    return [with_slow_errors(replace(begun, start=start[alive]), many=np.inf) for start in found.routes]


def untaken(problem: Problem, whole: Problem, choice: Choice | None) -> Problem | None:
    """The survey of passes that were not chosen, over the channels of the problem that was fitted; None without any."""
    if choice is None or not choice.others:
        return None
    columns = np.isin(whole.channel, problem.channel)
    every = replace(problem, record=whole.record[:, columns], passes=whole.passes, traffic=whole.traffic)
    return only(every, choice.others)
