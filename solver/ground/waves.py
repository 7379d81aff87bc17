"""Find the strongest radiated waves in a residual: frequency and speed, finer than a grid of trials could be."""

from itertools import product

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from solver.effect import Heard, Proposal

#: Wave speeds tried, m/s; range of frequencies tried, Hz.
SPEEDS = (90.0, 120.0, 150.0, 180.0, 220.0, 280.0)
LOWEST, HIGHEST = 1.6, 18.0
#: s; bins of retarded time: a fifth of a period at the highest frequency.
BIN = 0.01
#: How many waves are proposed.
LOUDEST = 3


def sent_from(r: Tensor, toward: Tensor, speed: Tensor, wave_speed: Tensor | float) -> Tensor:
    """Distance, m, of a moving source when it emitted the wave that arrives now.

    Parameters
    ----------
    r : [...], distance now, m
    toward, speed : [...], speed of the source toward the point, and its total speed, m/s
    wave_speed : m/s

    Notes
    -----
    s = |ray + v s / c| solved for s, which includes the Doppler shift (Landau and Lifshitz 1987, Fluid Mechanics, 74).

    >>> import torch
    >>> sent_from(torch.tensor(100.0), torch.tensor(15.0), torch.tensor(15.0), 150.0).round(decimals=2)
    tensor(111.1100)
    """
    closing = toward / wave_speed
    rest = 1 - (speed / wave_speed) ** 2
    return r * (closing + (closing**2 + rest).sqrt()) / rest


def loudest_waves(heard: Heard) -> Proposal:
    """Frequency, Hz, and speed, m/s, of the waves r^-1/2 cos(w (t - r / c)) that fit a residual best.

    Returns
    -------
    the strongest waves, {"frequency": ..., "speed": ...}, and how many were compared

    Notes
    -----
    In the retarded time t - r / c, a wave is a plain oscillation, the same in all channels. The residual of each pass,
    sorted into bins of it, is Fourier transformed once for all frequencies (gridding, as Lomb's periodogram is computed
    by Press and Rybicki 1989, ApJ 338, 277); the powers of the passes, each of its own phase, are added.
    """
    driven = heard.load.trajectory
    ray = heard.middle[:, :2] - driven.position.expand(-1, len(heard.middle), -1)
    r = ray.norm(dim=-1).clamp_min(1.0)
    toward = (ray * driven.velocity).sum(-1) / r
    tangent = heard.slope[:, :2] / heard.slope.norm(dim=-1, keepdim=True)
    gain = (10 / r).sqrt() * ((ray * tangent).sum(-1) / r) ** 2
    residual = heard.residual[heard.sample_index] * gain
    duration = float(driven.since.max()) + 2 * float(r.max()) / min(SPEEDS)
    size = 2 ** int(np.ceil(np.log2(2 * duration / BIN)))
    frequency = np.fft.rfftfreq(size, BIN)
    within = (frequency > LOWEST) & (frequency < HIGHEST)
    power = np.zeros((len(SPEEDS), int(within.sum())))
    for (number, speed), one in product(enumerate(SPEEDS), driven.pass_index.unique()):
        mine = driven.pass_index == one
        sent = sent_from(r[mine], toward[mine], driven.speed[mine], speed)
        retarded = driven.time[mine] - sent / speed
        bins = ((retarded - retarded.min()) / BIN).round().long().flatten().numpy()
        summed = np.bincount(bins, residual[mine].flatten().numpy(), size)
        energy = float((gain[mine] ** 2).sum()) / 2
        power[number] += np.abs(np.fft.rfft(summed)[within]) ** 2 / energy
    return peaks(power, frequency[within], 1 / duration), round((HIGHEST - LOWEST) * duration * len(SPEEDS))


def peaks(power: NDArray[np.floating], frequency: NDArray[np.floating], apart: float) -> list[dict[str, float]]:
    """The largest peaks of power [speed, frequency], at least `apart`, Hz, in frequency.

    >>> peaks(np.eye(6, 20) * [[1], [5], [2], [3], [1], [1]], np.arange(20.0), 1.5)[0]
    {'frequency': 1.0, 'speed': 120.0}
    """
    left, found = power.copy(), []
    for _ in range(LOUDEST):
        at, where = np.unravel_index(int(left.argmax()), left.shape)
        found.append({"frequency": float(frequency[where]), "speed": SPEEDS[at]})
        left[:, np.abs(frequency - frequency[where]) <= apart] = -1.0
    return found
