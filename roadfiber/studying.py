"""The paper's study as one command: error against SNR, track noise, anchors and Poisson ratio, and what it claims."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from roadfiber.study_page import NOT_AT_HAND, study_page
from roadfiber.study_surveys import AXES, METHODS, Axis, Setting, settings_of, studied
from roadfiber.study_tables import claims_of, draw, table_of
from vision.contract import InputError, require_writable, writing_into

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

RESULTS = "results.json"
#: What a quick study takes: axes, vehicles, and how many values of each axis.
QUICK, QUICK_PASSES, QUICK_VALUES = ("snr",), 3, 2


@dataclass(frozen=True, repr=False)
class Study:
    """Results of a study.

    Parameters
    ----------
    axes : that were varied, by name
    settings : of each axis, in the order of `axes`
    results : by the settings' keys
    """

    axes: dict[str, Axis]
    settings: dict[str, list[Setting]]
    results: dict[str, dict[str, float | str]]

    def table(self, axis: str) -> "pd.DataFrame":
        """One row per value and method: surveys, failures, mean error, what is expected, their ratio, Hausdorff ..."""
        return table_of(self.axes[axis], self.settings[axis], self.results)

    @property
    def claims(self) -> "pd.DataFrame":
        """What the paper says of each axis, what each method does there, and whether that agrees."""
        return claims_of(self.axes, {name: self.table(name) for name in self.axes})

    def plot(self, axis: str) -> "Figure":
        """Draw the error of all methods along an axis with the Cramer-Rao expectation, Hausdorff distance, seconds."""
        return draw(self.axes[axis], self.table(axis))

    def page(self) -> str:
        """One page that opens offline."""
        return study_page(self)

    def save(self, folder: Path | str) -> None:
        """Write study.html, claims.csv, and a figure and a table of each axis; InputError where that cannot be."""
        folder = Path(folder)
        require_writable(folder / "study.html")
        with writing_into(folder) as into:
            (into / "study.html").write_text(self.page(), encoding="utf-8")
            self.claims.to_csv(into / "claims.csv", index=False)
            for name in self.axes:
                self.table(name).to_csv(into / f"{name}.csv", index=False)
                self.plot(name).savefig(into / f"{name}.png", dpi=110)

    @property
    def facts(self) -> dict[str, Any]:
        """What `roadfiber study --json` prints."""
        from solver.run.strict_json import strict

        tables = {name: self.table(name).to_dict("records") for name in self.axes}
        found: dict[str, Any] = strict(
            {"claims": self.claims.to_dict("records"), "tables": tables, "field": NOT_AT_HAND}
        )
        return found

    def __repr__(self) -> str:
        return f"<Study of {', '.join(self.axes)}: {len(self.results)} surveys located>"

    def _repr_html_(self) -> str:
        from vision.contract.notebook import framed

        return framed(self.page())


def study(
    out: Path | str,
    *,
    axes: Sequence[str] = tuple(AXES),
    methods: Sequence[str] = METHODS,
    surveys: int = 50,
    passes: int = 8,
    snr_db: float = 15.0,
    loads: str = "point",
    jobs: int = 1,
    quick: bool = False,
) -> Study:
    """Repeat the paper's study on simulated surveys; what was located before in `out` is taken from there.

    Every result is kept in results.json as it comes, so that a study that was stopped goes on where it was.

    Parameters
    ----------
    out : folder
    axes : of `snr`, `noise`, `offset`, `anchors`, `poisson`
    methods : of `spline` (the default of `locate`), `network` (the paper's), `network-whitened`, `geometric`
    surveys : per point
    passes, snr_db : of each survey where they are not varied
    loads : "point", as in the paper, or "wheels"
    jobs : surveys at once
    quick : two values of the axis `snr`, one small survey each, without the paper's network: a minute, not days

    Raises
    ------
    InputError
        If an axis or a method is not known, or the folder holds results of something else.

    Examples
    --------
    >>> rf.study(folder / "study", axes=["weather"])
    Traceback (most recent call last):
    vision.contract.errors.InputError: --axes weather: not known; choose of snr, noise, offset, anchors, poisson
    """
    for option, given, known in (("axes", axes, tuple(AXES)), ("methods", methods, METHODS)):
        if unknown := [name for name in given if name not in known]:
            raise InputError(f"--{option} {unknown[0]}: not known; choose of {', '.join(known)}")
    if loads not in ("point", "wheels"):
        raise InputError(f"--loads {loads}: not known; choose point or wheels")
    chosen = {name: AXES[name] for name in (QUICK if quick else axes)}
    if quick:
        chosen = {name: replace(axis, values=axis.values[1::3][:QUICK_VALUES]) for name, axis in chosen.items()}
        methods, surveys, passes = [name for name in methods if name != "network"], 1, QUICK_PASSES
    out = Path(out)
    require_writable(out / RESULTS)
    out.mkdir(parents=True, exist_ok=True)
    base = Setting(passes=passes, snr_db=snr_db, loads=loads)
    every = {name: settings_of([axis], methods, surveys, base) for name, axis in chosen.items()}
    points = settings_of(list(chosen.values()), methods, surveys, base)
    results = studied(points, out / RESULTS, jobs)
    return Study(chosen, every, {one.key: results[one.key] for one in points})
