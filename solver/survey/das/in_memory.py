"""A DAS record already in memory: a DASCore patch, an xarray DataArray, or an array with its coordinates."""

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from solver.survey.das.block import Block
from solver.survey.das.das_files import patch_block
from solver.survey.das.units import parse_unit
from vision.contract import InputError

#: The record's name in messages.
NAME = Path("das")
#: Possible names of the axis along the fiber.
ALONG = ("distance", "channel")


def is_a(value: object, module: str, name: str) -> bool:
    """Whether a value is an instance of a class whose package may not be installed.

    >>> is_a(np.zeros(2), "numpy", "ndarray"), is_a(3, "xarray", "DataArray")
    (True, False)
    """
    return module in sys.modules and isinstance(value, getattr(sys.modules[module], name))


def block_of(
    das: Any, time: ArrayLike | None = None, distance: ArrayLike | None = None, first_channel: int | None = None
) -> Block:
    """Turn a record in memory into a block, as from a file.

    Parameters
    ----------
    das : `dascore.Patch` with the dimensions time and distance; `xarray.DataArray` with the dimensions time and
        distance or channel, whose `attrs` may hold gauge_length (m) and units; or an array [time, channel]
    time : of an array: datetime64 in UTC [time]
    distance : of an array, m along the fiber [channel]; if None, the channel spacing must be given elsewhere
    first_channel : number of the first channel; if None, that of the channel coordinate, else 0

    Raises
    ------
    InputError
        If it is none of these, or an axis is missing, of the wrong length, or not a time.

    Examples
    --------
    >>> times = np.datetime64("2025-08-11T06:00:00", "ns") + np.arange(3) * np.timedelta64(200, "ms")
    >>> block_of(np.zeros((3, 2)), times, [0.0, 1.02], first_channel=7).first_channel
    7
    """
    if is_a(das, "dascore", "Patch"):
        if set(das.dims) != {"time", "distance"}:
            raise InputError(f"das: a patch over {', '.join(das.dims)}; give one over time and distance")
        require_moments(das.get_coord("time").dtype)
        block = patch_block(das, NAME, "DASCore patch")
    elif is_a(das, "xarray", "DataArray"):
        block = data_array_block(das)
    else:
        block = array_block(np.asarray(das), time, distance)
    if not block.data.size:
        raise InputError("das: no samples; give a record of time and channel")
    return block if first_channel is None else replace(block, first_channel=first_channel)


def require_moments(dtype: np.dtype[Any]) -> None:
    """Raise InputError where times are durations, or numbers, whose start nothing tells."""
    if not np.issubdtype(dtype, np.datetime64):
        raise InputError(f"das: time is {dtype}; give datetime64 in UTC, start + seconds as timedelta64")


def data_array_block(das: Any) -> Block:
    """An xarray DataArray as a block."""
    along = next((name for name in ALONG if name in das.dims), None)
    if along is None or set(das.dims) != {"time", along} or "time" not in das.coords:
        raise InputError(
            f"das: a DataArray over {', '.join(map(str, das.dims))}; give one over time and distance, with times in UTC"
        )
    das = das.transpose("time", along)
    distance = das.coords["distance"].values if "distance" in das.coords else None
    block = array_block(das.values, das.coords["time"].values, distance)
    said, gauge_length = das.attrs.get("units"), das.attrs.get("gauge_length")
    return replace(
        block,
        format="xarray DataArray",
        first_channel=int(das.coords["channel"].values[0]) if "channel" in das.coords else 0,
        gauge_length=None if gauge_length is None else float(gauge_length),
        unit=parse_unit(said) if said else None,
        stated=str(said or ""),
    )


def array_block(data: NDArray[Any], time: ArrayLike | None, distance: ArrayLike | None) -> Block:
    """An array [time, channel] with its coordinates as a block."""
    if data.ndim != 2 or not np.issubdtype(data.dtype, np.number) or np.iscomplexobj(data):
        raise InputError(f"das: an array of {data.dtype} {data.shape}; give real numbers [time, channel]")
    if time is None:
        raise InputError("das: an array alone has no times; give time=, datetime64 in UTC [time]")
    moments = np.asarray(time)
    require_moments(moments.dtype)
    meters = None if distance is None else np.asarray(distance, float)
    for name, axis, count in (("time", moments, len(data)), ("distance", meters, data.shape[1])):
        if axis is not None and axis.shape != (count,):
            raise InputError(f"das: {name} has shape {axis.shape}, the array {data.shape}; give one number per sample")
    return Block(
        path=NAME,
        format="array",
        data=data,
        time=moments.astype("datetime64[ns]").astype(np.int64),
        distance=meters,
        first_channel=0,
        gauge_length=None,
        unit=None,
        stated="",
    )
