"""PRODML, the exchange format of DAS: files of any writer are read, strain rate is written as version 2.0."""

import uuid
from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime, timedelta
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from solver.survey.das.block import Block
from solver.survey.das.samples import InHDF5
from solver.survey.das.units import in_meters, parse_unit
from vision.contract import InputError, writing
from vision.contract.statements import Said
from vision.contract.text import plain

if TYPE_CHECKING:
    import h5py

STORED = 1e-9  # 1/s; the file holds (nm/m)/s
#: Units of the times of samples, ns: microseconds, as the standard says, and what else is written.
UNITS = {"us": 1_000, "ns": 1, "ms": 1_000_000, "s": 1_000_000_000}
ENDS = ("PartStartTime", "PartEndTime")
DAY = 86400 * 10**9  # ns; clocks of one file are not farther apart, whatever zone they are in
RATE_OFF = 1e-3  # largest relative difference between two rates of one file


def time_text(microseconds: int) -> bytes:
    """Write a time, us since 1970 UTC, as PRODML does.

    >>> time_text(1754892000250000)
    b'2025-08-11T06:00:00.250000+00:00'
    """
    return f"{np.datetime64(microseconds, 'us')}+00:00".encode()


def identity(path: Path, part: str) -> bytes:
    """Return the uuid of a part of a file; the same name always gives the same uuid, so that runs can be compared."""
    return str(uuid.uuid5(uuid.NAMESPACE_URL, f"roadfiber:{path.name}:{part}")).encode()


def write_prodml(
    path: Path,
    strain_rate: ArrayLike,
    *,
    start: np.datetime64,
    sampling_rate: float,
    gauge_length: float,
    channel_spacing: float,
    first_channel: int = 0,
    vendor: str = "roadfiber",
    packed: bool = True,
    more: "Callable[[h5py.File], None] | None" = None,
) -> None:
    """Write one PRODML 2.0 HDF5 file, whole or not at all.

    Parameters
    ----------
    path : of the file; an existing one is replaced
    strain_rate : [time, channel], 1/s; stored as float32 in (nm/m)/s
    start : time of the first row, UTC; stored to the microsecond
    sampling_rate : Hz
    gauge_length, channel_spacing : m
    first_channel : number of the first column (`StartLocusIndex`)
    vendor : maker of the data
    packed : whether numbers are compressed, which takes longer than all other steps
    more : called to write further content into the file

    Examples
    --------
    >>> import tempfile
    >>> from solver.survey.das.reader import read_das
    >>> path = Path(tempfile.mkdtemp()) / "das.h5"
    >>> rate = 1e-9 * np.arange(12.0).reshape(4, 3)
    >>> write_prodml(path, rate, start=np.datetime64("2025-08-11T06:00:00"), sampling_rate=5.0, gauge_length=10.0,
    ...              channel_spacing=1.0, first_channel=7)
    >>> record = read_das([path])
    >>> record.channel.tolist(), record.gauge_length, bool(np.allclose(record.strain_rate, rate))
    ([7, 8, 9], 10.0, True)
    """
    import h5py

    path = Path(path)
    values = np.divide(strain_rate, STORED, dtype=np.float64).astype(np.float32)
    first = int(start.astype("datetime64[us]").astype(np.int64))
    time = first + np.round(np.arange(len(values)) * 1e6 / sampling_rate).astype(np.int64)
    # Built in memory: HDF5 does not recover from a full disk.
    content = BytesIO()
    with h5py.File(content, "w") as file:
        file.attrs["uuid"] = np.bytes_(identity(path, "file"))
        acquisition = file.create_group("Acquisition")
        acquisition.attrs.update(
            schemaVersion=np.bytes_("2.0"),
            uuid=np.bytes_(identity(path, "acquisition")),
            AcquisitionId=np.bytes_(identity(path.parent, "acquisition")),
            VendorCode=np.bytes_(vendor),
            MeasurementStartTime=np.bytes_(time_text(first)),
            GaugeLength=float(gauge_length),
            GaugeLengthUnit=np.bytes_("m"),
            SpatialSamplingInterval=float(channel_spacing),
            SpatialSamplingIntervalUnit=np.bytes_("m"),
            StartLocusIndex=np.int64(first_channel),
            NumberOfLoci=np.int64(values.shape[1]),
            MinimumFrequency=0.0,
            MaximumFrequency=sampling_rate / 2,
            PulseRate=float(sampling_rate),
            PulseWidth=50.0,
            PulseWidthUnit=np.bytes_("ns"),
            TriggeredMeasurement=np.uint8(0),
        )
        raw = acquisition.create_group("Raw[0]")
        raw.attrs.update(
            uuid=np.bytes_(identity(path, "raw")),
            RawIndex=np.uint64(0),
            RawDescription=np.bytes_("Strain rate"),
            RawDataUnit=np.bytes_("(nm/m)/s"),
            OutputDataRate=float(sampling_rate),
            StartLocusIndex=np.int64(first_channel),
            NumberOfLoci=np.int64(values.shape[1]),
        )
        write_arrays(raw, values, time, packed)
        if more is not None:
            more(file)
    with writing(path) as temporary:
        temporary.write_bytes(content.getbuffer())


