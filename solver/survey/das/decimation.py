"""Decimate fast records in memory before the fit; those in files are decimated while they are read (`reduced`)."""

from dataclasses import replace

import numpy as np

from solver.survey.das.lowpass import FIT_RATE, factor_of, taps_of
from solver.survey.das.record import DASRecord


def decimated(record: DASRecord, rate: float = FIT_RATE) -> DASRecord:
    """Decimate a fast record to the lowest whole fraction of its sampling rate that is not below `rate`.

    Zero-phase windowed-sinc low pass (Kaiser window, beta 5; Oppenheim and Schafer 2010, section 7.6), then every q-th
    sample, so that times do not shift. A sample whose filter touches a gap, or reaches beyond the record, is NaN.

    Parameters
    ----------
    record : strain rate at any rate
    rate : lowest sampling rate wanted, Hz

    Returns
    -------
    record : the same object if it is slow enough already

    Examples
    --------
    >>> time = np.arange(4000) / 100.0
    >>> wave = np.sin(2 * np.pi * 0.5 * time)[:, None]
    >>> fast = DASRecord(wave, time, np.datetime64(0, "ns"), np.zeros(1), np.zeros(1, int), 10.0, 1.0, 100.0, (), {})
    >>> slow = decimated(fast)
    >>> slow.sampling_rate, bool(np.allclose(slow.strain_rate[10:-10], wave[::5][10:-10], atol=0.002))
    (20.0, True)
    """
    factor = factor_of(record.sampling_rate, rate)
    if factor < 2:
        return record
    from scipy.signal import resample_poly

    taps = taps_of(factor)
    finite = np.isfinite(record.strain_rate)
    filtered = resample_poly(np.where(finite, record.strain_rate, 0.0), 1, factor, axis=0, window=taps)
    covered = resample_poly(finite.astype(float), 1, factor, axis=0, window=np.full(len(taps), 1 / len(taps)))
    filtered[covered < 1 - 0.5 / len(taps)] = np.nan
    provenance = record.provenance | {"decimated": f"from {record.sampling_rate:g} Hz by {factor}"}
    return replace(
        record,
        strain_rate=filtered,
        time=record.time[::factor],
        sampling_rate=record.sampling_rate / factor,
        provenance=provenance,
        rounding=record.rounding and record.rounding.filtered(taps / taps.sum(), factor),
    )
