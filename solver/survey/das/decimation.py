"""Fast records are reduced before they are fitted."""

from dataclasses import replace

import numpy as np

from solver.survey.das.record import DASRecord

#: Records are fitted at this rate or a little above, Hz. What a wheel 2 m away leaves at 20 m/s falls with frequency as
#: exp(-2 pi f 2 / 20): 0.7 % at the 8 Hz that the filter lets pass. At 12 Hz, with 4 % lost, routes went 0.3 m wrong.
FIT_RATE = 20.0
#: Length of the anti-alias filter, output samples to either side; its pass band is flat to 0.8 of the new Nyquist rate.
HALF_LENGTH = 10


def decimated(record: DASRecord, rate: float = FIT_RATE) -> DASRecord:
    """Reduce a fast record to the lowest whole fraction of its sampling rate that is not below `rate`.

    Zero-phase windowed-sinc low pass (Kaiser window, beta 5; Oppenheim and Schafer 2010, section 7.6), then every q-th
    sample, so that times do not shift. A sample whose filter touches a gap, or reaches beyond the record, is NaN.

    Parameters
    ----------
    record : strain rate at any rate
    rate : lowest sampling rate wanted, Hz

    Returns
    -------
    record : the same object where it is slow enough already

    Examples
    --------
    >>> time = np.arange(4000) / 100.0
    >>> wave = np.sin(2 * np.pi * 0.5 * time)[:, None]
    >>> fast = DASRecord(wave, time, np.datetime64(0, "ns"), np.zeros(1), np.zeros(1, int), 10.0, 1.0, 100.0, (), {})
    >>> slow = decimated(fast)
    >>> slow.sampling_rate, bool(np.allclose(slow.strain_rate[10:-10], wave[::5][10:-10], atol=0.002))
    (20.0, True)
    """
    factor = int(record.sampling_rate // rate)
    if factor < 2:
        return record
    from scipy.signal import firwin, resample_poly

    taps = firwin(2 * HALF_LENGTH * factor + 1, 0.9 / factor, window=("kaiser", 5.0))
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
