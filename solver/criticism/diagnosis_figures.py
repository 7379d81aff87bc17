"""A diagnosis as pictures: support of the explanations, one vehicle before and after, the route with both corridors."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from html import escape
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from solver.criticism.candidate import Candidate
from solver.fit.map_fit import MapFit
from solver.fit.posterior import assemble
from solver.fit.result import FitResult
from solver.run.report.misfit import misfit_of, pass_label, rows_of, whole_range
from solver.run.report.misfit_figure import scale_figure, wave_pictures
from solver.run.report.route_figure import abscissa, along_x, depth_profile, draw_profile, padded, sideways_profile
from solver.run.run import Run
from solver.trajectory.vehicle_pass import Pass
from vision.contract.drawing import beside, canvas, coarse, color_map, color_scale, place
from vision.contract.figures import MUTED, data_uri, png_bytes, styled, svg

if TYPE_CHECKING:
    from solver.criticism.finding import Diagnosis

#: Explanations that are drawn at most, known and unknown ones.
KNOWN, UNKNOWN = 6, 3
#: Name of the picture of what the model leaves, beside those of effects.
LEFT = ""
#: px of a picture of one pass, of a signature; rows or columns of either.
PANEL, CELLS, THUMBNAIL = 340, 240, 60
FOUND_COLOR, OTHER_COLOR, UNKNOWN_COLOR = "#d55e00", "#0072b2", "#8a929a"


def explanations(listed: Sequence[Candidate]) -> list[Candidate]:
    """What explains most, known and unknown, best first."""
    best = sorted((c for c in listed if c.delta_chi2 > 0), key=lambda c: -c.delta_chi2)
    chosen = [c for c in best if not c.generic][:KNOWN] + [c for c in best if c.generic][:UNKNOWN]
    return sorted(chosen, key=lambda c: -c.delta_chi2)


@styled
def support_figure(listed: Sequence[Candidate]) -> Figure:
    """Bars of how much of the misfit each explanation takes away, with nothing among them."""
    shown = explanations(listed)
    row = 26
    figure = canvas(1060, 60 + row * (len(shown) + 1))
    axes = place(figure, "support", 250, 6, 700, row * (len(shown) + 1))
    most = max((c.delta_chi2 for c in shown), default=1.0)
    for at, c in enumerate(shown):
        color = UNKNOWN_COLOR if c.generic else FOUND_COLOR if c.verdict == "present" else OTHER_COLOR
        axes.barh(at, c.delta_chi2, color=color, height=0.62)
        beside(axes, c.delta_chi2, at, f"{c.delta_chi2:,.0f}" + ("" if c.refitted else " (predicted)"))
    beside(axes, 0.0, len(shown), "0")
    axes.set_yticks(range(len(shown) + 1), [*(c.title for c in shown), "Nothing is missing"])
    axes.set(xlim=(0, 1.12 * max(most, 1.0)), ylim=(len(shown) + 0.5, -0.5))
    axes.set_xlabel("misfit that it takes away (fall of chi²)")
    return figure


@dataclass(frozen=True)
class BeforeAfter:
    """A run without and with the first candidate of its diagnosis in the model.

    Parameters
    ----------
    before, after : the run as it is, and with it
    one : the pass whose misfit falls most
    """

    before: Run
    after: Run
    one: Pass


def same_grid(one: FitResult, other: FitResult) -> bool:
    """Whether two results are of the same samples and channels."""
    return np.array_equal(one.samples, other.samples) and np.array_equal(one.fitted_channel, other.fitted_channel)


def before_after(run: Run, diagnosis: "Diagnosis") -> BeforeAfter | None:
    """The run and what it becomes; None where the first candidate was not fitted in full."""
    first = diagnosis.candidates[0].effect if diagnosis.candidates else ""
    if diagnosis.verdict == "adequate" or first not in diagnosis.fits:
        return None
    fit, state = diagnosis.fits[first]
    problem = replace(fit.problem, signal_noise=0.0)  # as `locate` and `add` take it
    result = assemble(problem, MapFit(problem), state, method="spline", iterations=0, seconds=0.0, converged=True)
    if not same_grid(run.result, result):
        return None
    run = replace(run, added=None)  # both sides take their models for granted
    after = replace(run, result=result, problem=problem, folder=None)
    fell = misfit_of(run.result, run.passes).by_pass - misfit_of(result, run.passes).by_pass
    return BeforeAfter(run, after, run.passes[int(np.nanargmax(fell))])


def picture(result: FitResult, values: NDArray[np.float64], cells: int) -> NDArray[np.float64]:
    """A map [row, fitted], 1/s, as a picture in noise sigmas."""
    return coarse(whole_range(result, values / result.noise), cells)


def wave_section(pair: BeforeAfter, title: str) -> str:
    """One pass: what was left, what the effect explains of it, what is left then; one color scale."""
    before, after, rows = pair.before.result, pair.after.result, rows_of(pair.before.result, pair.one)
    left, rest = before.unexplained(rows), after.unexplained(rows)
    parts = [picture(before, part, CELLS) for part in (left, left - rest, rest)]
    scale = color_scale(parts[0])
    names = ("Left by the model before", f"What changes with it: {title}", "Left with it in the model")
    drawn = wave_pictures(pair.before, pair.one, parts[:1], scale, PANEL)
    drawn += wave_pictures(pair.after, pair.one, parts[1:], scale, PANEL)
    figures = "".join(
        f"<figure><figcaption>{escape(name)}</figcaption>{one}</figure>" for name, one in zip(names, drawn, strict=True)
    )
    return (
        f"<section><h2>One vehicle, before and after</h2><p>{escape(pass_label(pair.one))}, the pass that gains most: "
        "time runs down, channels run along the fiber, the dotted line is the vehicle. What the model explains is "
        f'pale; all three pictures have one color scale.</p><div class="three">{figures}</div>'
        f'<div class="scale">{svg(scale_figure(scale, PANEL))}</div></section>'
    )


@styled
def corridor_figure(pair: BeforeAfter, names: tuple[str, str] = ("before", "after")) -> Figure:
    """Sideways place and depth with the 95 % corridor, before at left and after at right, in one frame and scale."""
    left, across, height = 56, 462, 190
    figure = canvas(1060, 2 * height + 110)
    runs = pair.before, pair.after
    straight = all(along_x(run.result.route) for run in runs)
    base = None if straight else pair.before.result.route
    places = [abscissa(run, straight) for run in runs]
    for row, name in enumerate(("Sideways", "Depth")):
        profiles = [depth_profile(run) if row else sideways_profile(run, base) for run in runs]
        whole = np.concatenate([one.band for one in profiles])
        pad = 0.08 * float(np.ptp(whole)) + 0.05
        for column, (run, profile) in enumerate(zip(runs, profiles, strict=True)):
            top = 24 + row * (height + 44)
            axes = place(figure, f"{name} {column}", left + column * (across + 70), top, across, height)
            draw_profile(axes, run, profile, straight)
            axes.set_title(f"{name}, {names[column]}")
            axes.set_xlim(padded(np.concatenate(places), 1.0))
            axes.set_ylim(float(whole.max()) + pad, float(whole.min()) - pad)
            axes.set_ylabel("z, m" if row else "y, m" if straight else "m right of the route at left")
            if row:
                axes.set_xlabel("x, m along the road" if straight else "distance along the fiber, m")
        axes.plot(places[0], profiles[0].value, color=MUTED, lw=1.2, ls=(0, (1, 2)), zorder=4)
    return figure


def route_section(pair: BeforeAfter, moved: float | None) -> str:
    """The route with both corridors."""
    way = "" if moved is None else f" With it the route moves by up to {moved:.2f} m."
    return (
        f"<section><h2>The route, before and after</h2><p>The band is each fit's own 95 % corridor, squares are "
        f"anchors; both sides have the same frame and scales. The dotted line at right is the route before.{way}</p>"
        f'<div class="wide-table">{svg(corridor_figure(pair))}</div></section>'
    )


def sureness_section(run: Run) -> str:
    """The corridor of a diagnosed run without and with what may be missing; "" where it has one alone."""
    if run.added is None or not run.corridor:
        return ""
    pair = BeforeAfter(replace(run, added=None), run, run.passes[0])
    figure = svg(corridor_figure(pair, ("nothing missing", "with what may be missing")))
    return (
        f"<section><h2>How sure the route is</h2><p>{escape(run.corridor)} At left the corridor takes the model for "
        "granted; at right every explanation moves the route by its own way, as probable as it is, and what vehicles "
        "disagree about beyond noise counts, too.</p>"
        f'<div class="wide-table">{figure}</div></section>'
    )


def signatures(pair: BeforeAfter, diagnosis: "Diagnosis") -> dict[str, str]:
    """Thumbnails of one pass: what the model leaves (`LEFT`), what each candidate changes, by name.

    As fitted in full, else as the score test predicts it.
    """
    result, rows = pair.before.result, rows_of(pair.before.result, pair.one)
    left = picture(result, result.unexplained(rows), THUMBNAIL)
    scale = color_scale(left)

    def thumbnail(image: NDArray[np.float64]) -> str:
        return data_uri(png_bytes(color_map()(scale(np.ma.masked_invalid(image)))))

    found = {LEFT: thumbnail(left)}
    for name, (fit, state) in diagnosis.fits.items():
        model = fit.model(state).numpy()
        if model.shape == result.model.shape:
            found[name] = thumbnail(picture(result, model[rows] - result.model[rows], THUMBNAIL))
    for name, change in diagnosis.predicted.items():
        if change.shape == result.model.shape:
            found[name] = thumbnail(coarse(whole_range(result, change[rows]), THUMBNAIL))
    return found
