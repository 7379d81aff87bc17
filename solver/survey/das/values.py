"""Numbers that no fiber produces: too large, too small, or clipped at the end of a range."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from solver.survey.limits import FAINTEST, LOUDEST
from vision.contract import InputError

Array = NDArray[np.float64]

#: Samples at the end of the range that make a record clipped, and how many times rarer the next lower number must be:
#: without clipping the tails thin out, even of rounded numbers.
CLIPPED, THINNER = 20, 3
#: Channels that must hold them: a single one may be stuck.
CLIPPED_CHANNELS = 2


def check_size(swing: Array, where: Path) -> None:
    """Raise InputError where numbers cannot be strain rates.

    Parameters
    ----------
    swing : largest minus smallest value [channel], 1/s, of the channels that change

    >>> try: check_size(np.array([800.0, 900.0]), Path("a.h5"))
    ... except InputError as error: print(str(error).partition(";")[0])
    a.h5: strain rates of 4e+02 1/s, but the ground never strains faster than 0.1 1/s
    """
    size = float(np.median(swing)) / 2
    if size > LOUDEST:
        fault = f"strain rates of {size:.1g} 1/s, but the ground never strains faster than {LOUDEST:g} 1/s"
    elif size < FAINTEST:
        fault = f"strain rates of {size:.1g} 1/s at most, but no interrogator resolves less than {FAINTEST:g} 1/s"
    else:
        return
    raise InputError(f"{where}: {fault}; check the file's unit, and quantity and scale in [das] of site.toml")


def clipped_line(count: int, channels: int, which: str, end: float, beside: int) -> str | None:
    """Say that `count` samples are at an end of the range, if few are at the number next to it; else None."""
    if count <= THINNER * beside:
        return None
    return (
        f"{count} samples of {channels} channels stand at the same {which} number, {end:g}: the record is "
        "clipped, and vehicles seem farther away than they are; record with a larger range"
    )
