"""JSON files of a run folder: who wrote them is not known, so everything in them is checked before it is used.

The models below are all that a run folder's JSON may hold: a key, type or size that they do not have is an error.
"""

from itertools import pairwise
from typing import Annotated, Literal, get_args

import numpy as np
from pydantic import ConfigDict, Field, model_validator

from solver.run.stored_choice import ChoiceFile
from solver.run.stored_corridor import CorridorFile
from solver.run.stored_types import (
    Channel,
    Count,
    Digest,
    FileName,
    Length,
    Moment,
    Place,
    Positive,
    Rate,
    Size,
    Spread,
    Stored,
    Text,
)
from solver.run.trust import Verdict

Format = Literal["roadfiber run 5"]
(FORMAT,) = get_args(Format)
#: What says of a file that it is of a run, of whatever version of roadfiber.
ANY_FORMAT = r"^roadfiber run (\d{1,9})$"


class FittedNumber(Stored):
    """One of `parameters`.

    Attributes
    ----------
    value, sigma : and its standard deviation; null where it is not known
    unit : of both
    free : whether it was fitted, and not held
    """

    value: float | None
    sigma: float | None
    unit: Text
    free: bool


class FrameFile(Stored):
    """`frame`: latitude and longitude of the origin, and the azimuth of +x, degrees."""

    origin: tuple[Annotated[float, Field(ge=-90, le=90)], Annotated[float, Field(ge=-180, le=180)]]
    x_azimuth: Annotated[float, Field(ge=-360, le=360)]


class AnchorFile(Stored):
    """One of `anchors`; fields as those of `solver.survey.anchors.Anchor`."""

    name: Text
    channel: Place
    x: Place
    y: Place
    z: Place
    sigma_xy: Positive
    sigma_z: Positive


class SettingsFile(Stored):
    """`settings`: what the fit was given, m, Hz, s."""

    gauge_length: Length
    channel_spacing: Length
    sampling_rate: Rate
    gaps: tuple[tuple[float, float], ...]
    poisson_ratio: Annotated[float, Field(ge=0, lt=0.5)]
    depth: tuple[Positive, Positive]


class PriorFile(Stored):
    """`problem.prior`; fields as those of `solver.fit.prior.Prior`."""

    depth: tuple[Spread, Spread]
    depth_slope: Spread
    curvature: Spread
    depth_curvature: Spread
    stretch: Spread
    poisson_ratio: tuple[Spread, Spread]
    along: Spread
    across: Spread
    track_freedom: Spread
    jitter: Spread
    effect_sd: dict[str, Spread]


class CoilFile(Stored):
    """`problem.coil`; fields as those of `solver.cable.fiber.Coil`."""

    place: Place
    length: Place
    origin: Place
    slope: float
    lateral: Place
    depth: Place


class CornerFile(Stored):
    """One of `corners`; fields as those of `solver.fit.corners.Corner`."""

    kind: Literal["corner", "step"]
    amount: Place
    sigma: Size
    length: Size
    distance: Place
    channel: Channel
    x: Place
    y: Place
    z: Place
    sigma_place: Size


class ProblemFile(Stored):
    """`problem`: what of `solver.fit.problem.Problem` are not arrays; `added` are the names of its effects."""

    recorded: tuple[Channel, Channel]
    zero_distance: Place
    channel_spacing: Length
    gauge_length: Length
    sampling_rate: Rate
    curved: bool
    signal_noise: Size
    knots: Annotated[tuple[Place, ...], Field(max_length=10**5)]
    prior: PriorFile
    added: Annotated[tuple[Text, ...], Field(max_length=1000)]
    coil: CoilFile | None
    windows: Annotated[tuple[tuple[Count, Size], ...], Field(max_length=10**5)] = ()

    @model_validator(mode="after")
    def distinct(self) -> "ProblemFile":
        """Refuse an effect that is there twice, and windows or knots that are not one after the other."""
        if len(set(self.added)) < len(self.added):
            raise ValueError("an effect is there twice")
        if any(after - before < 0.1 for before, after in pairwise(self.knots)):
            raise ValueError("knots of the route are not one after the other")
        for (first, begin), (row, time) in pairwise([(0, 0.0), *self.windows]):
            if row <= first or row - first > (time - begin + 1.0) * self.sampling_rate:
                raise ValueError("windows are not one after the other")
        return self


class PluginFile(Stored):
    """One of `plugins`: a file with effects of the model, as text for people to read."""

    file: FileName
    sha256: Digest
    effects: tuple[Text, ...]
    text: Annotated[str, Field(max_length=2**20)]


class InputFile(Stored):
    """One of `inputs`."""

    role: Text
    path: Text
    sha256: Digest


