"""What the JSON files hold that roadfiber writes for other programs and never reads back."""

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict

from solver.criticism.audit import NoiseAudit
from solver.criticism.candidate import Candidate
from solver.criticism.explanations import Weighed


class Written(BaseModel):
    """A JSON object that is only written: null stands for a number that is not known or not finite."""

    model_config = ConfigDict(extra="forbid")


class CorridorFile(Written):
    """What a diagnosis adds to a route's corridor for all that its model may lack.

    Attributes
    ----------
    channel : channel numbers
    added_sigma : standard deviations of x, y, z that are added to the fit's by their squares, m, for each channel
    widest : effect that adds most, or disagreement (of vehicles about the route); empty where nothing does
    share : of what is added, by that
    """

    channel: tuple[int, ...]
    added_sigma: tuple[tuple[float, float, float], ...]
    widest: str
    share: float


class DiagnosisFile(Written):
    """diagnosis.json: which physical effect the model of a run lacks, if any.

    Attributes
    ----------
    format : of the file
    headline : the verdict as a sentence in plain words
    verdict : on the model
    words : the verdict in the commands' terms, with sizes
    candidates : effects and faults, best first
    audit : of the noise, which comes before everything else
    stress : largest residual along what was fitted, posterior sigmas; far below 1 where the fit converged
    separate : what survey would tell the confounded apart; empty where nothing is confounded
    left : ln of the Bayes factor of the best effect beside the first candidate
    bend : where the fiber bends more sharply than the route follows; empty where nothing shows of that
    explanations : nothing that would show, each effect or fault, something unknown at each stage, most probable first;
        their probabilities sum to 1; empty where the noise is not understood
    corridor : what the route's corridor is wider by; absent where the noise is not understood
    """

    format: Literal["roadfiber diagnosis 1"]
    headline: str
    verdict: Literal["adequate", "missing-effect", "unknown-effect", "inconclusive"]
    words: str
    candidates: tuple[Candidate, ...]
    audit: NoiseAudit
    stress: float
    separate: str
    left: float
    bend: str = ""
    explanations: tuple[Weighed, ...]
    corridor: CorridorFile | None = None


class RegionFile(Written):
    """A place where the model fails.

    Attributes
    ----------
    kind : gain (relative), late (s), place (m along the fiber), offset (noise sigmas), power (near vehicles), shape (at
        one distance from the vehicle) or unseen (far from all vehicles)
    passes : track ids
    every_pass : whether these are all
    channels : first and last
    x : at those channels, m
    time : first and last, ISO 8601 UTC; null where passes at several times are meant
    ahead : of the vehicle, first and last, m; null where it does not matter
    amount, sigma : size of the change and its standard deviation, in `unit`
    meters : the delay of a single pass as a distance, m
    speed : toward higher channels of what moves there, m/s
    chi2 : how much of the misfit it is
    z : statistic of the scan, standard deviations
    words : the same as a sentence
    unit : of amount and sigma
    """

    kind: str
    passes: tuple[str, ...]
    every_pass: bool
    channels: tuple[int, int]
    x: tuple[float, float]
    time: tuple[str, str] | None
    ahead: tuple[float, float] | None
    amount: float
    sigma: float
    meters: float | None
    speed: float | None
    chi2: float
    z: float
    words: str
    unit: str


class SplitFile(Written):
    """Whose the misfit is.

    Attributes
    ----------
    chi2 : sum of the squared whitened residuals
    explained : by source, beyond what it would explain of noise
    freedom : numbers that each source spends
    noise : that noise alone leaves
    unexplained : the rest
    shares : of `chi2`
    """

    chi2: float
    explained: dict[str, float]
    freedom: dict[str, int]
    noise: float
    unexplained: float
    shares: dict[str, float]


class StackFile(Written):
    """Residual and model in the vehicle's frame, in units of the stacked model's peak.

    Attributes
    ----------
    ahead : of the vehicle along the fiber [bin], m
    channels : first and last of each group of channels; the first group is all of them
    measured, model, residual : [group][bin]
    symmetric, antisymmetric : parts of the residual, [group][bin]
    sigma : of the residual if the noise were white, [group][bin]
    """

    ahead: tuple[float, ...]
    channels: tuple[tuple[int, int], ...]
    measured: tuple[tuple[float, ...], ...]
    model: tuple[tuple[float, ...], ...]
    residual: tuple[tuple[float, ...], ...]
    symmetric: tuple[tuple[float, ...], ...]
    antisymmetric: tuple[tuple[float, ...], ...]
    sigma: tuple[tuple[float, ...], ...]


class PowerFile(Written):
    """Power of the residual at one value of a property.

    Attributes
    ----------
    label : the value
    chi2 : per sample; 1 where only noise is left
    sigma : of chi2 if only noise were left
    samples : how many
    """

    label: str
    chi2: float
    sigma: float
    samples: int


class CompareFile(Written):
    """compare.json: model against measurement; where, when and how they differ.

    Attributes
    ----------
    format : of the file
    name : of the survey
    created : when the run was made, UTC
    effects : in the model
    verdict : in words
    trust : whether the route may be relied on, in a sentence
    units : of everything below
    chi2_per_dof : misfit of the fit, as fit.json has it
    noise_floor : what noise alone would leave of it; null where that is not known
    samples : how many
    regions : where the model fails, worst first
    split : whose the misfit is
    stack : the residual in the vehicle's frame
    power : of the residual by channel, pass, speed, class, lane, gap; by pass and channel; and its spectrum
    noise : mean square of the whitened residual by channel where no vehicle is
    """

    format: Literal["roadfiber comparison 1"]
    name: str
    created: str
    effects: tuple[str, ...]
    verdict: str
    trust: str
    units: dict[str, Any]
    chi2_per_dof: float
    noise_floor: float | None
    samples: int
    regions: tuple[RegionFile, ...]
    split: SplitFile
    stack: StackFile
    power: dict[str, tuple[PowerFile, ...] | tuple[tuple[float, ...], ...] | dict[str, Any]]
    noise: dict[str, float]


class Feature(Written):
    """A GeoJSON feature (RFC 7946).

    Attributes
    ----------
    type : Feature
    geometry : LineString, Polygon or Point; longitude, latitude, and minus the depth, m
    properties : `what` is `fiber route`, `95 % corridor` or `anchor`
    """

    type: Literal["Feature"]
    geometry: dict[str, Any]
    properties: dict[str, Any]


class RouteFeatures(Written):
    """route.geojson: the route, its 95 % corridor and the anchors, WGS 84 (RFC 7946).

    Attributes
    ----------
    type : FeatureCollection
    features : the route first, then a polygon per stretch of the corridor, then the anchors
    """

    type: Literal["FeatureCollection"]
    features: tuple[Feature, ...]
