"""One DAS file as it is: numbers, times, distances and what the file says about itself."""

import hashlib
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from datetime import UTC
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import AwareDatetime, BaseModel, ConfigDict, Field, ValidationError

from solver.survey.das.tdms import read_tdms_properties
from solver.survey.das.units import Unit, dascore, parse_unit
from solver.survey.das.unreadable import why_unknown, why_unreadable
from vision.contract import InputError, read_text, read_toml

ROUNDED = 1_000_000  # ns; so far may two clocks of one file be apart

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


@dataclass(frozen=True)
class Block:
    """What one file holds.

    Parameters
    ----------
    path : of the file
    format : its name and version
    data : [time, channel], as stored
    time : ns since 1970, UTC [time]
    distance : m along the fiber [channel], or None where the file gives no spacing
    first_channel : number of the first channel
    gauge_length : m, or None where the file does not say
    unit : of `data`, or None where the file does not say
    stated : the unit as the file words it
    """

    path: Path
    format: str
    data: NDArray[Any]
    time: NDArray[np.int64]
    distance: NDArray[np.float64] | None
    first_channel: int
    gauge_length: float | None
    unit: Unit | None
    stated: str


class SideFile(BaseModel):
    """What stands beside a `.npy` or `.npz` file, in a `.toml` or `.json` of the same name."""

    model_config = ConfigDict(extra="forbid")

    start: AwareDatetime
    sampling_rate: Positive
    channel_spacing: Positive | None = None
    gauge_length: Positive | None = None
    unit: str | None = None
    first_channel: int = 0
    axes: tuple[str, str] = ("time", "channel")


def checksum(path: Path) -> str:
    """Return the SHA-256 of a file."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def checksum_of(block: Block) -> str:
    """Return the SHA-256 of a block's file, or of its numbers where they were in memory."""
    if block.path.is_file():
        return checksum(block.path)
    return hashlib.sha256(np.ascontiguousarray(block.data).data).hexdigest()


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
        said = read_toml(found, wanted) if found.suffix == ".toml" else json.loads(read_text(found, wanted))
        return SideFile.model_validate(said)
    except json.JSONDecodeError as error:
        raise InputError(f"{found}: cannot be read ({error}); mend that line") from error
    except ValidationError as error:
        problem = error.errors()[0]
        key = ".".join(map(str, problem["loc"]))
        known = ", ".join(SideFile.model_fields)
        raise InputError(f"{found}: {key}: {problem['msg'].lower()}; known keys: {known}") from error


def load_array(path: Path) -> NDArray[Any]:
    """Load the one array of a `.npy` or `.npz` file."""
    try:
        content = np.load(path, allow_pickle=False)
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
        raise InputError(f"{path}: no readable numpy file ({error}); save it again with numpy.save") from error


def read_numpy(path: Path) -> Iterator[Block]:
    """Read a `.npy` or `.npz` file and its side file."""
    side, data = read_side_file(path), load_array(path)
    if data.ndim != 2 or not np.issubdtype(data.dtype, np.number) or np.iscomplexobj(data):
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


def silixa_counts(block: Block, properties: dict[str, Any]) -> Block:
    """Fill in what a Silixa file says in properties that DASCore leaves out; its integers are raw counts."""
    gauge_length = block.gauge_length or properties.get("GaugeLength")
    calibration = float(properties.get("Unit Calibration (nm)", 116.0))
    counts = np.issubdtype(block.data.dtype, np.integer) and block.unit is None
    unit = Unit("idas_counts", calibration) if counts else block.unit
    return replace(block, gauge_length=gauge_length and float(gauge_length), unit=unit)


def from_tdms(block: Block) -> Block:
    """Complete a block read from Silixa TDMS."""
    return silixa_counts(block, read_tdms_properties(block.path))


def from_silixa_h5(block: Block) -> Block:
    """Complete a block read from Silixa HDF5."""
    import h5py

    with h5py.File(block.path) as file:
        return silixa_counts(block, dict(file["Acoustic"].attrs))


def from_prodml(block: Block) -> Block:
    """Number the channels of a PRODML file as it does, from its StartLocusIndex, and take the time of every sample.

    DASCore takes the times of the first and the last sample; that they jump or run backwards between shows only here.
    """
    import h5py

    with h5py.File(block.path) as file:
        acquisition = file["Acquisition"]
        block = replace(block, first_channel=int(acquisition.attrs["StartLocusIndex"]))
        for name in acquisition:
            times = acquisition.get(f"{name}/RawDataTime")
            # Microseconds since 1970, as the standard has it; not all makers keep to it.
            if times is not None and len(times) == len(block.time) and np.issubdtype(times.dtype, np.integer):
                time = times[:].astype(np.int64) * 1000
                ends = np.array([time.min(), time.max()])
                if (np.abs(ends - block.time[[0, -1]]) <= ROUNDED).any():
                    return replace(block, time=time)
    return block


