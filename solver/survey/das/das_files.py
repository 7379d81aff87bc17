"""One DAS file as it is: numbers, times, distances and what the file says about itself."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solver.survey.das.array_files import read_numpy
from solver.survey.das.block import Block
from solver.survey.das.samples import OnDisk, described, series
from solver.survey.das.tdms import read_tdms_properties
from solver.survey.das.units import Unit, dascore, parse_unit
from solver.survey.das.unreadable import why_unknown, why_unreadable
from vision.contract import InputError
from vision.contract.text import plain

ROUNDED = 1_000_000  # ns; largest difference between two clocks of one file


def silixa_counts(block: Block, properties: dict[str, Any]) -> Block:
    """Fill in the properties of a Silixa file that DASCore leaves out; its integers are raw counts."""
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

    DASCore uses the times of the first and last sample only; jumps or reversals between them show only here.
    """
    import h5py

    with h5py.File(block.path) as file:
        acquisition = file["Acquisition"]
        block = replace(block, first_channel=int(acquisition.attrs["StartLocusIndex"]))
        for name in acquisition:
            times = acquisition.get(f"{name}/RawDataTime")
            # Microseconds since 1970, as the standard says; not all makers follow it.
            if times is not None and len(times) == len(block.time) and np.issubdtype(times.dtype, np.integer):
                time = times[:].astype(np.int64) * 1000
                ends = np.array([time.min(), time.max()])
                if (np.abs(ends - block.time[[0, -1]]) <= ROUNDED).any():
                    return replace(block, time=time)
    return block


def from_febus(block: Block) -> Block:
    """Refuse spectra, and trust the unit only of a product called strain rate: DASCore reads every product as that."""
    import h5py

    names = list[str]()
    with h5py.File(block.path) as file:
        file.visititems(lambda name, node: names.append(name) if isinstance(node, h5py.Dataset) else None)
    product = next(name.rpartition("/")[2] for name in names if not name.endswith("/time"))
    if product.startswith("PSD") or "dB" in product:
        raise InputError(f"{block.path}: holds {product!r}, a spectrum, not a time series; export StrainRate instead")
    return block if "rate" in product.lower() else replace(block, unit=None, stated=plain(product))


def from_ap_sensing(block: Block) -> Block:
    """Keep the data type as the stated unit: phase in counts whose scale the file does not give."""
    import h5py

    with h5py.File(block.path) as file:
        return replace(block, stated=plain(file["ProcessingServer/DataType"][0].decode()))


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


def patch_block(patch: Any, path: Path, name: str, whole: OnDisk | None = None) -> Block:
    """Turn a DASCore patch into a block; `whole`: all numbers of a file, if the patch is only its first row."""
    patch = patch.transpose("time", "distance")
    attrs, distance = patch.attrs, patch.get_coord("distance")
    stated_gauge = np.array([getattr(attrs, "gauge_length", None) or np.nan], float)
    gauge_length = float(meters(stated_gauge, getattr(attrs, "gauge_length_units", None) or None)[0])
    stated = attrs.data_units
    return Block(
        path=path,
        format=name,
        data=np.asarray(patch.data) if whole is None else whole,
        time=patch.get_array("time").astype("datetime64[ns]").astype(np.int64)
        if whole is None
        else np.asarray(whole.time, np.int64),
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
    """Read an interrogator's file through DASCore (PRODML, Silixa, Terra15, OptoDAS, Febus, AP Sensing ...).

    Numbers stay on disk if the header tells DASCore when and where they were recorded.
    """
    dc = dascore()
    from dascore.exceptions import UnknownFiberFormatError

    with path.open("rb") as stream:
        # DASCore unpickles any file that looks like one of its pickles, even if only asked for the format.
        if b"dascore.core" in stream.read(100):
            raise InputError(f"{path}: a pickle can run code when it is read; store it as PRODML or DASDAE instead")
    try:
        name, version = dc.get_format(path)
        known = described(path, name, version)
        patches = [(one, None) for one in series(path, name, version)] if known is None else [known]
        for patch, whole in patches:
            block = patch_block(patch, path, f"{name} {version}", whole)
            yield COMPLETIONS.get(name, lambda same: same)(block)
    except InputError:
        raise
    except UnknownFiberFormatError as error:
        raise InputError(f"{path}: {why_unknown(path)}") from error
    except Exception as error:  # on damaged bytes a parser can raise anything
        if is_lone_sample(path):
            raise InputError(f"{path}: holds a single sample, whose rate nothing tells; leave this file out") from error
        raise InputError(f"{path}: {why_unreadable(error)}") from error


def read_blocks(path: Path) -> list[Block]:
    """Read one DAS file; its numbers only when needed, if the format allows.

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
    if other := [block.data.dtype for block in blocks if block.data.dtype.kind not in "iuf"]:
        raise InputError(f"{path}: an array of {other[0]}; give real numbers [time, channel]")
    return blocks
