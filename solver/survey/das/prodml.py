"""Write strain rate as a PRODML 2.0 file, the exchange format of DAS."""

import uuid
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.contract import writing

if TYPE_CHECKING:
    import h5py

STORED = 1e-9  # 1/s; the file holds (nm/m)/s


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
