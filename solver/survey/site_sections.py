"""The tables of `site.toml`."""

from pathlib import Path
from typing import Annotated, Any

from pydantic import (
    AfterValidator,
    AwareDatetime,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationInfo,
    field_validator,
    model_validator,
)

from solver.survey.das.units import Quantity
from solver.survey.limits import VEHICLE_REACH
from solver.survey.patterns import files_matching
from vision.contract.text import FARTHEST, LONGEST, YEARS, is_name, plain

STORE_FILE = "store.json"  # which identifies the folder of a store
DETECTORS = ("nanodet", "street")  # built in, the default first


def folder_of(info: ValidationInfo) -> Path:
    """Return the site file's folder, which `read_site` passes along."""
    context: dict[str, Any] = info.context or {}
    return Path(context["folder"])


def beside(path: Path, info: ValidationInfo) -> Path:
    """Return `path` relative to the site file's folder, whether it exists or not.

    Raises
    ------
    ValueError
        If its name, which pages and files repeat, controls terminals.
    """
    full = folder_of(info) / path
    if plain(str(full)) != str(full):
        raise ValueError(f"{plain(str(full))!r} is no name in one line; rename it")
    return full


def existing(path: Path, info: ValidationInfo) -> Path:
    """Return `path` relative to the site file's folder; ValueError if there is no such file."""
    full = beside(path, info)
    if not full.is_file():
        raise ValueError(f"no such file {str(path)!r} beside the site file")
    return full


def matching(patterns: Any, info: ValidationInfo) -> list[Path]:
    """Return the files that name patterns match in the site file's folder, sorted, each once."""
    patterns = [patterns] if isinstance(patterns, str) else patterns
    if not patterns or not isinstance(patterns, list) or not all(isinstance(item, str) for item in patterns):
        raise ValueError("give a list of file names or patterns, as ['das/*.h5']")
    folder = folder_of(info)
    found: set[Path] = set()
    for pattern in patterns:
        # Files derived from the record are not part of it.
        hits = {path for path in files_matching(pattern, folder) if not (path.parent / STORE_FILE).is_file()}
        if not hits:
            raise ValueError(f"no file matches {pattern!r} beside the site file")
        found.update(beside(path, info) for path in hits)
    return sorted(found)


def detector_of(detector: Any, info: ValidationInfo) -> Any:
    """Read a detector: the name of a built-in one, or a file."""
    if not isinstance(detector, str):
        raise ValueError(f"give {', '.join(DETECTORS)} or an .onnx file")
    return detector if detector in DETECTORS else existing(Path(detector), info)


def one_line(name: str) -> str:
    """Return a name; ValueError if it is none."""
    if not is_name(name):
        raise ValueError(f"{plain(name[:LONGEST])!r}; give at most {LONGEST} characters in one line")
    return name


