"""Small tables of tracks to compare."""

import numpy as np
import pandas as pd

from vision.interpolate import BOX


def tracks(noise=0.05, vehicles=6, seed=0, missed=0.0, flicker=0.0, metric=True, every=1):
    """Vehicles that drive from x = 0 to 80 m one after the other at 25 frames per second, and one that is parked."""
    rng = np.random.default_rng(seed)
    parts = []
    for number in range(vehicles + 1):
        parked = number == vehicles
        frame = np.arange(0, 400, every) if parked else np.arange(40 * number, 40 * number + 200, every)
        x = np.full(len(frame), 30.0) if parked else 0.4 * (frame - frame[0])
        place = np.stack([x, np.full(len(frame), -4.0 if parked else 1.75)], axis=1)
        place += rng.normal(0, noise, place.shape)
        left = 7 * place[:, 0] + 20
        box = dict(zip(BOX, (left, 100 + 5 * place[:, 1], left + 40, 130 + 5 * place[:, 1]), strict=True))
        label = np.where(rng.random(len(frame)) < flicker, "van", "car")
        table = pd.DataFrame({"time": frame / 25, "track_id": str(number + 1), "class": "car", **box, "frame": frame})
        table = table.assign(
            confidence=0.8, interpolated=False, detected_class=label, x=place[:, 0], y=place[:, 1],
            sigma_x=0.15, sigma_y=0.1,
        )  # fmt: skip
        parts.append(fill(table, rng.random(len(frame)) < missed))
    table = pd.concat(parts, ignore_index=True)
    return table if metric else table.drop(columns=["x", "y", "sigma_x", "sigma_y"])


def fill(table, missed):
    """Interpolate the fixes that were missed, but for the first and the last."""
    missed[[0, -1]] = False
    for name in [*BOX, "x", "y"]:
        table[name] = np.interp(table["frame"], table["frame"][~missed], table[name][~missed])
    return table.assign(interpolated=missed, missed=missed, detected_class=table["detected_class"].mask(missed, ""))


def stamped(table):
    """With UTC times as `roadfiber track` writes them."""
    time = pd.Timestamp("2025-08-11T06:00:00Z") + pd.to_timedelta(table["time"], unit="s")
    return table.assign(time=time.dt.strftime("%Y-%m-%dT%H:%M:%S.%fZ"))


def write(table, path):
    table.to_csv(path, index=False)
    return path