def write_arrays(raw: "h5py.Group", values: NDArray[np.float32], time: NDArray[np.int64], packed: bool) -> None:
    """Write values [time, channel] and their times, us since 1970 UTC [time], with the times of their ends."""
    ends = {
        "PartStartTime": np.bytes_(time_text(int(time[0]))),
        "PartEndTime": np.bytes_(time_text(int(time[-1]))),
        "StartIndex": np.int64(0),
    }
    how = {"compression": "gzip", "shuffle": True} if packed else {"chunks": (len(values), min(values.shape[1], 64))}
    data = raw.create_dataset("RawData", data=values, **how)
    data.attrs.update(ends, Count=np.int64(values.size), Dimensions=np.array([b"time", b"locus"]))
    times = raw.create_dataset("RawDataTime", data=time)
    times.attrs.update(ends, Count=np.int64(time.size), StartTime=ends["PartStartTime"], EndTime=ends["PartEndTime"])


def is_prodml(path: Path) -> bool:
    """Whether a file is HDF5 with the group that PRODML keeps all in."""
    import h5py

    try:
        with h5py.File(path) as file:
            return "Acquisition" in file
    except OSError:
        return False


def read_prodml(path: Path) -> Iterator[Block]:
    """Read a PRODML file of any version: one block per array of raw samples.

    The array's own numbers are taken where they differ from those of the acquisition, the times of its samples where
    they differ from texts; everything that is stated about it is noted (`Block.said`). Numbers stay on disk.

    Raises
    ------
    InputError
        If axes, times or numbers cannot be used.
    """
    import h5py

    with h5py.File(path) as file:
        acquisition = file["Acquisition"]
        for name, raw in acquisition.items():
            if name.lower().startswith("raw") and isinstance(raw, h5py.Group) and "RawData" in raw:
                yield read_raw(path, acquisition, raw)


def read_raw(path: Path, acquisition: "h5py.Group", raw: "h5py.Group") -> Block:
    """One array of raw samples."""
    data, both = raw["RawData"], (("Raw", raw.attrs), ("Acquisition", acquisition.attrs))
    if data.size and not data.is_virtual and data.id.get_storage_size() == 0:
        raise InputError(f"{path}: its {data.nbytes / 1e9:.2g} GB of numbers were never written; leave this file out")
    if data.ndim != 2:
        raise InputError(
            f"{path}: RawData is {data.dtype} {data.shape}; give a file with real numbers of time and locus"
        )

    def numbers(*names: str) -> list[tuple[str, float]]:
        """What the raw array and the acquisition state under the first of `names` that they have."""
        held = [(where, name, attrs[name]) for where, attrs in both for name in names if name in attrs]
        return [(f"{where} {name}", number(path, name, value)) for where, name, value in held]

    def length(name: str) -> tuple[float | None, Said]:
        unit = text(next((acquisition.attrs[key] for key in lengths_of(name) if key in acquisition.attrs), ""))
        found = numbers(name)
        meters = [(where, in_meters(value, unit)) for where, value in found]
        return (meters[0][1] if meters and np.isfinite(meters[0][1]) else None), meters

    (firsts, loci), (gauge, gauges) = (numbers("StartLocusIndex"), numbers("NumberOfLoci")), length("GaugeLength")
    spacing, spacings = length("SpatialSamplingInterval")
    time, said = times_of(path, raw, numbers("OutputDataRate"))
    turned = axes_of(data)[0] != "time"
    rows, columns = data.shape[::-1] if turned else data.shape
    if rows < len(time) and columns >= len(time):
        raise InputError(
            f"{path}: its data are [{rows}, {columns}], but time and channel [{len(time)}, {rows}]: the axes are "
            "exchanged; transpose them in the file"
        )
    kept = min(rows, len(time))
    first, unit = int(firsts[0][1]) if firsts else 0, text(raw.attrs.get("RawDataUnit", ""))
    said |= {"samples": [("RawData", rows), ("RawDataTime", len(time))], "channels": [*loci, ("RawData", columns)]}
    said |= {"first channel": firsts, "channel spacing": spacings, "gauge length": gauges}
    words = {"maker": ("VendorCode", "ServiceCompanyName"), "filters": ("MinimumFrequency", "MaximumFrequency")}
    for what, names in words.items():
        said[what] = [(name, text(acquisition.attrs[name])) for name in names if name in acquisition.attrs]
    return Block(
        path=path,
        format=f"PRODML {text(acquisition.attrs.get('schemaVersion', '')) or '2'}",
        data=InHDF5(path, data.name, (kept, columns), turned, data.dtype),
        time=time[:kept],
        distance=None if spacing is None else (first + np.arange(columns)) * spacing,
        first_channel=first,
        gauge_length=gauge if gauge and gauge > 0 else None,
        unit=parse_unit(unit) if unit else None,
        stated=unit,
        said=said,
    )


