"""Quantities and units of DAS files, and their conversion to strain rate."""

import atexit
import logging
import os
import re
import shutil
import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray
from platformdirs import user_cache_path

from vision.contract import InputError, require_writable

Quantity = Literal["strain_rate", "strain", "phase", "phase_rate", "velocity", "idas_counts"]
QUANTITIES: tuple[str, ...] = get_args(Quantity)

WAVELENGTH = 1550e-9  # m, of the laser in vacuum
REFRACTIVE_INDEX = 1.468  # group index of G.652 fiber at 1550 nm
STRAIN_OPTIC = 0.78  # zeta: the refractive index of silica falls as it is stretched


#: Characters of a unit at most; pint takes forever for a hundred thousand.
LONGEST = 100
#: Whole numbers in a unit, other than in exponents of ten.
WHOLE = re.compile(r"(?<![\w.])(?<!e[-+])(0[xob]\w+|\d[\d_]*)(?![\w.])", re.IGNORECASE)


@cache
def dascore() -> Any:
    """Import DASCore, silencing pint's warnings that DASCore's unit file redefines two units."""
    logging.getLogger("pint").setLevel(logging.ERROR)
    require_cache()
    import dascore as dc

    dc.units.get_registry().preprocessors.append(bounded)
    return dc


def bounded(text: str) -> str:
    """A unit that pint reads in no time: its numbers are no whole ones, whose powers of powers know no end.

    >>> bounded("9^9^9 1e-9/s")
    '9.0**9.0**9.0*1e-9/s'
    """
    from pint import UndefinedUnitError
    from pint.util import string_preprocessor

    if len(text) > LONGEST:
        raise UndefinedUnitError(text[:LONGEST])
    return WHOLE.sub(lambda found: str(float(int(found[0], 0))), string_preprocessor(text))


def require_cache() -> None:
    """Give pint a temporary cache folder until this process ends, if the user has none."""
    folder = user_cache_path("pint", appauthor=False)
    try:
        if folder.is_absolute():
            require_writable(folder / "units")
            return
    except InputError:
        pass
    os.environ["XDG_CACHE_HOME"] = tempfile.mkdtemp(prefix="roadfiber-")
    atexit.register(shutil.rmtree, os.environ["XDG_CACHE_HOME"], ignore_errors=True)


@dataclass(frozen=True)
class Unit:
    """A quantity of `QUANTITIES`, and the factor from stored numbers to its SI unit (1/s, 1, rad, rad/s, m/s).

    `per_length` marks phase that the file already divided by the gauge length (rad/m). The factor of `idas_counts`
    is the interrogator's `Unit Calibration`, nm.
    """

    quantity: str
    factor: float = 1.0
    per_length: bool = False


def strain_per_radian(gauge_length: float) -> float:
    """Return the strain of one radian of optical phase over `gauge_length`, m.

    strain = wavelength / (4 pi n zeta G) * phase (Lindsey, Rademacher and Ajo-Franklin 2020, J. Geophys. Res.
    125, e2019JB018145, eq. 3).

    >>> round(strain_per_radian(10.0) * 1e9, 2)
    10.77
    """
    return WAVELENGTH / (4 * np.pi * REFRACTIVE_INDEX * STRAIN_OPTIC * gauge_length)


def strain_rate_per_count(sampling_rate: float, gauge_length: float, unit_calibration: float = 116.0) -> float:
    """Return the strain rate, 1/s, of one raw count of a Silixa iDAS.

    A count is `unit_calibration` / 2^13 nm of fiber extension per sample, so strain rate [nm/m/s] = 116 * counts /
    8192 * sampling rate [Hz] / gauge length [m] (Silixa's own TDMS scripts; its files carry the 116 as
    `Unit Calibration (nm)`).

    >>> round(strain_rate_per_count(1000.0, 10.0) * 1e9, 4)
    1.416
    """
    return 1e-9 * unit_calibration / 8192 * sampling_rate / gauge_length


def parse_unit(text: Any) -> Unit | None:
    """Read a unit as `(nm/m)/s`, `1/s`, `nε/s`, `strain`, `rad/s` or `m/s`; None if it is not a DAS unit.

    >>> parse_unit("(nm/m)/s")
    Unit(quantity='strain_rate', factor=1e-09, per_length=False)
    >>> parse_unit("rad/m/s").per_length
    True
    """
    try:
        base = dascore().get_quantity(text).to_base_units()
    except Exception:  # on a damaged text a parser can raise anything
        return None
    powers = {name.strip("[]"): round(power) for name, power in base.dimensionality.items()}
    name, factor = f"{base.units:D}", float(base.magnitude)
    if "count" in name or not np.isfinite(factor) or factor == 0:
        return None
    if "radian" in name:
        per_length = powers.pop("length", 0) == -1
        quantity = {(): "phase", (("time", -1),): "phase_rate"}.get(tuple(powers.items()))
        return Unit(quantity, factor, per_length) if quantity else None
    match powers:
        # `(nm/m)/s * Hz/m`: what Silixa writes if the numbers are still to be multiplied by sampling rate / gauge
        # length.
        case {"length": -1, "time": -2}:
            return Unit("idas_counts", 116.0)
        case {"length": 1, "time": -1}:
            return Unit("velocity", factor)
        case {"length": _}:
            return None
        case {"time": -1}:
            return Unit("strain_rate", factor)
    return None if powers else Unit("strain", factor)


