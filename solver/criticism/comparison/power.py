"""Where the residual has more power than the noise: by channel, pass, speed, class, lane, frequency, wavenumber."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from solver.criticism.comparison.cells import Approach, Cells, lanes
from solver.noise.sample_runs import blocks_of
from solver.run.report.misfit import pass_label
from solver.run.run import Run

Array = NDArray[np.float64]

#: Width of the bins of speed, km/h.
SPEED_WIDTH = 10.0
FEWEST = 30  # samples that a mean is told of
#: Most frequencies and wavenumbers of the spectrum.
FREQUENCIES, WAVENUMBERS = 48, 65


@dataclass(frozen=True)
class Powers:
    """Chi2 per sample by one property.

    Parameters
    ----------
    labels : [item], of the property's values
    chi2 : [item], mean squared whitened residual: 1 where only noise is left, NaN where no sample is
    samples : [item]
    sigma : [item], of chi2 if only noise were left
    """

    labels: list[str]
    chi2: Array
    samples: NDArray[np.int64]
    sigma: Array


@dataclass(frozen=True)
class Spectrum:
    """Power of the whitened residual by frequency and wavenumber: 1 where only noise is left.

    Parameters
    ----------
    frequency : [frequency], Hz
    wavenumber : [wavenumber], 1/m, positive for waves that move as the vehicles do
    power : [frequency, wavenumber]
    by_frequency, by_wavenumber : its means along the other axis
    looks : number of independent periodograms in the mean, so that noise scatters by 1/sqrt(looks)
    """

    frequency: Array
    wavenumber: Array
    power: Array
    by_frequency: Array
    by_wavenumber: Array
    looks: float


@dataclass(frozen=True)
class Power:
    """Power of the residual by every property; by channel and pass over all samples, otherwise near vehicles.

    Parameters
    ----------
    channel, one_pass, speed, vehicle_class, lane, gap : by channel, pass, speed, class, lane, distance of the nearest
        vehicle
    by_pass_and_channel : [pass, channel], chi2 per sample near the vehicle; NaN where there is none
    spectrum : by frequency and wavenumber
    """

    channel: Powers
    one_pass: Powers
    speed: Powers
    vehicle_class: Powers
    lane: Powers
    gap: Powers
    by_pass_and_channel: Array
    spectrum: Spectrum


def powers(cells: Cells, index: NDArray[np.int64], labels: Sequence[str]) -> Powers:
    """Chi2 per sample of the cells with each `index` [sample, channel]; those below 0 are left out."""
    use = cells.there & (index >= 0)
    energy = np.bincount(index[use], cells.residual[use] ** 2, len(labels))
    number = np.bincount(index[use], minlength=len(labels))
    chi2 = np.divide(energy, number, out=np.full(len(labels), np.nan), where=number > 0)
    sigma = cells.floor * np.sqrt(2 * cells.spread / np.maximum(number, 1))
    return Powers(list(labels), chi2, number, np.where(number > 0, sigma, np.nan))


def present(cells: Cells, index: NDArray[np.int64], labels: Sequence[str]) -> Powers:
    """The same without values that hardly any cell has."""
    every = powers(cells, index, labels)
    kept = np.flatnonzero(every.samples >= FEWEST)
    chosen = [labels[int(i)] for i in kept]
    return Powers(chosen, every.chi2[kept], every.samples[kept], every.sigma[kept])


def of_pass(approach: Approach, near: NDArray[np.bool_], values: NDArray[np.int64]) -> NDArray[np.int64]:
    """Values [pass] spread over the cells near each vehicle; -1 elsewhere."""
    return np.where(near, np.append(values, -1)[approach.owner], -1)


def spectrum_of(run: Run, cells: Cells) -> Spectrum:
    """Mean periodogram of the whitened residual of all passes, each seen in the direction of its travel."""
    settings, samples = run.facts["settings"], run.result.samples
    times = 2 * max(8, min(FREQUENCIES, max(len(one.rows) for one in run.passes)))
    waves = 2 * (WAVENUMBERS // 2)
    total, weight = np.zeros((times, waves)), 0.0
    for one, forward in zip(run.passes, cells.approach.forward, strict=True):
        rows = np.flatnonzero(np.isin(samples, one.rows))
        for block in blocks_of(samples[rows]):
            way = slice(None, None, 1 if forward else -1)
            part, there = cells.residual[rows[block]][:, way], cells.there[rows[block]][:, way]
            power, norm = periodogram(part, there, times, waves)
            total, weight = total + power, weight + norm
    power = np.fft.fftshift(total, axes=1)[: times // 2 + 1] / max(weight, 1e-300)
    frequency = np.fft.rfftfreq(times, 1 / settings["sampling_rate"])
    # exp(i (k x - w t)) is positive at opposite signs of the two transforms.
    wavenumber = -np.fft.fftshift(np.fft.fftfreq(waves, settings["channel_spacing"]))[::-1]
    power = power[:, ::-1]
    cell = len(run.result.fitted_channel) * len(samples) / (times * waves)
    looks = max(1.0, cell / 2)
    return Spectrum(frequency, wavenumber, power, power.mean(1), power.mean(0), looks)


def periodogram(values: Array, there: NDArray[np.bool_], times: int, waves: int) -> tuple[Array, float]:
    """Power [times, waves] summed over half-overlapping tapered tiles of [sample, channel], and what noise of unit
    variance adds to each of its cells.
    """  # noqa: D205
    total, weight = np.zeros((times, waves)), 0.0
    for first in range(0, max(1, len(values) - times // 2), times // 2):
        for left in range(0, max(1, values.shape[1] - waves // 2), waves // 2):
            tile, seen = (part[first : first + times, left : left + waves] for part in (values, there))
            taper = np.outer(np.hanning(len(tile) + 2)[1:-1], np.hanning(tile.shape[1] + 2)[1:-1]) * seen
            total += np.abs(np.fft.fft2(tile * taper, (times, waves))) ** 2
            weight += float((taper**2).sum())
    return total, weight


def power_of(run: Run, cells: Cells) -> Power:
    """Sum up the squared whitened residuals in every way."""
    approach, passes = cells.approach, run.passes
    near = approach.near & (approach.owner >= 0)
    fitted = run.result.fitted_channel
    column = np.broadcast_to(np.arange(len(fitted)), near.shape)
    classes = sorted({one.vehicle_class for one in passes})
    lane, lane_names = lanes(approach)
    kmh = np.floor(3.6 * np.nan_to_num(approach.speed) / SPEED_WIDTH).astype(int)
    speeds = [f"{SPEED_WIDTH * i:.0f}-{SPEED_WIDTH * (i + 1):.0f} km/h" for i in range(int(kmh.max(initial=0)) + 1)]
    steps = np.array([0, 5, 10, 15, 20, 25, 35])
    gaps = [f"{a}-{b} m" for a, b in pairwise(steps)] + ["farther, or none"]
    pair = np.where(near, approach.owner * len(fitted) + column, -1)
    both = powers(cells, pair, [""] * (len(passes) * len(fitted)))
    return Power(
        channel=powers(cells, column, [str(c) for c in fitted]),
        one_pass=powers(cells, np.where(near, approach.owner, -1), [pass_label(one) for one in passes]),
        speed=present(cells, np.where(near, kmh, -1), speeds),
        vehicle_class=present(
            cells, of_pass(approach, near, np.array([classes.index(p.vehicle_class) for p in passes])), classes
        ),
        lane=present(cells, of_pass(approach, near, lane), lane_names),
        gap=present(cells, np.digitize(approach.gap, steps) - 1, gaps),
        by_pass_and_channel=both.chi2.reshape(len(passes), len(fitted)),
        spectrum=spectrum_of(run, cells),
    )