Name = Annotated[str, AfterValidator(one_line)]
File = Annotated[Path, AfterValidator(existing)]
Files = Annotated[list[Path], BeforeValidator(matching, json_schema_input_type=str | list[str])]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class Section(BaseModel):
    """A table of site.toml; keys it does not have are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class FrameSection(Section):
    """`[frame]`: where x = y = 0 is, and where +x points.

    Attributes
    ----------
    origin : latitude and longitude of x = y = 0, WGS 84, degrees
    x_azimuth : direction of +x, along the road, degrees clockwise from north
    """

    origin: tuple[Annotated[float, Field(ge=-90, le=90)], Annotated[float, Field(ge=-180, le=180)]]
    x_azimuth: Annotated[float, Field(ge=-360, le=360)]


class DASSection(Section):
    """`[das]`: the files, what they do not state themselves, and the folder of their store, if one is made.

    Attributes
    ----------
    files : names or patterns of the DAS files, relative to site.toml
    gauge_length : where the files do not say it, m
    channel_spacing : where the files do not say it, m
    quantity : what the files hold, where they do not say it
    scale : factor from the stored numbers to the quantity's unit, where the files do not say it
    channels : first and last to be used
    exclude : channels to be left out
    store : folder that `ingest` writes, relative to site.toml
    """

    files: Files
    gauge_length: Positive | None = None
    channel_spacing: Positive | None = None
    quantity: Quantity | None = None
    scale: Annotated[float, Field(allow_inf_nan=False)] | None = None
    channels: tuple[int, int] | None = None
    exclude: tuple[int, ...] = ()
    store: Annotated[Path, Field(validate_default=True), AfterValidator(beside)] = Path("das-store")

    @property
    def said(self) -> dict[str, Any]:
        """The settings of the files, as arguments of `solver.survey.das.description.describe`."""
        names = ("gauge_length", "channel_spacing", "quantity", "scale", "channels", "exclude")
        return {name: getattr(self, name) for name in names}

    @model_validator(mode="after")
    def ordered(self) -> "DASSection":
        """Refuse a channel range that ends before it begins."""
        if self.channels and self.channels[0] >= self.channels[1]:
            raise ValueError(f"channels is {list(self.channels)}; give [first, last], first below last")
        return self


class CameraSection(Section):
    """`[camera]`: the video and how its pixels and its clock become meters and UTC.

    Attributes
    ----------
    video : file, relative to site.toml
    calibration : file that `calibrate ground` wrote
    start : of the video, with a zone
    clock_offset : how far the camera's clock is ahead, s; it is taken off the video's times
    detector : `nanodet`, `street` or an .onnx file
    """

    video: File
    calibration: File
    start: Annotated[AwareDatetime, Field(ge=YEARS[0], lt=YEARS[1])]
    clock_offset: Annotated[float, Field(ge=-FARTHEST, le=FARTHEST)] = 0.0
    detector: Annotated[Path | str, BeforeValidator(detector_of, json_schema_input_type=str)] = DETECTORS[0]


class TrajectoriesSection(Section):
    """`[trajectories]`: trajectory tables or GPS tracks.

    Attributes
    ----------
    files : names or patterns of .csv, .parquet or .gpx files
    """

    files: Files


class AnchorsSection(Section):
    """`[anchors]`: fiber points known from manholes or tap tests.

    Attributes
    ----------
    file : csv of anchors
    """

    file: File


class RouteSection(Section):
    """`[route]`: the operator's map of a cable that one car with GPS drove along: a prior, not the truth.

    `sigma`, m, is how far the map may be off; `length_factor` the meters of cable per meter of map, loops left out, and
    its standard deviation.
    """

    file: File
    sigma: Positive = 8.0
    length_factor: tuple[Positive, Positive] = (1.0, 0.02)

    @field_validator("length_factor")
    @classmethod
    def near_one(cls, factor: tuple[float, float]) -> tuple[float, float]:
        """Refuse a factor that no cable has."""
        if not 0.5 < factor[0] < 2 or factor[1] > 0.2:
            raise ValueError(f"{list(factor)}; give cable per meter of map and its sd, as [1.0, 0.02]")
        return factor


class GroundSection(Section):
    """`[ground]`: what is known beforehand about the ground and the depth.

    Attributes
    ----------
    poisson_ratio : of the ground
    depth : mean and standard deviation of the fiber's mean depth, m
    """

    poisson_ratio: Annotated[float, Field(gt=0, lt=0.5)] = 0.25
    depth: tuple[Positive, Positive] = (0.9, 0.3)

    @property
    def means(self) -> dict[str, float]:
        """Prior means of depth, m, and Poisson's ratio, as the matched filter takes them."""
        return {"depth": self.depth[0], "poisson_ratio": self.poisson_ratio}

    @field_validator("depth")
    @classmethod
    def within_reach(cls, depth: tuple[float, float]) -> tuple[float, float]:
        """Refuse a depth at which no vehicle can be recorded."""
        if max(depth) > VEHICLE_REACH:
            raise ValueError(
                f"mean {depth[0]:g} m, sd {depth[1]:g} m; no vehicle is sensed deeper than {VEHICLE_REACH:g} m: "
                "give both in m, as [0.9, 0.3]"
            )
        return depth