def from_febus(block: Block) -> Block:
    """Refuse spectra, and trust no unit but that of a product called strain rate: DASCore reads all as such."""
    import h5py

    names = list[str]()
    with h5py.File(block.path) as file:
        file.visititems(lambda name, node: names.append(name) if isinstance(node, h5py.Dataset) else None)
    product = next(name.rpartition("/")[2] for name in names if not name.endswith("/time"))
    if product.startswith("PSD") or "dB" in product:
        raise InputError(f"{block.path}: holds {product!r}, a spectrum and no time series; export StrainRate instead")
    return block if "rate" in product.lower() else replace(block, unit=None, stated=product)


def from_ap_sensing(block: Block) -> Block:
    """Take the data type along as what the file states: phase in counts whose scale it does not tell."""
    import h5py

    with h5py.File(block.path) as file:
        return replace(block, stated=file["ProcessingServer/DataType"][0].decode())


COMPLETIONS: dict[str, Callable[[Block], Block]] = {
    "TDMS": from_tdms,
    "Silixa_H5": from_silixa_h5,
    "PRODML": from_prodml,
    "febus": from_febus,
    "APSensing": from_ap_sensing,
}


def meters(values: NDArray[np.float64], units: Any) -> NDArray[np.float64]:
    """Convert `values` in `units` (m where not stated) to meters."""
    return values if units is None else values * float(dascore().get_quantity(units).to("m").magnitude)


def patch_block(patch: Any, path: Path, name: str) -> Block:
    """Turn a DASCore patch into a block."""
    patch = patch.transpose("time", "distance")
    attrs, distance = patch.attrs, patch.get_coord("distance")
    stated_gauge = np.array([getattr(attrs, "gauge_length", None) or np.nan], float)
    gauge_length = float(meters(stated_gauge, getattr(attrs, "gauge_length_units", None) or None)[0])
    stated = attrs.data_units
    return Block(
        path=path,
        format=name,
        data=np.asarray(patch.data),
        time=patch.get_array("time").astype("datetime64[ns]").astype(np.int64),
        distance=meters(np.asarray(distance.data, float), distance.units),
        first_channel=0,
        gauge_length=gauge_length if gauge_length > 0 else None,
        unit=None if stated is None else parse_unit(stated),
        stated="" if stated is None else f"{stated.units:D}",
    )


def is_lone_sample(path: Path) -> bool:
    """Whether a file is PRODML with one sample in time, which DASCore cannot read."""
    import h5py

    if not h5py.is_hdf5(path):
        return False
    with h5py.File(path) as file:
        time = file.get("Acquisition/Raw[0]/RawDataTime")
        return isinstance(time, h5py.Dataset) and time.size == 1


def read_with_dascore(path: Path) -> Iterator[Block]:
    """Read a file of an interrogator through DASCore (PRODML, Silixa, Terra15, OptoDAS, Febus, AP Sensing ...)."""
    dc = dascore()
    from dascore.exceptions import UnknownFiberFormatError

    with path.open("rb") as stream:
        # DASCore loads what looks like a pickle of it, be it only to learn its format.
        if b"dascore.core" in stream.read(100):
            raise InputError(f"{path}: a pickle can run code when it is read; store it as PRODML or DASDAE instead")
    try:
        name, version = dc.get_format(path)
        patches = list(dc.read(path, file_format=name, file_version=version))
        for patch in patches:
            # PRODML carries energies in frequency bands beside the samples; those have a start_frequency.
            if {"time", "distance"} <= set(patch.dims) and "start_frequency" not in dict(patch.attrs):
                block = patch_block(patch, path, f"{name} {version}")
                yield COMPLETIONS.get(name, lambda same: same)(block)
    except InputError:
        raise
    except UnknownFiberFormatError as error:
        raise InputError(f"{path}: {why_unknown(path)}") from error
    except Exception as error:  # a parser fed with damaged bytes fails in ways nobody lists
        if is_lone_sample(path):
            raise InputError(f"{path}: holds a single sample, whose rate nothing tells; leave this file out") from error
        raise InputError(f"{path}: {why_unreadable(error)}") from error


def read_blocks(path: Path) -> list[Block]:
    """Read one DAS file.

    Returns
    -------
    blocks : one per recording in the file

    Raises
    ------
    InputError
        If the file is missing, of no known format, damaged, empty, or holds no time series.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file; give the path of a DAS file")
    reader = read_numpy if path.suffix.lower() in (".npy", ".npz") else read_with_dascore
    blocks = [block for block in reader(path) if block.data.size]
    if not blocks:
        raise InputError(f"{path}: no samples; give a file with a recording of time and distance")
    return blocks
