"""Problems from the independent simulator, stated as `locate` states them."""

from dataclasses import dataclass, replace

import numpy as np

from solver.fit.pose import pose
from solver.fit.prior import Prior
from solver.fit.problem import Problem
from solver.simulator import Survey
from solver.survey.anchors import Anchor
from solver.survey.das import DASRecord
from solver.trajectory.passes import smooth_passes


def record_of(survey: Survey) -> DASRecord:
    """Return the simulated record as if read from a file."""
    return DASRecord(
        strain_rate=survey.strain_rate,
        time=survey.time,
        start=survey.start,
        distance=survey.distance,
        channel=np.arange(len(survey.distance)),
        gauge_length=survey.scenario.gauge_length,
        channel_spacing=survey.scenario.channel_spacing,
        sampling_rate=survey.scenario.sampling_rate,
        gaps=(),
        provenance={},
    )


@dataclass(frozen=True)
class Case:
    """A problem and the route that it should find, [fitted channel, 3]."""

    problem: Problem
    truth: np.ndarray


def case_of(survey: Survey, gauge_length: float | None = None) -> Case:
    """State the fitting problem of a simulated survey, beginning half a meter beside the truth."""
    record = record_of(survey)
    if gauge_length is not None:
        record = replace(record, gauge_length=gauge_length)
    channel = np.arange(survey.active[0], survey.active[1] + 1)
    truth = survey.route[channel]
    aside = np.full(len(truth), truth[:, 1].mean() + 0.5)
    start = np.column_stack([truth[:, 0] + 0.5, aside, np.full(len(truth), 0.9)])
    anchors = [Anchor(**row) for row in survey.anchors.to_dict("records")]
    passes = smooth_passes(survey.trajectories, record)
    return Case(pose(record, passes, anchors, start, channel, Prior()), truth)
