"""Tables, figures and verdicts of the paper's study."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from roadfiber.study_surveys import FIELD, PER_RATIO, Axis, Setting
from vision.contract.figures import styled
from vision.contract.palette import SERIES

#: Of methods, in turn.
MARKERS = "osD^v"


def table_of(axis: Axis, settings: Sequence[Setting], results: dict[str, dict[str, float | str]]) -> pd.DataFrame:
    """One row per value and method of an axis.

    Surveys, failures, mean error with its spread, 10th and 90th percentile over surveys, expectation, largest error,
    share of coordinates within 1.96 sigma, share of surveys that say that the fiber may be on the other side, seconds.
    """
    rows = [{**asdict(setting), **results[setting.key]} for setting in settings if setting.key in results]
    frame = pd.DataFrame(rows)
    for name in ("mean", "largest", "hausdorff", "expected_mean", "covered", "ambiguous", "seconds", "failed"):
        if name not in frame:
            frame[name] = np.nan
    groups = frame.groupby([axis.field, "method"])
    table = pd.DataFrame(
        {
            "surveys": groups.size(),
            "failed": groups["failed"].count(),
            "mean": groups["mean"].mean(),
            "spread": groups["mean"].std(),
            "low": groups["mean"].quantile(0.1),
            "high": groups["mean"].quantile(0.9),
            "expected": groups["expected_mean"].mean(),
            "ratio": groups["mean"].mean() / groups["expected_mean"].mean(),
            "largest": groups["largest"].mean(),
            "95 %": groups["largest"].quantile(0.95),
            "hausdorff": groups["hausdorff"].mean(),
            "covered": groups["covered"].mean(),
            "two sides": groups["ambiguous"].mean(),
            "seconds": groups["seconds"].mean(),
        }
    )
    return table.reset_index()


@styled
def draw(axis: Axis, table: pd.DataFrame) -> Figure:
    """Mean error with its spread and expectation, Hausdorff distance beside the paper's, and seconds."""
    figure = Figure(figsize=(11, 3.6), layout="constrained")
    error, curve, seconds = figure.subplots(1, 3)
    for number, (method, rows) in enumerate(table.groupby("method")):
        at, color = rows[axis.field], SERIES[number % len(SERIES)]
        look = {"color": color, "marker": MARKERS[number % len(MARKERS)], "label": method}
        error.plot(at, rows["mean"], **look)
        error.fill_between(at, rows["low"], rows["high"], color=color, alpha=0.2)
        curve.plot(at, rows["hausdorff"], **look)
        seconds.plot(at, rows["seconds"], **look)
    # Methods may have been run on different numbers of surveys; what is expected is known best where there are most.
    most = table.loc[table.groupby(axis.field)["surveys"].idxmax()]
    error.plot(most[axis.field], most["expected"], "k--", label="expected (Cramer-Rao)")
    curve.axhspan(*FIELD, color="gray", alpha=0.3, label="the paper, in the field")
    if axis.limit is not None:
        curve.axvline(axis.limit, color="gray", linestyle=":", label=axis.said)
    elif axis.field == "poisson_error":
        grid = np.linspace(min(axis.values), max(axis.values), 50)
        curve.plot(grid, PER_RATIO * np.abs(grid), ":", color="gray", label=axis.said)
    titles = ("Mean error, m; bands: 80 % of surveys", "Off at most (Hausdorff distance), m", "Seconds per survey")
    for panel, title in zip((error, curve, seconds), titles, strict=True):
        panel.set(title=title, xlabel=axis.label, yscale="log")
        panel.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        panel.yaxis.set_major_formatter("{x:g}")
        panel.yaxis.set_minor_formatter("")
        panel.grid(alpha=0.3)
    error.legend()
    curve.legend()
    return figure


@dataclass(frozen=True)
class Claim:
    """What the paper says of an axis, and what a method does there.

    Parameters
    ----------
    axis, said : the axis, and the paper's words on it
    method : of the study
    found : what it does, in words
    agrees : whether that is what the paper says; None where the study has too few values to tell
    """

    axis: str
    said: str
    method: str
    found: str
    agrees: bool | None


def claims_of(axes: Mapping[str, Axis], tables: Mapping[str, pd.DataFrame]) -> pd.DataFrame:
    """One row per axis and method; a survey counts as located where its Hausdorff distance is below the paper's own."""
    rows = [
        claim_of(axis, str(method), rows.sort_values(axis.field))
        for name, axis in axes.items()
        for method, rows in tables[name].groupby("method")
    ]
    return pd.DataFrame([asdict(one) for one in rows], columns=list(Claim.__dataclass_fields__))


def claim_of(axis: Axis, method: str, rows: pd.DataFrame) -> Claim:
    """Compare the mean Hausdorff distance of a method along an axis with what the paper says."""
    value, distance = rows[axis.field].to_numpy(float), rows["hausdorff"].to_numpy(float)
    good = distance <= FIELD[1]
    if axis.limit is None:
        return by_slope(axis, method, value, distance)
    beyond = value < axis.limit if axis.rises else value > axis.limit
    if not beyond.any() or beyond.all() or not np.isfinite(distance).any():
        return Claim(axis.label, axis.said, method, "too few values to tell", None)
    words = f"at most {farthest(distance[~beyond])} where the paper locates, {farthest(distance[beyond])} beyond"
    return Claim(axis.label, axis.said, method, words, bool(good[~beyond].all() and not good[beyond].any()))


def farthest(distance: np.ndarray) -> str:
    """The largest of some distances, m, in words; NaN where nothing was located.

    >>> farthest(np.array([0.2, np.nan])), farthest(np.array([np.nan]))
    ('0.20 m (some not located)', 'none located')
    """
    known = distance[np.isfinite(distance)]
    if not len(known):
        return "none located"
    return f"{known.max():.2f} m{' (some not located)' if len(known) < len(distance) else ''}"


def by_slope(axis: Axis, method: str, value: np.ndarray, distance: np.ndarray) -> Claim:
    """Compare what a method loses per 0.01 of the Poisson ratio."""
    if len(value) < 3 or not np.isfinite(distance).all():
        return Claim(axis.label, axis.said, method, "too few values to tell", None)
    lost = float(np.abs(value) @ (distance - distance[np.abs(value).argmin()]) / (value @ value))
    words = f"{0.01 * lost:.3f} m per 0.01"
    return Claim(axis.label, axis.said, method, words, bool(0.5 * PER_RATIO < lost < 1.5 * PER_RATIO))
