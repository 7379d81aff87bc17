"""Matched filter: where along the fiber, how strong and how wide each passing vehicle appears, frame by frame."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solver.processing.gaps import interpolated
from solver.start.wavelets import Array, bank, best_scale, parabola
from solver.trajectory.vehicle_pass import Pass

THRESHOLD_DB = 7.0
FRAME_RATE = 10.0  # Hz; a vehicle moves less than its response is wide between two frames
SPIKE = 6.0  # noise standard deviations off its neighbors
ROWS_FOR_NOISE = 2000
TOGETHER = 1000  # frames that are averaged at once
#: Multiple of the usual level above which a channel is scaled down to that.
LOUD = 4.0


@dataclass(frozen=True)
class Detections:
    """Where one pass was seen, one row per frame.

    Parameters
    ----------
    row : row of the record [frame]
    x, y : the vehicle's place, m [frame]
    speed : along x, m/s [frame]
    channel : number of the channel beside the vehicle, with a fraction [frame]
    scale : of the wavelet that matches best, in channels [frame]
    snr_db : of the response, dB [frame]
    profile : correlation with each wavelet of the bank, centered at the channel [frame, scale], 1/s
    """

    row: NDArray[np.int64]
    x: Array
    y: Array
    speed: Array
    channel: Array
    scale: Array
    snr_db: Array
    profile: Array

    def __len__(self) -> int:
        return len(self.row)

    def where(self, keep: NDArray[np.bool_]) -> "Detections":
        """Those of some frames [frame]."""
        return replace(self, **{f.name: getattr(self, f.name)[keep] for f in fields(self)})


@dataclass(frozen=True)
class Frames:
    """A record averaged in time, at the frames that are asked for: all of them would take twice the record's memory.

    Parameters
    ----------
    strain_rate : [row, channel], 1/s; NaN samples do not count
    stride : rows of a frame

    `frames[which]` is strain rate [frame, channel] in double precision; a frame without any sample is NaN.

    >>> Frames(np.array([[1.0], [3.0], [np.nan], [4.0], [9.0]]), 2)[:].tolist()
    [[2.0], [4.0]]
    """

    strain_rate: NDArray[Any]
    stride: int

    def __len__(self) -> int:
        return len(self.strain_rate) // self.stride

    def __getitem__(self, which: slice | NDArray[np.int64]) -> Array:
        number = np.arange(len(self))[which]
        mean = np.full((len(number), self.strain_rate.shape[1]), np.nan)
        for first in range(0, len(number), TOGETHER):
            part = slice(first, first + TOGETHER)
            blocks = self.strain_rate[number[part, None] * self.stride + np.arange(self.stride)]
            finite = np.isfinite(blocks)
            count = finite.sum(1)
            total = np.where(finite, blocks, 0.0).sum(1, dtype=np.float64)
            np.divide(total, count, out=mean[part], where=count > 0)
        return mean


def thinned(strain_rate: NDArray[Any], passes: Sequence[Pass], stride: int) -> tuple[Frames, list[Pass]]:
    """Average `stride` rows into a frame: the frames, and passes whose rows count frames."""
    frames = Frames(strain_rate, stride)
    return frames, [thinned_pass(one, stride, len(frames)) if stride > 1 else one for one in passes]


def thinned_pass(one: Pass, stride: int, frames: int) -> Pass:
    """Keep the frames that a pass fills, with its mean place there; there may be none."""
    skip = int(-one.rows[0] % stride)
    count = min((len(one.rows) - skip) // stride, frames - int(one.rows[0] + skip) // stride)
    part = slice(skip, skip + max(count, 0) * stride)

    def blocks(values: NDArray[Any]) -> NDArray[Any]:
        return values[part].reshape(-1, stride, *values.shape[1:])

    return replace(
        one,
        rows=one.rows[part][::stride] // stride,
        in_view=np.asarray(blocks(one.in_view).all(1)),
        **{name: blocks(getattr(one, name)).mean(1) for name in ("position", "velocity", "sigma")},
    )


def mended(strain_rate: Array) -> Array:
    """Strain rate [frame, channel] with NaN and spikes replaced by a line between their neighbors in the frame.

    A spike (a cycle skip, a faded channel) is off the median of five channels by more than six times the noise and by
    more than those five vary otherwise; what a vehicle does is smooth over five channels. The noise is that of second
    differences, which no slope raises. A frame without samples becomes 0.

    >>> row = np.array([0.0, np.nan, 2.0, 3.1, 4.0, 5.2, 6.0, 7.1, 90.0, 9.0, 10.1, np.nan])
    >>> mended(row[None]).round(2).tolist()
    [[0.0, 1.0, 2.0, 3.1, 4.0, 5.2, 6.0, 7.1, 8.05, 9.0, 10.1, 10.1]]
    """
    filled = interpolated(strain_rate)
    around = np.pad(filled, ((0, 0), (2, 2)), mode="reflect")
    five = np.sort(np.lib.stride_tricks.sliding_window_view(around, 5, axis=1), axis=2)
    rough = np.abs(filled - five[..., 2])
    bend = np.diff(strain_rate, 2, axis=1)
    bend = bend[np.isfinite(bend)]
    noise = 1.4826 * np.median(np.abs(bend)) / np.sqrt(6) if len(bend) else 0.0
    spike = (rough > SPIKE * noise) & (rough > five[..., 3] - five[..., 1])
    return interpolated(np.where(spike, np.nan, filled))


def excess(strain_rate: Frames | Array) -> Array:
    """By how much the loudest channels [channel] of strain rate [frame, channel] exceed the usual level; 1 elsewhere.

    Brought down by that, a machine beside the fiber, a splice or a fading point is not the detection of every frame.

    >>> loud = np.random.default_rng(0).normal(size=(300, 20)) * np.where(np.arange(20) == 3, 30.0, 1.0)
    >>> [round(float(one)) for one in excess(loud)[2:5]]
    [1, 28, 1]
    """
    some = np.abs(strain_rate[:: max(1, len(strain_rate) // ROWS_FOR_NOISE)])
    heard = np.isfinite(some).any(0)
    level = np.zeros(some.shape[1])
    level[heard] = np.nanmedian(some[:, heard], axis=0)
    usual = float(np.median(level[level > 0])) if (level > 0).any() else 0.0
    loud = level > LOUD * usual
    return np.where(loud, level, usual) / usual if loud.any() else np.ones(len(level))


def scale_maps(strain_rate: Array, scales: Array, heard: NDArray[np.bool_] | None = None) -> Iterator[Array]:
    """SNR map [frame, channel] of each scale, as an amplitude ratio, negative for wavelets upside down.

    (d * psi_s)(x) / (1.4826 median |d * psi_s - median(d * psi_s)|): correlation along the channels, in units of its
    own noise, so that all scales are as likely to be loud by chance.

    Parameters
    ----------
    strain_rate : [frame, channel], finite
    scales : of the bank, in channels
    heard : which channels tell the deviation [channel]; all if not given

    >>> noise = np.random.default_rng(0).normal(size=(50, 200))
    >>> [round(float(np.median(np.abs(one))) * 1.4826, 2) for one in scale_maps(noise, np.array([2.0, 8.0]))]
    [1.0, 1.0]
    """
    from scipy.fft import irfft, next_fast_len, rfft

    wavelets = bank(scales)
    channels, half = strain_rate.shape[1], len(wavelets) // 2
    padded = np.pad(strain_rate, ((0, 0), (half, half)), mode="edge")
    size = next_fast_len(padded.shape[1] + len(wavelets), real=True)
    spectrum = rfft(padded, size, axis=1)
    heard = np.ones(channels, bool) if heard is None else heard
    every = max(1, len(strain_rate) // ROWS_FOR_NOISE)
    for shape in wavelets.T:
        # Correlation with a wavelet is convolution with its mirror.
        match = irfft(spectrum * rfft(shape[::-1], size), size, axis=1)[:, 2 * half : 2 * half + channels]
        level = match[::every, heard]
        match /= max(1.4826 * float(np.median(np.abs(level - np.median(level)))), np.finfo(float).tiny)
        yield match


def snr_maps(strain_rate: Array, scales: Array, heard: NDArray[np.bool_] | None = None) -> tuple[Array, Array]:
    """Largest SNR over the bank (see `scale_maps`) of responses of either polarity.

    Returns
    -------
    positive, negative : [frame, channel], of wavelets and of wavelets upside down

    >>> shape = np.pad(bank([5.0])[:, 0], 60)
    >>> seen = shape + np.random.default_rng(0).normal(0, 0.02, (3, len(shape)))
    >>> positive, negative = snr_maps(seen, np.arange(2.0, 10.0))
    >>> positive.argmax(1).tolist(), bool((positive.max(1) > negative.max(1)).all())
    ([85, 85, 85], True)
    """
    positive = np.full(strain_rate.shape, -np.inf)
    negative = positive.copy()
    for match in scale_maps(strain_rate, scales, heard):
        np.maximum(positive, match, out=positive)
        np.maximum(negative, -match, out=negative)
    return positive, negative


def decibel(snr: Array) -> Array:
    """Amplitude ratio -> dB.

    >>> decibel(np.array([10.0, 0.0])).round(6).tolist()
    [20.0, -240.0]
    """
    return 20 * np.log10(np.maximum(snr, 1e-12))


class MatchedFilter:
    """Bank of wavelets over the frames of some passes.

    Parameters
    ----------
    strain_rate : [frame, channel], 1/s, NaN where not measured
    passes : with rows that count frames
    scales : of the bank, in channels, equidistant
    level : by which each channel is divided first [channel]; none if not given
    """

    def __init__(self, strain_rate: Frames | Array, passes: Sequence[Pass], scales: Array, level: Array | None = None):
        self.scales = scales
        self.wavelets = bank(scales)
        half = len(self.wavelets) // 2
        self.frames = np.unique(np.concatenate([one.rows for one in passes]))
        data = strain_rate[self.frames] / (1.0 if level is None else level)
        self.measured = np.isfinite(data)
        data = mended(data)
        self.padded = np.pad(data, ((0, 0), (half, half)), mode="edge")
        # Frames and channels that measured nothing must not make the noise look small.
        rows = self.measured.any(1)
        self.positive, self.negative = np.zeros((2, *data.shape))
        self.positive[rows], self.negative[rows] = snr_maps(data[rows], scales, np.asarray(self.measured.any(0)))

    def detect(self, one: Pass, polarity: int, expected: Array | None = None, gate: int = 0) -> Detections:
        """Best channel and scale in every frame of a pass that is in view, where the SNR is above 7 dB.

        Parameters
        ----------
        one : the pass
        polarity : 1 or -1, of a vehicle going along +x; one going the other way has the opposite
        expected : channel to look around, for each row of the pass; the whole fiber if not given
        gate : how many channels to either side to look
        """
        sign = polarity * (1 if one.speed > 0 else -1)
        snr = self.positive if sign > 0 else self.negative
        row = np.searchsorted(self.frames, one.rows)
        last = snr.shape[1] - 1
        if expected is None:
            peak = snr[row].argmax(1)
        else:
            window = np.rint(expected).astype(int)[:, None] + np.arange(-gate, gate + 1)
            around = snr[row[:, None], np.clip(window, 0, last)]
            peak = window[np.arange(len(row)), np.where((window >= 0) & (window <= last), around, -np.inf).argmax(1)]
        inside = (peak > 0) & (peak < last)
        left, middle, right = (snr[row, np.clip(peak + step, 0, last)] for step in (-1, 0, 1))
        level = decibel(middle)
        # A maximum on the edge of the gate is the flank of something outside it.
        keep = one.in_view & inside & (middle >= left) & (middle >= right) & (level > THRESHOLD_DB)
        keep &= self.measured[row, np.clip(peak, 0, last)]
        profile = sign * self.profile(row[keep], peak[keep])
        return Detections(
            one.rows[keep],
            one.position[keep, 0],
            one.position[keep, 1],
            one.velocity[keep, 0],
            (peak + parabola(left, middle, right))[keep],
            best_scale(profile, self.scales),
            level[keep],
            profile,
        )

    @property
    def nothing(self) -> Detections:
        """No detection at all."""
        none = np.zeros(0)
        return Detections(none.astype(int), none, none, none, none, none, none, np.zeros((0, len(self.scales))))

    def profile(self, row: NDArray[np.int64], channel: NDArray[np.int64]) -> Array:
        """Correlation [detection, scale] with the wavelets centered at a channel, 1/s, not divided by the noise."""
        window = channel[:, None] + np.arange(len(self.wavelets))
        return np.asarray(self.padded[row[:, None], window] @ self.wavelets)
