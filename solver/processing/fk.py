"""FK filter: keep what moves along the fiber as fast as road vehicles, slowly enough to be their static load."""

from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from solver.processing.gaps import interpolated, runs
from solver.survey.das.record import DASRecord
from vision.contract import InputError

#: The paper's pass band: apparent speed along the fiber, m/s (9 to 90 km/h), and frequency, Hz.
SPEEDS = (9 / 3.6, 90 / 3.6)
HIGHEST = 1.0
#: Share of each limit over which the mask falls from 1 to 0, so that the edge of the pass band does not ring.
TAPER = 0.1
#: Zeros added at most, s and m: beyond, the filter's response has fallen below a thousandth of its peak.
PAD = (60.0, 500.0)


def fk_mask(
    shape: tuple[int, int],
    dt: float,
    dx: float,
    *,
    speeds: tuple[float, float] = SPEEDS,
    highest: float = HIGHEST,
    taper: float = TAPER,
) -> Tensor:
    """Pass band in frequency f and wavenumber k, for `torch.fft.rfft2` of a map [time, channel].

    1 where speeds[0] <= |f| / |k| <= speeds[1] and |f| <= highest, else 0, with edges of half a cosine that are
    `taper` of a limit wide and lie inside the band.

    Parameters
    ----------
    shape : number of samples and of channels that are transformed
    dt, dx : sampling interval, s, and channel spacing, m
    speeds : lowest and highest apparent speed, m/s, of waves going either way
    highest : frequency, Hz
    taper : 0 for sharp edges

    Returns
    -------
    [sample, channel // 2 + 1], 0 to 1

    Raises
    ------
    InputError
        If a limit is not positive, or the speeds are not ascending.

    Examples
    --------
    >>> mask = fk_mask((100, 50), 0.2, 1.0)  # rows are 0.05 Hz, columns 0.02 1/m apart
    >>> mask[0, :3].tolist(), mask[10, 5].item(), mask[10, 0].item(), mask[25, 12].item()
    ([0.0, 0.0, 0.0], 1.0, 0.0, 0.0)
    """
    if not (0 < speeds[0] < speeds[1] and highest > 0 and 0 <= taper < 1):
        raise InputError("FK filter: give ascending positive speeds, a positive frequency and a taper below 1")
    frequency = torch.fft.fftfreq(shape[0], dt, dtype=torch.float64).abs()[:, None]
    wavenumber = torch.fft.rfftfreq(shape[1], dx, dtype=torch.float64)[None, :]
    # In place of the speed f / k, so that k = 0 needs no special case: its speed is beyond every limit.
    speed = frequency / wavenumber.clamp_min(1e-12)
    slow = rising((speed / speeds[0] - 1), taper)
    fast = rising(1 - speed / speeds[1], taper)
    return slow * fast * rising(1 - frequency / highest, taper)


def rising(margin: Tensor, taper: float) -> Tensor:
    """0 below a margin of 0, 1 above `taper`, half a cosine between.

    >>> rising(torch.tensor([-0.1, 0.0, 0.05, 0.1]), 0.1).tolist()
    [0.0, 0.0, 0.5, 1.0]
    """
    if not taper:
        return (margin >= 0).to(margin)
    return (1 - torch.cos(torch.pi * (margin / taper).clamp(0, 1))) / 2


def fk_filter(
    strain_rate: Tensor,
    dt: float,
    dx: float,
    *,
    speeds: tuple[float, float] = SPEEDS,
    highest: float = HIGHEST,
    taper: float = TAPER,
) -> Tensor:
    """Filter a whole map in frequency and wavenumber; linear and differentiable, so that a model is filtered alike.

    d -> F^-1[ mask(f, k) F[d] ], with the map continued by zeros (to twice its size, at most by `PAD`), so that what
    leaves at one end does not come in at the other.

    Parameters
    ----------
    strain_rate : [..., time, channel], finite, on a regular grid without gaps
    dt, dx : sampling interval, s, and channel spacing, m
    speeds, highest, taper : see `fk_mask`

    Returns
    -------
    [..., time, channel]

    Examples
    --------
    >>> wave = torch.zeros(64, 40, dtype=torch.float64, requires_grad=True)
    >>> torch.autograd.grad(fk_filter(wave, 0.2, 1.0)[30, 20], wave)[0].shape
    torch.Size([64, 40])
    """
    from scipy.fft import next_fast_len

    rows, channels = strain_rate.shape[-2:]
    size = (
        next_fast_len(rows + min(rows, round(PAD[0] / dt)), real=True),
        next_fast_len(channels + min(channels, round(PAD[1] / dx)), real=True),
    )
    mask = fk_mask(size, dt, dx, speeds=speeds, highest=highest, taper=taper).to(strain_rate.device)
    return torch.fft.irfft2(torch.fft.rfft2(strain_rate, size) * mask, size)[..., :rows, :channels]


def fk_filtered(
    record: DASRecord,
    *,
    speeds: tuple[float, float] = SPEEDS,
    highest: float = HIGHEST,
    taper: float = TAPER,
) -> DASRecord:
    """Filter a record in frequency and wavenumber (see `fk_filter`), as the paper does before its fit.

    Each run of rows between two gaps is filtered on its own. Dead channels are bridged by a line between their
    neighbors for the transform, and stay NaN. Below 1 Hz the filter also removes most of what tells a wrong gauge
    length or wheel layout: locate on less filtered data where noise allows.

    Parameters
    ----------
    record : strain rate
    speeds, highest, taper : see `fk_mask`

    Examples
    --------
    >>> time, place = np.arange(300) / 5.0, np.arange(120.0)
    >>> ahead = place - 8.0 * (time[:, None] - 20)  # 29 km/h
    >>> vehicle, hum = -ahead * np.exp(-((ahead / 8) ** 2)), np.sin(2 * np.pi * 1.7 * time)[:, None]
    >>> number = np.arange(120)
    >>> record = DASRecord(vehicle + hum, time, np.datetime64(0, "ns"), place, number, 10.0, 1.0, 5.0, (), {})
    >>> passed = fk_filtered(record).strain_rate
    >>> bool(np.corrcoef(passed[80:120].ravel(), vehicle[80:120].ravel())[0, 1] > 0.95)
    True
    """
    strain_rate = np.full_like(record.strain_rate, np.nan)
    for run in runs(record.measured):
        whole = torch.from_numpy(interpolated(record.strain_rate[run]))
        strain_rate[run] = fk_filter(
            whole, 1 / record.sampling_rate, record.channel_spacing, speeds=speeds, highest=highest, taper=taper
        ).numpy()
    strain_rate[~np.isfinite(record.strain_rate)] = np.nan
    done = f"{speeds[0]:g} to {speeds[1]:g} m/s, below {highest:g} Hz"
    return replace(record, strain_rate=strain_rate, provenance=record.provenance | {"fk_filtered": done})