def lengths_of(name: str) -> tuple[str, ...]:
    """Attributes that may hold the unit of a length, in the versions of the standard."""
    return f"{name}Unit", f"{name}Units", f"{name}.uom"


def text(value: Any) -> str:
    """An attribute as text.

    >>> text(b"m"), text(np.array(["a"])), text(2.0)
    ('m', 'a', '2.0')
    """
    value = value.ravel()[0] if isinstance(value, np.ndarray) and value.size else value
    return plain(value.decode(errors="replace") if isinstance(value, bytes) else str(value)).strip()


def number(path: Path, name: str, value: Any) -> float:
    """An attribute as a number; InputError if it is none."""
    try:
        return float(text(value))
    except ValueError as error:
        raise InputError(f"{path}: {name} is {text(value)!r}, no number; export the recording again") from error


def axes_of(data: "h5py.Dataset") -> list[str]:
    """Names of the axes, as the array states them: time and locus unless it does."""
    stated = np.ravel(data.attrs.get("Dimensions", [b"time", b"locus"]))
    names = [word for one in stated for word in text(one).replace(",", " ").lower().split()]
    return names if len(names) == 2 and "time" in names else ["time", "locus"]


def moment(stated: str) -> tuple[np.datetime64, str] | None:
    """A time as text in UTC, and its zone; None if it is no time.

    >>> moment("2025-08-11T09:00:00+03:00")
    (np.datetime64('2025-08-11T06:00:00.000000000'), 'UTC+03:00')
    """
    try:
        found = datetime.fromisoformat(stated)
        offset = found.utcoffset()
        naive = (found.replace(tzinfo=UTC) if offset is None else found).astimezone(UTC).replace(tzinfo=None)
    except (ValueError, OverflowError):
        return None
    sign, minutes = ("-", -offset) if offset and offset < timedelta(0) else ("+", offset or timedelta(0))
    zone = "none" if offset is None else f"UTC{sign}{str(minutes).zfill(8)[:5]}" if offset else "UTC"
    return np.datetime64(naive, "ns"), zone