def in_meters(values: Any, units: Any) -> Any:
    """Lengths in `units` (m where these are absent or empty) in m."""
    return values if not units or str(units) == "m" else values * float(dascore().get_quantity(units).to("m").magnitude)


def resolve(
    unit: Unit | None, stated: str, quantity: str | None, scale: float | None, where: Path, *, whole: bool = False
) -> Unit:
    """Decide the unit of the numbers, from what the file (`unit`; `stated` in its words) and the user say.

    `quantity` is used if the file does not say (the numbers are then in SI units); `scale` overrides the file's factor.
    `whole`: the file stores integers, which are counts and not in SI units.

    Raises
    ------
    InputError
        If neither says it, or both do and disagree without a `scale`.

    >>> resolve(None, "", "strain_rate", 1e-9, Path("a.npy"))
    Unit(quantity='strain_rate', factor=1e-09, per_length=False)
    """
    accepted = ", ".join(QUANTITIES)
    if quantity is not None and quantity not in QUANTITIES:
        raise InputError(f"{where}: unknown quantity {quantity!r}; give one of {accepted}")
    if unit is None and quantity is None:
        words = f"states {stated!r}, which tells no unit" if stated else "states no unit"
        raise InputError(
            f"{where}: the file {words}; give quantity (one of {accepted}) and scale (stored number to SI unit)"
        )
    if scale is not None:
        known = quantity or (unit.quantity if unit else "")
        return Unit(known, scale, bool(unit and unit.per_length and unit.quantity == known))
    if unit is None and whole and quantity != "idas_counts":
        raise InputError(
            f"{where}: integers are counts, not {quantity} in SI units; give scale (count to SI unit) in [das] "
            "of site.toml"
        )
    if unit is None:
        return Unit(str(quantity), 116.0 if quantity == "idas_counts" else 1.0)
    if quantity is not None and quantity != unit.quantity:
        raise InputError(
            f"{where}: the file holds {unit.quantity}, not {quantity}; "
            "leave quantity out, or give scale too to overrule the file"
        )
    return unit


def time_derivative(values: NDArray[np.float64], sampling_rate: float) -> NDArray[np.float64]:
    """Return d/dt of `values` [time, channel] from the interpolating cubic spline.

    At a fifth of the sampling rate it is 2 % low, where the central difference is 24 % low.

    >>> time = np.arange(40) / 5.0
    >>> rate = time_derivative(np.sin(time)[:, None], 5.0)
    >>> bool(np.abs(rate[:, 0] - np.cos(time)).max() < 1e-2)
    True
    """
    from scipy.interpolate import CubicSpline

    if len(values) < 2:
        return np.full_like(values, np.nan)
    time = np.arange(len(values)) / sampling_rate
    return np.asarray(CubicSpline(time, values, axis=0)(time, 1))


def across_gauge(velocity: NDArray[np.float64], spacing: float, gauge_length: float) -> tuple[NDArray[np.float64], int]:
    """Return the strain rate [time, channel - 2 n], 1/s, of `velocity` [time, channel], m/s, and n.

    The difference between the n-th channels after and before, over 2 n spacings: the even number of spacings nearest to
    the gauge length, so that channels keep their places. The first and last n channels have no such pair.

    >>> rate, n = across_gauge(np.arange(6.0)[None] * 2.0, 0.5, 2.1)
    >>> rate.tolist(), n
    ([[4.0, 4.0]], 2)
    """
    n = max(1, round(gauge_length / spacing / 2))
    return (velocity[:, 2 * n :] - velocity[:, : -2 * n]) / (2 * n * spacing), n


def to_strain_rate(
    values: NDArray[np.float64], unit: Unit, sampling_rate: float, gauge_length: float
) -> NDArray[np.float64]:
    """Return strain rate [time, channel], 1/s, of gapless `values` [time, channel] (velocity: `across_gauge` first).

    >>> float(to_strain_rate(np.ones((4, 1)), Unit("strain_rate", 1e-9), 5.0, 10.0)[0, 0])
    1e-09
    """
    if unit.quantity == "idas_counts":
        return values * strain_rate_per_count(sampling_rate, gauge_length, unit.factor)
    values = values * unit.factor
    if unit.quantity.startswith("phase"):
        values *= strain_per_radian(1.0 if unit.per_length else gauge_length)
    return time_derivative(values, sampling_rate) if unit.quantity in ("strain", "phase") else values
