"""Noise audit: whether the noise is what the whitening assumes, without which no test is valid."""

from dataclasses import dataclass
from itertools import pairwise
from math import comb

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from solver.fit.map_fit import MapFit
from solver.fit.problem import Problem
from solver.fit.state import State
from solver.noise.quiet_windows import quiet, whitened_noise
from solver.noise.whitening import Whitener, reach_of

#: Fewer quiet samples than this say too little about the noise to rank effects by it.
ENOUGH = 400
#: How far whitened noise may be from white: variance, correlation in time, between all channels and between channels
#: some apart, and ratio of variances over time.
VARIANCE, CORRELATION, NEARBY, UNSTEADY = (0.8, 1.25), 0.06, 0.1, 1.8
#: Variance of the noise, loud over quiet, below which a gain follows the signal.
LEVELED = 0.7
PARTS = 6
#: Order of the difference that tells noise from signal along the fiber, even.
ROUGH = 8


@dataclass(frozen=True)
class NoiseAudit:
    """What whitened quiet samples look like; white noise has variance 1 and no correlation.

    Parameters
    ----------
    samples : how many quiet samples there were
    variance : of the whitened samples
    in_time : largest correlation in time, of lags to 10 samples
    across : mean correlation between channels
    unsteady : largest over smallest variance of a part of the record
    common_share : share of the noise that all channels have in common
    memory : correlation of the noise itself with the sample before
    nearby : largest correlation of channels that may share noise, some gauge lengths apart
    signal_noise : how its variance grows with the signal, see `Problem.signal_noise`
    loud : its variance where the signal is strongest over that where it is weak
    faults : in words; none where the noise is understood
    """

    samples: int
    variance: float
    in_time: float
    across: float
    nearby: float
    unsteady: float
    common_share: float
    memory: float
    signal_noise: float
    loud: float
    faults: tuple[str, ...]

    @property
    def passed(self) -> bool:
        """Whether effects may be ranked."""
        return not self.faults

    @property
    def leveled(self) -> bool:
        """Whether the noise is weaker where the signal is strong, as an automatic gain leaves it."""
        return self.loud < LEVELED


def correlation(value: NDArray[np.float64], use: NDArray[np.bool_], lag: int, axis: int) -> float:
    """Mean product of samples `lag` apart along an axis, both of them in use."""
    value, use = np.where(use, value, 0.0), use.astype(float)
    if axis == 1:
        value, use = value.T, use.T
    pairs = (use[lag:] * use[:-lag]).sum()
    return float((value[lag:] * value[:-lag]).sum() / max(pairs, 1.0))


