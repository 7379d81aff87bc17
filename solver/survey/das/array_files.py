"""NumPy arrays as DAS files, with a side file that gives what an array does not."""

from collections.abc import Iterator
from datetime import UTC
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import AwareDatetime, BaseModel, ConfigDict, Field, ValidationError

from solver.survey.das.block import Block
from solver.survey.das.units import parse_unit
from vision.contract import InputError, read_toml
from vision.contract.text import YEARS, read_json

#: Size of a `.npy` file, bytes, from which on it is read in parts.
LARGE = 1 << 20

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class SideFile(BaseModel):
    """Contents of the side file: a `.toml` or `.json` with the name of its `.npy` or `.npz` file."""

    model_config = ConfigDict(extra="forbid")

    start: Annotated[AwareDatetime, Field(ge=YEARS[0], lt=YEARS[1])]
    sampling_rate: Positive
    channel_spacing: Positive | None = None
    gauge_length: Positive | None = None
    unit: str | None = None
    first_channel: int = 0
    axes: tuple[str, str] = ("time", "channel")


def read_side_file(path: Path) -> SideFile:
    """Read the side file of the array file `path`."""
    beside = [path.with_suffix(suffix) for suffix in (".toml", ".json")]
    found = next((side for side in beside if side.is_file()), None)
    if found is None:
        raise InputError(
            f"{path}: an array alone has no times; write {beside[0].name} beside it with start, sampling_rate, "
            "channel_spacing, gauge_length and unit"
        )
    try:
        wanted = "the side file of an array"
        said = (read_toml if found.suffix == ".toml" else read_json)(found, wanted)
        return SideFile.model_validate(said)
    except ValidationError as error:
        problem = error.errors()[0]
        key = ".".join(map(str, problem["loc"]))
        known = ", ".join(SideFile.model_fields)
        raise InputError(f"{found}: {key}: {problem['msg'].lower()}; known keys: {known}") from error


def load_array(path: Path) -> NDArray[Any]:
    """Load the one array of a `.npy` or `.npz` file."""
    try:
        # A large array stays on disk until it is needed.
        large = path.suffix.lower() == ".npy" and path.stat().st_size > LARGE
        content = np.load(path, allow_pickle=False, mmap_mode="r" if large else None)
        if isinstance(content, np.ndarray):
            return content
        with content:
            if len(content.files) != 1:
                names = ", ".join(content.files) or "none"
                raise InputError(f"{path}: arrays {names}; store exactly one, [time, channel]")
            return np.asarray(content[content.files[0]])
    except (OSError, ValueError, EOFError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: not a readable numpy file ({error}); save it again with numpy.save") from error


def read_numpy(path: Path) -> Iterator[Block]:
    """Read a `.npy` or `.npz` file and its side file."""
    side, data = read_side_file(path), load_array(path)
    if data.ndim != 2:
        raise InputError(f"{path}: an array of {data.dtype} {data.shape}; give real numbers [time, channel]")
    if sorted(side.axes) != ["channel", "time"]:
        raise InputError(f"{path}: axes is {list(side.axes)}; give ['time', 'channel'] or the reverse")
    data = data if side.axes[0] == "time" else data.T
    start = np.datetime64(side.start.astimezone(UTC).replace(tzinfo=None), "ns").astype(np.int64)
    time = start + np.round(np.arange(len(data)) * 1e9 / side.sampling_rate).astype(np.int64)
    numbers = side.first_channel + np.arange(data.shape[1])
    unit = parse_unit(side.unit) if side.unit else None
    if side.unit and unit is None:
        raise InputError(f"{path}: unknown unit {side.unit!r} in the side file; give 1/s, nm/m/s, strain, rad or rad/s")
    yield Block(
        path=path,
        format="numpy",
        data=data,
        time=time,
        distance=np.asarray(numbers * side.channel_spacing) if side.channel_spacing else None,
        first_channel=side.first_channel,
        gauge_length=side.gauge_length,
        unit=unit,
        stated=side.unit or "",
    )
