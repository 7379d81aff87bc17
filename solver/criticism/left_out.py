"""Faults that are mended by leaving out what was measured: samples that jump, channels that faded."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter, percentile_filter, uniform_filter

from solver.criticism.fault import Fault
from solver.fit.map_fit import MapFit
from solver.fit.problem import Problem
from solver.fit.robust import HUBER
from solver.fit.state import State
from solver.survey.dead_channels import is_nearly_silent

Array = NDArray[np.float64]

#: By how much a sample that jumped differs from its neighbors, as a share of the rms of the residual around it, and how
#: many samples and channels around it that is.
JUMP, AROUND_JUMP = 8.0, 5
#: Over how many channels the neighbors of a dead one are, what share it has at most of the power of the quietest
#: percentage of them, and how many dead ones are named.
AROUND, QUIET, QUIETEST, NAMED = 15, 0.5, 20, 8


def find_cycle_skips(fit: MapFit, state: State) -> Fault | None:
    """Samples far out of the residual around them: jumps of the unwrapped phase, spikes.

    Where the residual is more than noise, a sample must be farther out: an unknown vehicle is as sharp on a channel.
    """
    measured = fit.measured.numpy()
    bad = measured & (fit.weighted(fit.glance(state))[0].good.numpy() == 0)
    near = np.zeros_like(bad)
    for axis in (0, 1):
        for step in (1, -1):
            near |= np.roll(bad, step, axis)
    residual = fit.residual(state).numpy()
    around = np.stack([np.roll(residual, step, axis) for axis in (0, 1) for step in (1, -1)])
    jumps = bad & ~near & (np.abs(residual - np.median(around, 0)) > JUMP * level_around(residual))
    bad = jumps
    count, total = int(jumps.sum()), int(measured.sum())
    if count < 4:
        return None
    # What the robust likelihood charges for so many samples.
    fall = count * float(2 * HUBER * JUMP - HUBER**2)
    at = fit.problem.traffic.samples

    def mend(survey: Problem) -> Problem:
        record = survey.record.copy()
        block = record[at]
        block[bad] = np.nan
        record[at] = block
        return replace(survey, record=record)

    rate = count / total
    words = f"{count} of {total} samples jump by many sigmas and back; they are left out of the fit"
    return Fault("cycle_skips", "interrogator", fall, 1, 1, rate, rate / count**0.5, "1", 5 / total, words, mend)


def level_around(residual: Array) -> Array:
    """Rms of a residual [sample, channel], in sigmas, around each sample without it; at least the noise's own, 1."""
    inside = AROUND_JUMP**2
    square = residual**2
    others = (inside * uniform_filter(square, AROUND_JUMP, mode="nearest") - square) / (inside - 1)
    return np.asarray(np.sqrt(np.maximum(others, 1.0)))


def find_faded_channels(fit: MapFit, state: State) -> Fault | None:
    """Single channels that are nearly silent where their neighbors record vehicles."""
    use = fit.measured.numpy()
    model, data = np.where(use, fit.model(state).numpy(), 0.0), np.where(use, fit.data.numpy(), 0.0)
    energy = (model**2).sum(0)
    gain = (data * model).sum(0) / np.maximum(energy, 1e-300)
    heard = energy / fit.problem.noise.numpy() ** 2
    around = median_filter(gain, AROUND, mode="nearest")
    # A wrong model may be out of step with single channels; those are as loud as any. How loud that is varies where
    # vehicles are sampled rarely.
    power = (data**2).sum(0) / np.maximum(use.sum(0), 1) - fit.problem.noise.numpy() ** 2
    silent = power < QUIET * percentile_filter(power, QUIETEST, AROUND, mode="nearest")
    with np.errstate(divide="ignore"):
        dead = is_nearly_silent(gain, heard**-0.5, around) & silent
    count = int(dead.sum())
    if count == 0:
        return None
    fall = float((heard * (around - gain) ** 2)[dead].sum())
    numbers = fit.problem.channel[dead]

    def mend(survey: Problem) -> Problem:
        record = survey.record.copy()
        record[:, np.isin(survey.channel, numbers)] = np.nan
        return replace(survey, record=record)

    share, least = count / len(dead), 1 / len(dead)
    named = ", ".join(map(str, numbers[:NAMED])) + (", ..." if count > NAMED else "")
    words = f"channels that are nearly silent where their neighbors record vehicles ({named}) are left out of the fit"
    sigma = share / count**0.5
    return Fault("faded_channels", "interrogator", fall, count, len(dead), share, sigma, "1", least, words, mend)