class GateFile(Stored):
    """One of `trust.gates`; fields as those of `solver.run.trust.Gate`.

    Attributes
    ----------
    name : of the check
    verdict : passed, failed, or open where it could not be made
    words : what was found, and what was expected
    mend : what to do where it failed
    found, expected, scatter : the number, what it should be, and by how much that scatters
    taken_up : share of the error that the fit takes up, so that the check does not see it
    where : the part of the fiber that a failed check is about; empty where it is all of it
    """

    name: Text
    verdict: Verdict
    words: Text
    mend: tuple[Text, ...]
    found: float | None
    expected: float | None
    scatter: float | None
    taken_up: float | None
    where: Text


class TrustFile(Stored):
    """`trust`; fields as those of `solver.run.trust.Trust`.

    Attributes
    ----------
    sentence : whether the route may be relied on, and what to do next where not
    grade : the same in a word
    gates : every check
    """

    sentence: Text
    grade: Literal["good", "fair", "weak", "poor"]
    gates: tuple[GateFile, ...]


class StatementFile(Stored):
    """A line of one of `statements`; fields as those of `vision.contract.statements.Statement`."""

    what: Text
    stated: tuple[tuple[Text, Text], ...]
    taken: Text
    caution: Text


class StatementsFile(Stored):
    """One of `statements`; fields as those of `vision.contract.statements.Statements`."""

    file: Text
    rows: tuple[StatementFile, ...]


class AnyRun(Stored):
    """The key of fit.json that marks a run of any version of roadfiber."""

    model_config = ConfigDict(extra="ignore")

    format: Annotated[str, Field(pattern=ANY_FORMAT)]


class FitFile(Stored):
    """fit.json: what `solver.run.facts.facts_of` makes, and what `solver.run.report.told` adds.

    Attributes
    ----------
    format : of the run folder
    name : of the survey
    method : spline or network
    converged : whether the fit did
    iterations : steps that it took
    seconds : that it took
    effects : in the model beyond the base
    parameters : every fitted number but the route's, by name
    chi2 : sum of the squared whitened residuals
    chi2_per_dof : the same per degree of freedom
    cost : chi2 and the priors' part
    noise_floor : chi2 per degree of freedom that noise alone would leave; null where too few samples tell
    held_out_chi2_per_dof : of passes that the fit has not seen; null where there are none
    active_channels : first and last that were fitted
    shared : shares of the variances of y and z that are common to all places that data decide; null where not known
    corners : where the fiber turns, or goes deeper or less deep
    ambiguous_side : whether the mirror route on the other side of the traffic is not ruled out
    disputed_anchors : that contradict the others, a sentence each
    trust : every check of the fit, and the sentence that follows from them
    corridor : how wide it is, with what the model may lack and without
    headline : where the fiber is, in a sentence
    notes : of `locate`, a line each
    warnings : what else must be known before the route is relied on, a line each
    frame : the local frame
    start : of the record, UTC
    anchors : as fitted
    settings : what the fit was given
    problem : what was fitted
    choice : of many passes, those that were fitted and why; absent where all were
    plugins : users' effects in the model, as text for people to read
    record : where the record comes from: format, original unit, scale ...
    statements : what each file of the record and of the tracks states, and what was taken of it
    inputs : every file that was read, with its checksum
    timings : of each step, s
    versions : of Python, roadfiber and what it computes with
    created : UTC
    """

    format: Format
    name: Annotated[str, Field(max_length=4096)]
    method: Text
    converged: bool
    iterations: Count
    seconds: Size
    effects: tuple[Text, ...]
    parameters: dict[Text, FittedNumber]
    chi2: Size | None
    chi2_per_dof: Size | None
    cost: float | None
    noise_floor: Size | None
    held_out_chi2_per_dof: Size | None
    active_channels: tuple[Channel, Channel]
    shared: tuple[Size, Size] | None
    corners: Annotated[tuple[CornerFile, ...], Field(max_length=10**4)]
    ambiguous_side: bool
    disputed_anchors: tuple[Text, ...]
    trust: TrustFile
    corridor: CorridorFile
    headline: Text
    notes: tuple[Text, ...]
    warnings: tuple[Text, ...]
    frame: FrameFile
    start: Moment
    anchors: tuple[AnchorFile, ...]
    settings: SettingsFile
    problem: ProblemFile
    choice: ChoiceFile | None = None
    plugins: tuple[PluginFile, ...]
    record: dict[Text, Text | float | int | bool | tuple[Text, ...] | None]
    statements: tuple[StatementsFile, ...]
    inputs: tuple[InputFile, ...]
    timings: dict[Text, Size]
    versions: dict[Text, Text]
    created: Moment

    @model_validator(mode="after")
    def in_time(self) -> "FitFile":
        """Refuse a start that no clock shows."""
        np.datetime64(self.start.removesuffix("Z"), "ns")
        return self
