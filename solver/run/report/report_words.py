"""The report in words: where the fiber is, how sure that is, and what the data cannot say."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from solver.fit.result import TRUSTED
from solver.run.geojson import Z95, half_width, runs
from solver.run.run import Run
from solver.run.seen import Seen
from solver.run.trust import DIAGNOSIS
from solver.survey.limits import PUSHES

WINDS = ["N", "NNE", "NE", "ENE", "E", "ESE", "SE", "SSE", "S", "SSW", "SW", "WSW", "W", "WNW", "NW", "NNW"]

#: Verdict of a check -> how a page says it.
VERDICTS = {"passed": "passed", "failed": "<b>failed</b>", "open": "not checked"}


def wind(azimuth: float) -> str:
    """Name of the compass direction nearest to `azimuth`, degrees clockwise from north.

    >>> wind(78.0), wind(-5.0)
    ('ENE', 'N')
    """
    return WINDS[round(azimuth / 22.5) % 16]


def counted(number: int, noun: str) -> str:
    """Number and noun.

    >>> counted(1, "gap"), counted(2, "gap")
    ('1 gap', '2 gaps')
    """
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def lateral(y: float) -> str:
    """Lateral position in words, y in meters to the right.

    >>> lateral(-1.234)
    '1.23 m left'
    """
    return f"{abs(y):.2f} m {'right' if y >= 0 else 'left'}"


def lengths(low: float, high: float) -> str:
    """Two lengths, m, as one where they agree.

    >>> lengths(11.5, 11.5), lengths(9.8, 10.4)
    ('11.50', '9.80 to 10.40')
    """
    first, last = f"{low:.2f}", f"{high:.2f}"
    return first if first == last else f"{first} to {last}"


def span(low: float, high: float) -> str:
    """Two lateral positions, m, as one where they agree within half a meter.

    >>> span(-4.0, 4.5), span(3.3, 4.3)
    ('4.00 m left to 4.50 m right', '3.30 to 4.30 m right')
    """
    if high - low < 0.5:
        return lateral((low + high) / 2)
    near, far = sorted((low, high), key=abs)
    first = f"{abs(near):.2f}" if low * high > 0 else lateral(near)
    return f"{first} to {lateral(far)}"


def trusted(run: Seen) -> bool:
    """Whether no check of the fit failed."""
    return run.facts["trust"]["grade"] in TRUSTED


def headline(run: Run) -> str:
    """Where the fiber is, in one sentence; where a check failed, where the fit puts it."""
    y, z = run.result.route[:, 1], run.result.route[:, 2]
    place = f"{span(float(y.min()), float(y.max()))} of the survey line, about {z.mean():.2f} m below the road"
    if not trusted(run):
        return f"The fit puts the fiber {place}, but does not pass every check."
    sure = "" if run.result.constrained.mean() > 0.5 else "probably "
    return f"The fiber {sure}runs {place}."


def widest(half: NDArray[np.float64]) -> str:
    """Largest half-width as ± meters, or that there is none."""
    return f"± {np.max(half):.2f} m" if len(half) and np.isfinite(half).all() else "not stated"


def noise_words(run: Run) -> str:
    """What of the misfit noise alone leaves."""
    gate = next(one for one in run.facts["trust"]["gates"] if one["name"] == "misfit")
    if gate["expected"] is None:
        return "what noise alone leaves is not known"
    return str(gate["words"].partition(" where ")[2])


def key_figures(run: Run) -> list[tuple[str, str, str]]:
    """Figures at the top: label, value, what it means."""
    result = run.result
    half = half_width(result.route, run.place.covariance)
    depth = Z95 * run.place.sigma[:, 2]
    length = float(result.distance[-1] - result.distance[0])
    where, share = result.constrained, float(result.constrained.mean())
    whole = "" if share == 1 else f"of {length:.0f} m, "
    note = "at the least certain place" + ("" if where.all() else " that the data decide")
    if not where.any():
        note = "no place is located"
    elif not trusted(run):
        note = "not to be relied on: a check failed"
    return [
        ("Located", f"{length * share:.0f} m", f"{whole}channels {result.channel[0]} to {result.channel[-1]}"),
        ("Sideways, 95 %", widest(half[where]), note),
        ("Depth, 95 %", widest(depth[where]), note),
        ("Misfit, chi²/dof", f"{result.chi2_per_dof:.3f}", noise_words(run)),
    ]


def stretches(run: Run, flags: NDArray[np.bool_]) -> str:
    """Channels where `flags` [channel] is true, in words."""
    result = run.result
    if flags.all():
        return "all along"
    parts = [(result.channel[a], result.channel[b]) for a, b in runs(flags) if flags[a]]
    named = ", ".join(f"{a}" if a == b else f"{a} to {b}" for a, b in parts[:4])
    return f"at channels {named}" + (" and elsewhere" if len(parts) > 4 else "")


def held(run: Run) -> str:
    """What the corridor holds."""
    if not run.result.converged:
        return "The fit has not converged: where it stopped has no corridor."
    if run.added is None:
        return (
            "If the model holds, the corridor holds the fiber at any one place in 95 of 100 surveys like this one."
            + shared_words(run)
        )
    if run.facts["corridor"]["why"]:
        return "The corridor is as wide as vehicles disagree about the route. What moves it alike for all is not in it."
    return (
        "At any one place the corridor should hold the fiber in 95 of 100 surveys like this one, also where the model "
        "lacks an effect of the catalogue; the darker band within it should if the model lacks nothing."
        + shared_words(run)
    )


def shared_words(run: Run) -> str:
    """That places err together, after a space; nothing where that is not known."""
    if run.result.shared is None:
        return ""
    across, down = (f"{100 * share:.0f} %" for share in run.result.shared)
    return (
        f" Places err together: of what the fit may be off, all share {across} of the variance of y and {down} of that "
        "of the depth. So where a survey is off, it is off over long stretches."
    )


def sure(run: Run) -> str:
    """What the corridor is made of, and what follows, with commands between backticks."""
    if run.added is None:
        return "A corridor that takes the model for granted is too narrow wherever something is missing in it."
    if run.facts["corridor"]["why"]:
        return "Where vehicles disagree about the route by more than noise explains, something is wrong with the model."
    how = (
        "Every effect of the catalogue was tested on what the fit leaves. Each may move the route in its own way: as "
        "far as it shows, as probable as it is, and as far as one that is too small to show could. How far vehicles "
        "disagree about the route beyond noise widens the corridor, too."
    )
    if any(one["name"] == DIAGNOSIS for one in run.facts["trust"]["gates"]):
        return f"{how} This is what `roadfiber diagnose RUN` found, which fits the best in full."
    return (
        f"{how} That is a quick look, enough for a corridor: `roadfiber diagnose RUN` fits the best in full, and may "
        "name another."
    )


def prior_lines(run: Run) -> list[str]:
    """Lines on what the priors decided."""
    result, lines = run.result, []
    loose = ~result.constrained
    if not result.converged:
        lines.append("The fit has not converged: no uncertainty is known of where it stopped.")
    elif loose.any():
        lines.append(
            "Sideways, the expected smoothness of a cable decides more than vehicles and anchors do, or the model does "
            f"not explain what vehicles leave, {stretches(run, loose)}: dashed in the map."
        )
    depth = run.facts["settings"]["depth"]
    assumed = f"the assumed {depth[0]:g} ± {depth[1]:g} m, Poisson ratio and smoothness"
    guessed = result.data_share[:, 2] < 0.5
    if guessed.any():
        lines.append(f"Depth: {assumed} decide more than the data do, {stretches(run, guessed)}.")
    guessed = result.data_share[:, 0] < 0.5
    if guessed.any():
        lines.append(
            f"Along the road, assumptions on fiber length and vehicle position decide more than the data do, "
            f"{stretches(run, guessed)}."
        )
    return lines


def unnatural(run: Run) -> list[str]:
    """That vehicles strain the ground less, or more, than any vehicle does; nothing where they do not."""
    sizes = [abs(value.value) for name, value in run.result.parameters.items() if name.startswith("amplitude")]
    size = float(np.median(sizes)) if sizes else PUSHES[0]
    if PUSHES[0] <= size <= PUSHES[1]:
        return []
    how = "less" if size < PUSHES[0] else "more"
    return [
        f"These vehicles strain the ground {how} than any vehicle can (amplitudes of {size:.1g} m²): check the unit of "
        "the DAS files, and quantity and scale in [das] of site.toml."
    ]


def cautions(run: Run) -> list[str]:
    """What the user must know besides the checks before relying on the route; empty where there is nothing."""
    result, lines = run.result, prior_lines(run)
    lines += unnatural(run)
    if result.converged and not np.isfinite(result.covariance).all():
        lines.append(f"The method {result.method!r} states no uncertainty here.")
    missing = set(range(result.fitted_channel[0], result.fitted_channel[-1] + 1)) - set(result.fitted_channel.tolist())
    if missing:
        lines.append(f"{counted(len(missing), 'channel')} within the range gave no data.")
    if result.corners:
        lines.append(f"The fiber {'; it '.join(one.words for one in result.corners)}.")
    return lines


def told(run: Run) -> Run:
    """The run with its headline and all its warnings in its facts, for whoever shows them."""
    return replace(
        run, facts=run.facts | {"headline": headline(run), "warnings": [*cautions(run), *run.facts["notes"]]}
    )
