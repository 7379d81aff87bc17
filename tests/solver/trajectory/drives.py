"""Drives with known truth, and what a camera makes of them."""

import numpy as np
import pandas as pd

from solver.survey.das import DASRecord

START = np.datetime64("2025-08-11T06:00:00", "ns")


def a_record(seconds=60.0, sampling_rate=5.0, missing=slice(0, 0)):
    """A record of zeros, NaN in the rows `missing`."""
    rows = round(seconds * sampling_rate)
    strain_rate = np.zeros((rows, 2))
    strain_rate[missing] = np.nan
    return DASRecord(
        strain_rate=strain_rate,
        time=np.arange(rows) / sampling_rate,
        start=START,
        distance=np.arange(2.0),
        channel=np.arange(2),
        gauge_length=10.0,
        channel_spacing=1.0,
        sampling_rate=sampling_rate,
        gaps=(),
        provenance={},
    )


def fixes(time, x, y, *, sigma=0.06, correlation=0.0, seed=0, track_id="1", vehicle_class="car", **more):
    """The trajectory table of one vehicle at x, y, m [fix], with errors of `sigma`, m, correlated from fix to fix."""
    time, x, y = np.broadcast_arrays(np.asarray(time, float), x, y)
    error = np.random.default_rng(seed).normal(size=(len(time), 2))
    for index in range(1, len(error)):
        error[index] = correlation * error[index - 1] + np.sqrt(1 - correlation**2) * error[index]
    stamps = pd.Timestamp(START, tz="UTC") + pd.to_timedelta(np.round(time * 1e9).astype(np.int64), unit="ns")
    return pd.DataFrame(
        {
            "time": stamps,
            "track_id": track_id,
            "class": vehicle_class,
            "x": x + sigma * error[:, 0],
            "y": y + sigma * error[:, 1],
            "sigma_x": sigma,
            "sigma_y": sigma,
            **more,
        }
    )
