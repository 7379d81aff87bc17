"""One DAS file as it is: numbers, times, distances and what the file says about itself."""

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from solver.survey.das.array_files import read_numpy
from solver.survey.das.block import Block, linked_files
from solver.survey.das.prodml import is_prodml, moment, read_prodml, text
from solver.survey.das.samples import OnDisk, described, series
from solver.survey.das.size import require_room_for_file
from solver.survey.das.tdms import read_tdms_properties
from solver.survey.das.units import Unit, dascore, in_meters, parse_unit
from solver.survey.das.unreadable import why_unknown, why_unreadable
from vision.contract import InputError
from vision.contract.statements import Said, Statement, Value
from vision.contract.text import plain


def from_silixa(block: Block, properties: Mapping[str, Any]) -> Block:
    """Fill in the properties of a Silixa file that DASCore leaves out; its integers are raw counts.

    Distances begin at `Start Distance (m)`, as in PRODML files of the same instrument; DASCore takes a position of its
    digitizer for it.
    """
    gauge_length = block.gauge_length or properties.get("GaugeLength")
    calibration = float(properties.get("Unit Calibration (nm)", 116.0))
    counts = np.issubdtype(block.data.dtype, np.integer) and block.unit is None
    unit = Unit("idas_counts", calibration) if counts else block.unit
    distance, start = block.distance, properties.get("Start Distance (m)")
    if distance is not None and start is not None:
        distance = distance - distance[0] + float(start)
    written = moment(str(properties.get("ISO8601 Timestamp", "")))
    said: dict[str, Said] = {
        "start": [] if written is None else [("ISO8601 Timestamp", written[0])],
        "zone": [] if written is None else [("ISO8601 Timestamp", written[1])],
        "rate": numbers(properties, "SamplingFrequency[Hz]"),
        "first distance": numbers(properties, "Start Distance (m)"),
        "gauge length": numbers(properties, "GaugeLength"),
        "scale": [(name, f"{value:g}") for name, value in numbers(properties, "Unit Calibration (nm)")],
        "maker": [(name, text(properties[name])) for name in ("iDASVersion",) if name in properties],
    }
    found = replace(block, gauge_length=gauge_length and float(gauge_length), unit=unit, distance=distance)
    return replace(found, said=with_more(block.said, said))


def numbers(properties: Mapping[str, Any], *names: str) -> list[tuple[str, Value]]:
    """Those of the properties `names` that are there and are numbers, with their names."""
    held = [(name, text(properties[name])) for name in names if name in properties]
    return [(name, float(value)) for name, value in held if re.fullmatch(r"[-+]?[\d.]+([eE][-+]?\d+)?", value)]


def with_more(said: Mapping[str, Said], more: Mapping[str, Said]) -> dict[str, Said]:
    """Statements with more of them, by what they are about."""
    return {what: [*said.get(what, ()), *more.get(what, ())] for what in {**said, **more}}


def from_tdms(block: Block) -> Block:
    """Complete a block read from Silixa TDMS."""
    return from_silixa(block, read_tdms_properties(block.path))


def from_silixa_h5(block: Block) -> Block:
    """Complete a block read from Silixa HDF5."""
    import h5py

    with h5py.File(block.path) as file:
        return from_silixa(block, dict(file["Acoustic"].attrs))


def from_optodas(block: Block) -> Block:
    """Number the channels of an OptoDAS file as it does: of every n-th channel, k is the file's channel n k."""
    import h5py

    with h5py.File(block.path) as file:
        header = {name: node[()] for name, node in file["header"].items() if isinstance(node, h5py.Dataset)}
    own = np.ravel(header["channels"]).astype(np.int64)
    steps = np.unique(np.diff(own)) if len(own) > 1 else np.ones(1, np.int64)
    every = int(steps[0])
    if len(steps) > 1 or every < 1:
        raise InputError(f"{block.path}: its channels, {own[0]} to {own[-1]}, are not evenly apart; export one stretch")
    lost = np.size(header.get("missingSamples", ()))
    odd = [] if not lost else [told("missing samples", f"{lost}", f"the recorder lists {lost} of them")]
    if every > 1:
        number = f"every {every}th channel is there: number k in anchors and results is its channel {every} k"
        odd.append(told("channel numbers", f"1 of {every}", number))
    said: dict[str, Said] = {
        "start": [(name, np.datetime64(round(float(value) * 1e9), "ns")) for name, value in numbers(header, "time")],
        "rate": [(name, 1 / float(value)) for name, value in numbers(header, "dt") if float(value) > 0],
        "first channel": [("channels", round(own[0] / every))],
        "channels": [("dimensionSizes", int(header["dimensionSizes"][-1]))] if "dimensionSizes" in header else [],
        "channel spacing": [(name, float(value) * every) for name, value in numbers(header, "dx")],
        "gauge length": numbers(header, "gaugeLength"),
        "maker": [(name, text(header[name])) for name in ("instrument",) if name in header],
    }
    found = replace(block, first_channel=round(own[0] / every), odd=(*block.odd, *odd))
    return replace(found, said=with_more(block.said, said))