def audit(problem: Problem, residual: NDArray[np.float64], model: NDArray[np.float64]) -> NoiseAudit:
    """Audit the noise of a survey.

    Parameters
    ----------
    problem : the survey
    residual, model : [sample, channel], in noise sigmas, of the fit; where noise grows with the signal it shows here
    """
    still = quiet(len(problem.record), problem.start, problem.passes, problem.gauge_length)
    whiten = Whitener(problem.noise, np.arange(len(problem.record)), problem.channel, problem.law)
    white, use = whitened_noise(problem.record, still, whiten)
    count = int(use.sum())
    if count < ENOUGH:
        nan = float("nan")
        fault = f"only {count} samples without a vehicle near: the noise is not known; record some minutes of quiet"
        return NoiseAudit(count, nan, nan, nan, nan, nan, problem.law.common_share, nan, 0.0, 1.0, (fault,))
    variance = float((white[use] ** 2).mean())
    in_time = max((correlation(white, use, lag, 0) for lag in range(1, 11)), key=abs) / variance
    total, number = np.where(use, white, 0).sum(1), use.sum(1)
    pairs = float((number * (number - 1)).sum())
    across = float((total**2 - np.where(use, white**2, 0).sum(1)).sum() / max(pairs, 1.0)) / variance
    lags = range(1, reach_of(white.shape[1], problem.gauge_length / problem.channel_spacing) + 1)
    nearby = max((correlation(white, use, lag, 1) / variance - across for lag in lags), key=abs, default=0.0)
    parts = [np.where(use, white**2, 0)[a].sum() / use[a].sum() for a in stretches(use)]
    unsteady = float(max(parts) / min(parts)) if parts else 1.0
    measured = problem.measured.numpy()
    growth, loud = signal_growth(residual, model, measured, problem.channel, problem.noise.numpy())
    own = problem.law.own
    memory = float(own[1] / own[0]) if len(own) > 1 else 0.0
    scatter = 4 / np.sqrt(count)
    faults = []
    if not VARIANCE[0] < variance < VARIANCE[1]:
        faults.append(f"whitened noise has variance {variance:.2f} instead of 1")
    if abs(in_time) > CORRELATION + scatter:
        faults.append(f"whitened noise is correlated in time ({in_time:+.2f})")
    if abs(across) > CORRELATION + scatter:
        faults.append(f"whitened noise is correlated between channels ({across:+.2f})")
    if abs(nearby) > NEARBY + scatter:
        faults.append(f"whitened noise is correlated between neighboring channels ({nearby:+.2f})")
    if unsteady > UNSTEADY:
        faults.append(f"the noise is {unsteady:.1f} times as strong in some parts of the record as in others")
    return NoiseAudit(
        samples=count,
        variance=variance,
        in_time=in_time,
        across=across,
        nearby=nearby,
        unsteady=unsteady,
        common_share=problem.law.common_share,
        memory=memory,
        signal_noise=growth,
        loud=loud,
        faults=tuple(faults),
    )


def stretches(use: NDArray[np.bool_]) -> list[slice]:
    """Parts of the record with about as many quiet samples each, at least 200."""
    total = np.cumsum(use.sum(1))
    parts = min(PARTS, int(total[-1] // 200))
    edges = [0, *np.searchsorted(total, total[-1] * np.arange(1, parts) / max(parts, 1)).tolist(), len(use)]
    return [slice(a, b) for a, b in pairwise(edges) if use[a:b].any()]


def signal_growth(
    residual: NDArray[np.float64],
    model: NDArray[np.float64],
    measured: NDArray[np.bool_],
    channel: NDArray[np.int64],
    level: NDArray[np.float64],
) -> tuple[float, float]:
    """Growth of the noise's variance with the square of the signal, and that variance in loud over quiet samples.

    0 and 1 where neither is beyond chance.

    A high difference between neighboring channels leaves noise and takes what the model lacks, which is smooth over a
    gauge. Its square is regressed on the model's, with single large ones bounded.

    Parameters
    ----------
    residual, model : [sample, channel], in noise sigmas
    measured : [sample, channel]
    channel, level : [channel], numbers and noise: what differs there is not smooth
    """
    if len(channel) <= ROUGH:
        return 0.0, 1.0
    share = np.array([comb(ROUGH, k) for k in range(ROUGH + 1)], float)
    rough = np.diff(residual * level, ROUGH, axis=1) / np.sqrt(np.convolve(level**2, share**2, "valid"))
    whole = sliding_window_view(measured, ROUGH + 1, axis=1).all(-1) & (channel[ROUGH:] - channel[:-ROUGH] == ROUGH)
    if whole.sum() < ENOUGH:
        return 0.0, 1.0
    square = np.minimum(rough[whole] ** 2, 16.0)
    signal = model[:, ROUGH // 2 : -(ROUGH // 2)][whole] ** 2
    loud = signal > np.quantile(signal, 0.9)
    excess = float(square[loud].mean() / square[signal <= np.median(signal)].mean()) - 1
    growth = excess / float(signal[loud].mean())
    scatter = np.sqrt(2 / loud.sum()) * 2
    if abs(excess) < max(0.15, 4 * scatter):
        return 0.0, 1.0
    return max(growth, 0.0), 1 + excess


def audit_of(fit: MapFit, state: State) -> NoiseAudit:
    """Audit the noise that a fit leaves at a state."""
    model, noise = fit.model(state), fit.problem.noise
    return audit(fit.problem, (fit.unexplained(model) / noise).numpy(), (model / noise).numpy())
