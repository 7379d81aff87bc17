"""Known lengths on the road against a calibration's predictions: a check without coordinates."""

import logging
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vision.camera import Calibration
from vision.contract import InputError
from vision.contract.columns import check_positive, finite
from vision.contract.csv_table import read_csv

log = logging.getLogger("roadfiber.calibrate")

Array = NDArray[np.float64]
COLUMNS = ("name", "px1", "py1", "px2", "py2", "length")
PIXEL_SIGMA = 1.0  # px; accuracy of a clicked end
LENGTH_SIGMA = 0.02  # m; accuracy of a measured length, if the file does not say


@dataclass(frozen=True)
class Lengths:
    """Straight lines on the road whose length is known.

    Attributes
    ----------
    names : [line]
    ends : [line, 2, 2], px, of both ends
    length, sigma : [line], m
    """

    names: tuple[str, ...]
    ends: Array
    length: Array
    sigma: Array

    def __len__(self) -> int:
        return len(self.names)


@dataclass(frozen=True)
class Predicted:
    """Lengths as predicted by a calibration.

    Attributes
    ----------
    length : [line], m
    sigma : [line], m, of calibration, clicked ends and measured length together
    """

    length: Array
    sigma: Array


def read_lengths(path: Path) -> Lengths:
    """Read known lengths from csv: name, px1, py1, px2, py2 (px), length (m), optionally sigma (m; 2 cm if absent).

    Raises
    ------
    InputError
        If the file is missing, empty, lacks a column, or a value is not a number or not above zero.
    """
    table = read_csv(path, ["name"], comment="#")
    if missing := [name for name in COLUMNS if name not in table]:
        raise InputError(f"{path}: no column {', '.join(missing)}; known lengths have {', '.join(COLUMNS)}")
    if "sigma" not in table:
        table = table.assign(sigma=LENGTH_SIGMA)
        log.warning("%s: has no column sigma; lengths are taken to be measured to %g m", path, LENGTH_SIGMA)
    table = finite(table, (*COLUMNS[1:], "sigma"), path)
    check_positive(table, ("length", "sigma"), path)
    ends = table[list(COLUMNS[1:5])].to_numpy(float).reshape(-1, 2, 2)
    return Lengths(
        tuple(table["name"].astype(str)), ends, table["length"].to_numpy(float), table["sigma"].to_numpy(float)
    )


def predict_lengths(calibration: Calibration, lengths: Lengths) -> Predicted:
    """Predict lengths and their standard deviations, to first order.

    The ends share the calibration's error, so it is propagated through their difference: with S the derivatives of the
    two places with respect to its parameters, C their covariance and u the line's direction, u'(S2 - S1) C (S2 - S1)'u.

    Raises
    ------
    InputError
        If an end is outside the picture or above the horizon.

    >>> down = Calibration(image_size=(640, 480), homography=[[0, -0.1, 48], [0.1, 0, -32], [0, 0, 1]])
    >>> dash = Lengths(("dash",), np.array([[[100.0, 300], [100, 270]]]), np.array([3.0]), np.array([0.02]))
    >>> predict_lengths(down, dash).length.round(6).tolist()
    [3.0]
    """
    flat = lengths.ends.reshape(-1, 2)
    outside = ~((flat >= 0) & (flat <= calibration.image_size)).all(axis=1)
    lost = np.isnan(calibration.to_ground(flat)).any(axis=1)
    for bad, where in ((outside, "outside the picture"), (lost, "above the horizon")):
        if bad.any():
            raise InputError(f"length {lengths.names[int(bad.argmax()) // 2]}: an end is {where}; check its pixels")
    first, second = (calibration.to_ground(lengths.ends[:, end]) for end in (0, 1))
    length = np.linalg.norm(second - first, axis=1)
    along = (second - first) / np.maximum(length, 1e-9)[:, None]
    variance = lengths.sigma**2
    for end in (0, 1):
        noise = np.einsum("ni,nij->nj", along, calibration.jacobian(lengths.ends[:, end])) * PIXEL_SIGMA
        variance = variance + (noise**2).sum(axis=1)
    if calibration.covariance is not None:
        slope = calibration.sensitivity(lengths.ends[:, 1]) - calibration.sensitivity(lengths.ends[:, 0])
        by_parameter = np.einsum("ni,nip->np", along, slope)
        variance = variance + np.einsum("np,pq,nq->n", by_parameter, calibration.covariance, by_parameter)
    return Predicted(length, np.sqrt(variance))
