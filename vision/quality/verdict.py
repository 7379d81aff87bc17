"""Which setting to use, and whether it is good enough for the fiber: in words."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vision.jitter import LIMIT
from vision.quality.measures import Measures
from vision.quality.route_effect import FEWEST

GRADES = ("good", "fair", "weak", "poor")
AS_GOOD = 0.1  # relative difference of two effects on the route that counts as equal
Z95 = 1.96  # standard deviations that hold 95 %
MOST = 0.5  # share of bins beyond the limit that makes a setting poor

RULES = {  # by what is known of the tables; each describes what `judge` does
    "truth": "the highest HOTA against the truth, to three digits; of equal ones the higher MOTA; then the first given",
    "meters": (
        f"the best grade by the {100 * LIMIT:.0f} cm rule; of these the least effect on the route, a tenth more being "
        "as good; of these the least jitter; then the first given"
    ),
    "pixels": "the longest run of frames without a miss, mean over the tracks; then the first given",
}


@dataclass(frozen=True)
class Verdict:
    """What to do.

    Parameters
    ----------
    use : name of the setting to use
    because : why that one
    rule : by which it was chosen
    grade : good, fair, weak or poor for the fiber; unknown without meters
    words : what that means
    """

    use: str
    because: str
    rule: str
    grade: str
    words: str


def grade(measures: Measures) -> str:
    """Grade a setting by the 35 cm rule, over the bins with ten fixes or more, and by its effect on the route.

    good: mean plus standard deviation of the jitter stays below 35 cm in all; fair: the mean does; weak: it does not in
    some, or the predicted effect on the route, sideways or along the road, is above 35 cm at 95 %; poor: the mean is
    above in most. Unknown in pixels, and where no bin has fixes enough.
    """
    bins = measures.after[measures.after["fixes"] >= FEWEST]
    if measures.setting.unit != "m" or bins.empty:
        return "unknown"
    beyond = float((bins["mean"] > LIMIT).mean())
    if beyond > 0:
        return "poor" if beyond > MOST else "weak"
    if max(typical_effect(measures), typical_effect(measures, "x")) * Z95 > LIMIT:
        return "weak"
    return "good" if ((bins["mean"] + bins["sd"]) <= LIMIT).all() else "fair"


def typical_effect(measures: Measures, axis: str = "y") -> float:
    """Median over the bins of what the stated sigmas do to the route along an axis, m; without them, of noise alone."""
    if measures.effect is None:
        return float("nan")
    passed = measures.effect[measures.effect["passes"] > 0]
    stated = passed[f"stated_{axis}"].dropna()
    values = stated if len(stated) else passed[f"route_{axis}"].dropna()
    return float(values.median()) if len(values) else float("nan")


def judge(all_measures: Sequence[Measures]) -> Verdict:
    """Choose by the rule of `RULES` that applies.

    Parameters
    ----------
    all_measures : of every setting, all in one unit
    """
    if all(m.scores for m in all_measures):
        best = max(all_measures, key=lambda m: (round(m.scores.hota, 3), m.scores.mota) if m.scores else (0.0, 0.0))
        rule, because = RULES["truth"], "it agrees best with the truth (HOTA)"
    elif all_measures[0].setting.unit == "m":
        best = least_harm(all_measures)
        rule, because = RULES["meters"], "of those that move the route least it has the least jitter"
    else:
        best = max(all_measures, key=lambda m: m.mean_fragment)
        rule = RULES["pixels"]
        because = "it follows vehicles longest without a miss; with a calibration, meters would decide"
    if len(all_measures) == 1:
        because = "it is the only one given"
    grade_of_best = grade(best)
    return Verdict(best.setting.name, because, rule, grade_of_best, words(best, grade_of_best))


def least_harm(all_measures: Sequence[Measures]) -> Measures:
    """Return, of the settings of the best grade that move the route least, within a tenth, the one of least jitter."""
    order = {name: place for place, name in enumerate((*GRADES, "unknown"))}
    top = min(order[grade(m)] for m in all_measures)
    alike = [m for m in all_measures if order[grade(m)] == top]
    effect = np.nan_to_num([typical_effect(m) for m in alike], nan=np.inf)
    near = [m for m, size in zip(alike, effect, strict=True) if size <= (1 + AS_GOOD) * effect.min()]
    return min(near, key=lambda m: float(np.nan_to_num(m.jitter, nan=np.inf)))


def words(measures: Measures, name: str) -> str:
    """Say what a grade means."""
    centimeters = f"{100 * LIMIT:.0f} cm"
    if measures.setting.unit != "m":
        return "Without a calibration nothing is in meters; calibrate the camera to judge jitter and route."
    if name == "unknown":
        return "No stretch of road has fixes enough to judge; film longer."
    bins = measures.after[measures.after["fixes"] >= FEWEST]
    effect = effect_words(measures)
    if name == "good":
        return f"Good enough for the fiber: jitter stays below {centimeters} all along the view. {effect}"
    if name == "fair":
        return f"Good enough for the fiber: mean jitter is below {centimeters}, single fixes exceed it. {effect}"
    over = bins[bins["mean"] > LIMIT]
    if over.empty:
        return f"Too few vehicles for the fiber, though jitter is below {centimeters}: film longer. {effect}"
    where = ", ".join(f"{low:.0f} to {high:.0f}" for low, high in stretches(list(over["low"]), list(over["high"])))
    if name == "weak":
        return (
            f"Usable in part: jitter exceeds {centimeters} at x = {where} m; leave this out, or film nearer. {effect}"
        )
    return f"Not good enough for the fiber: jitter exceeds {centimeters} at x = {where} m, most of the view. {effect}"


def effect_words(measures: Measures) -> str:
    """Say what positions do to the route: jitter, what the vehicles' sizes and visible faces leave open, and bias.

    Comparing the two directions would not show the last: on six rendered views, with three detectors, the vehicles of a
    class are placed 0.34 m (root mean square) toward the camera or away from it in both directions, and that does not
    follow what the lengths fitted in each differ by (correlation 0.26).
    """
    sideways, along = (Z95 * typical_effect(measures, axis) for axis in "yx")
    said = (
        f"Positions leave the route uncertain by ± {sideways:.2f} m sideways and ± {along:.2f} m along the road (95 %)"
    )
    tracks = measures.setting.tracks
    if "sigma_x" not in tracks:
        return f"{said} by jitter alone: the tracks state no sigma, which errors common to all fixes of a vehicle need."
    alike = f"± {Z95 * tracks['sigma_x'].median():.2f} m where all vehicles err alike, as those that show one face do"
    return (
        f"{said}; along the road by up to {alike}: toward the camera or away from it, whichever way they drive, which "
        "these tracks alone cannot show."
    )


def stretches(low: Sequence[float], high: Sequence[float]) -> list[tuple[float, float]]:
    """Join neighboring bins.

    >>> stretches([0, 1, 5], [1, 2, 6])
    [(0, 2), (5, 6)]
    """
    joined: list[tuple[float, float]] = []
    for a, b in zip(low, high, strict=True):
        if joined and np.isclose(joined[-1][1], a):
            joined[-1] = (joined[-1][0], b)
        else:
            joined.append((a, b))
    return joined