def told(what: str, taken: str, caution: str) -> Statement:
    """Something that must be known of a file."""
    return Statement(what, (), taken, caution)


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
        server = {name: node[()] for name, node in file["ProcessingServer"].items()}
    said = {"rate": numbers(server, "DataRate"), "gauge length": numbers(server, "GaugeLength")}
    said |= {"channel spacing": numbers(server, "SpatialSampling"), "filters": numbers(server, "CutOffFrequency")}
    return replace(block, stated=text(server["DataType"]), said=with_more(block.said, said))


COMPLETIONS: dict[str, Callable[[Block], Block]] = {
    "TDMS": from_tdms,
    "Silixa_H5": from_silixa_h5,
    "OptoDAS": from_optodas,
    "febus": from_febus,
    "APSensing": from_ap_sensing,
}


def patch_block(patch: Any, path: Path, name: str, whole: OnDisk | None = None) -> Block:
    """Turn a DASCore patch into a block; `whole`: all numbers of a file, if the patch is only its first row."""
    patch = patch.transpose("time", "distance")
    attrs, distance = patch.attrs, patch.get_coord("distance")
    stated_gauge = np.array([getattr(attrs, "gauge_length", None) or np.nan], float)
    gauge_length = float(in_meters(stated_gauge, getattr(attrs, "gauge_length_units", None) or None)[0])
    stated = attrs.data_units
    return Block(
        path=path,
        format=name,
        data=np.asarray(patch.data) if whole is None else whole,
        time=patch.get_array("time").astype("datetime64[ns]").astype(np.int64)
        if whole is None
        else np.asarray(whole.time, np.int64),
        distance=in_meters(np.asarray(distance.data, float), distance.units),
        first_channel=0,
        gauge_length=gauge_length if gauge_length > 0 else None,
        unit=None if stated is None else parse_unit(stated),
        stated="" if stated is None else f"{stated.units:D}",
        said={"maker": [("format", name)]},
    )


def missing_sources(path: Path) -> list[Statement]:
    """Files whose numbers an HDF5 file shows that are not where they should be."""
    needed = linked_files(path)
    gone = [one for one in needed if not one.is_file()]
    if not gone:
        return []
    named = gone[0].name + (f" and {len(gone) - 1} more" if len(gone) > 1 else "")
    line = f"the file shows numbers of other files, of which this is missing in {gone[0].parent}: {named}; put it there"
    return [told("source files", f"{len(needed) - len(gone)} of {len(needed)}", line)]


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
        if is_prodml(path):
            yield from read_prodml(path)
            return
        name, version = dc.get_format(path)
        known = described(path, name, version)
        if known is None:
            require_room_for_file(path)
        patches = [(one, None) for one in series(path, name, version)] if known is None else [known]
        for patch, whole in patches:
            block = patch_block(patch, path, f"{name} {version}", whole)
            yield COMPLETIONS.get(name, lambda same: same)(block)
    except InputError:
        raise
    except UnknownFiberFormatError as error:
        raise InputError(f"{path}: {why_unknown(path)}") from error
    except Exception as error:  # on damaged bytes a parser can raise anything
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
    gone = missing_sources(path)
    blocks = [replace(block, odd=(*gone, *block.odd)) for block in reader(path) if block.data.size]
    if not blocks:
        raise InputError(f"{path}: no samples; give a file with a recording of time and distance")
    if other := [block.data.dtype for block in blocks if block.data.dtype.kind not in "iuf"]:
        raise InputError(f"{path}: an array of {other[0]}; give real numbers [time, channel]")
    return blocks