def times_of(path: Path, raw: "h5py.Group", rates: Said) -> tuple[NDArray[np.int64], dict[str, Said]]:
    """Times of the samples, ns since 1970, UTC [time], and what is stated about them.

    Texts carry a zone, which is applied. The times of the samples are in microseconds by the standard; other units are
    told by the texts, or by the rate. They win over texts; over the rate, too, unless the texts confirm that one.
    """
    import h5py

    node = next((raw[name] for name in raw if name.endswith("DataTime")), None)
    found = {name: ended(name, [raw["RawData"], *([] if node is None else [node])]) for name in ENDS}
    texts = {name: int(one[0].astype(np.int64)) for name, one in found.items() if one is not None}
    begin, end = (texts.get(name) for name in ENDS)
    stamps = stamps_of(node[:]) if isinstance(node, h5py.Dataset) and node.ndim == 1 else np.empty(0)
    count = len(stamps) or int(raw["RawData"].shape[axes_of(raw["RawData"]).index("time")])
    header = float(rates[0][1]) if rates else 0.0
    unit = unit_of(stamps, begin, header or rate_of(count, begin, end))
    time = (stamps * UNITS[unit]).astype(np.int64) if unit else np.empty(0, np.int64)
    steps = np.diff(time)
    step = float(np.median(steps)) if len(steps) else 0.0
    by_stamps = 1e9 / step if step > 0 else 0.0
    missing = round(float((steps[steps > 1.5 * step] / step - 1).sum())) if step > 0 else 0
    # Texts that pass over the gaps between the samples count the missing ones, too.
    passing = missing > 0 and end is not None and abs(end - int(time[-1])) <= 1.5 * step
    by_count = rate_of(count + passing * missing, begin, end)
    confirmed = header > 0 and abs(by_count / header - 1) < RATE_OFF
    usual = by_count if confirmed or not header else header
    clock = bool(unit) and (begin is None or abs(int(time[0]) - begin) < DAY or time[0] > DAY)
    if not clock and begin is None:
        raise InputError(f"{path}: neither RawDataTime nor PartStartTime says when it was recorded; export it again")
    origin = int(time[0]) if clock else begin
    if not unit or (step > 0 and confirmed and abs(by_stamps / header - 1) > RATE_OFF):
        if count > 1 and not usual:
            raise InputError(f"{path}: nothing says at what rate it was recorded; export it again with its times")
        time = np.round(np.arange(count) * (1e9 / (usual or 1.0))).astype(np.int64)
    time = time - time[0] + origin
    others = [("PartStartTime to PartEndTime", by_count), ("RawDataTime", by_stamps)]
    told: dict[str, Said] = {"rate": [*rates, *((place, value) for place, value in others if value)]}
    for what, name, row in zip(("start", "end"), ENDS, (0, -1), strict=True):
        stated = [(name, texts.get(name)), ("RawDataTime", int(stamps[row] * UNITS[unit]) if unit and clock else None)]
        told[what] = [(place, np.datetime64(value, "ns")) for place, value in stated if value is not None]
    told["zone"] = [(name, one[1]) for name, one in found.items() if one is not None]
    return time, told | {"times of samples": [("RawDataTime", f"in {unit}")] if unit else []}


def ended(name: str, nodes: "Sequence[h5py.Dataset]") -> tuple[np.datetime64, str] | None:
    """The first or last time of an array, by the text attribute `name` of one of its nodes, and its zone."""
    return next((moment(text(one.attrs[name])) for one in nodes if name in one.attrs), None)


def rate_of(count: int, begin: int | None, end: int | None) -> float:
    """The rate, Hz, of `count` samples from `begin` to `end`, ns; 0 where it is not known."""
    return 0.0 if begin is None or end is None or end <= begin else 1e9 * (count - 1) / (end - begin)


def stamps_of(stored: NDArray[Any]) -> NDArray[Any]:
    """Stored times without a tail of zeros, which was allocated and never written; none if they do not pass.

    >>> stamps_of(np.array([7, 8, 9, 0, 0])).tolist(), stamps_of(np.zeros(5)).tolist()
    ([7, 8, 9], [])
    """
    if stored.dtype.kind not in "iuf" or not np.isfinite(stored).all() or not len(stored) or not stored.any():
        return np.empty(0)
    kept = stored[: int(np.flatnonzero(stored)[-1]) + 1]
    return kept if len(kept) == 1 or kept.min() < kept.max() else np.empty(0)


def unit_of(stamps: NDArray[Any], begin: int | None, rate: float) -> str | None:
    """The unit of `UNITS` that times of samples are in, given when they should begin, ns, and at what rate, Hz."""
    if not len(stamps):
        return None
    for unit, ns in UNITS.items():
        if begin is not None and abs(float(stamps[0]) * ns - float(begin)) < DAY:
            return unit
    step = float(np.median(np.diff(stamps))) if len(stamps) > 1 else 0.0
    for unit, ns in UNITS.items():
        if rate and step > 0 and abs(1e9 / (step * ns) / rate - 1) < RATE_OFF and abs(float(stamps[0])) * ns < 2**62:
            return unit
    return "us" if abs(float(stamps[0])) * 1000 < 2**62 else None
