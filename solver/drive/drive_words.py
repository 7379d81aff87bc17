"""What a located drive says in words: its headline, whether it may be relied on, and what to look at next."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from solver.drive.astray import OFF, anchor_gate, companions, others, others_of, places
from solver.drive.coarse import LEAD
from solver.drive.loops import flags_of
from solver.drive.misstated_words import as_stated
from solver.drive.path import STEP
from solver.run.trust import Gate
from vision.contract.rounding import with_sigma

if TYPE_CHECKING:
    from collections.abc import Sequence

    from solver.drive.channel_fit import Fit
    from solver.survey.anchors import Anchor

#: Share of the channels beside the car that hear it in a good drive.
MOST = 0.5
#: s; a clock less sure than this moves channels by more than a car's length.
CLOCK = 0.3
#: s, standard deviation of a clock beyond which it may well be off by 0.1 s, by which a car goes a meter.
SET = 0.06
#: Share of picks that disagree with their neighbors at most.
STRAY = 0.25
#: m of path without the car that are worth a word, and stretches that are named.
GAP, NAMED = 60.0, 6
#: Probability of slack beyond which a channel lies in some.
COILED = 0.5
#: Standard deviations by which slack is told; share of a way by which cable beside it may be longer.
SURE, LOOSE = 3.0, 0.02


@dataclass(frozen=True)
class Unheard:
    """A stretch whose channels do not hear the car.

    Parameters
    ----------
    first, last : index
    begin, end : m along the map
    beside : whether the car drove beside it
    other : whether another vehicle is heard there in its place
    """

    first: int
    last: int
    begin: float
    end: float
    beside: bool
    other: bool


def constrained_of(fit: "Fit") -> NDArray[np.bool_]:
    """Which channels the drive decides: those among the ones that hear the car, and within two gauges of them."""
    heard = np.flatnonzero(fit.audible)
    found = np.zeros(len(fit.cell), bool)
    if len(heard):
        # Along the path, so that a loop is as near to both its ends as they are to one another.
        order = np.sort(fit.cell[heard])
        after = np.clip(np.searchsorted(order, fit.cell), 0, len(order) - 1)
        away = np.minimum(np.abs(order[after] - fit.cell), np.abs(fit.cell - order[np.maximum(after - 1, 0)]))
        found = away * STEP <= 2 * fit.quiet.gauge_length
        # Beyond the outermost, cable may as well be coiled where it begins.
        found[: heard[0]] = found[heard[-1] + 1 :] = False
    # Slack that no channel beside it confirms may lie anywhere, or be cable beyond the drive.
    found &= flags_of(fit.loops, len(found)) | (fit.channels.in_loop <= COILED)
    return np.asarray(found & (fit.sigma * STEP < 10.0))


def unheard_of(fit: "Fit", constrained: NDArray[np.bool_]) -> list[Unheard]:
    """Stretches along the map that the drive does not decide, the longest first."""
    along = (fit.cell - fit.path.first) * STEP
    there = ~constrained & (along > 0) & (along < fit.path.length)
    index = np.flatnonzero(there)
    found = []
    for run in np.split(index, np.flatnonzero(np.diff(index) > 1) + 1) if len(index) else []:
        first, last = int(run[0]), int(run[-1])
        begin, end = float(along[first]), float(along[last])
        if end - begin >= GAP:
            beside, other = (bool(one[run].mean() > 0.5) for one in (fit.beside, others_of(fit)))
            found.append(Unheard(first, last, begin, end, beside, other))
    return sorted(found, key=lambda one: one.begin - one.end)


def slack_of(fit: "Fit", stretch: Unheard) -> tuple[float, float]:
    """Cable on a stretch beyond the way along it, m, loops that were found left out, and its standard deviation."""
    before, after = stretch.first - 1, stretch.last + 1
    if before < 0 or after >= len(fit.cell):
        return 0.0, np.inf
    cable = (after - before) * fit.quiet.channel_spacing
    cable -= sum(one.length for one in fit.loops if before < one.first and one.last < after)
    way = float(fit.cell[after] - fit.cell[before]) * STEP
    ends = float(np.hypot(fit.sigma[before], fit.sigma[after])) * STEP
    factor = 1 / (1 + float(fit.along.stretch[[before, after]].mean()))
    return cable - way * factor, float(np.hypot(ends, LOOSE * way))


def headline(fit: "Fit", constrained: NDArray[np.bool_]) -> str:
    """Where the fiber is, in a sentence."""
    if not constrained.any():
        return "no channel was located"
    sigma = np.sqrt(np.median(fit.sigma[constrained] ** 2)) * STEP
    way = float(np.ptp(fit.cell[constrained])) * STEP / 1e3
    loops = len(fit.loops)
    slack = f"{loops} loop{'s' * (loops != 1)} of slack found" if loops else "no loop of slack found"
    clock = ""
    if fit.clock_sigma > SET:
        clock = f"; the clock is known to ± {1.96 * fit.clock_sigma:.1f} s (95 %)"
        clock += ": a drive back would settle it" * (not fit.both_ways)
    return (
        f"{constrained.sum()} of {len(fit.cell)} channels located along {way:.2f} km, 1 sigma {sigma:.1f} m along the "
        f"path; {slack}{clock}"
    )


def clock_words(fit: "Fit") -> str:
    """How far the clocks are apart."""
    way = "ahead of" if fit.clock.offset > 0 else "behind"
    once = (
        ""
        if fit.both_ways
        else "; the car was heard one way, so that only its stops and speeds tell it from a shift, as far as its GPS "
        "tells these"
    )
    return f"the record's clock is {with_sigma(abs(fit.clock.offset), fit.clock_sigma)} s {way} the GPS's{once}"


def factor_of(fit: "Fit", prior: tuple[float, float]) -> tuple[float, float]:
    """Meters of cable per meter of map, loops left out, over what is heard; and its standard deviation."""
    heard = fit.audible
    if heard.sum() < 2:
        return prior
    mean = float(prior[0] / (1 + fit.along.stretch[heard].mean()))
    first, last = np.flatnonzero(heard)[[0, -1]]
    way = max(1.0, float(fit.cell[last] - fit.cell[first]) * STEP)
    return mean, float(np.hypot(fit.sigma[first], fit.sigma[last]) * STEP / way)


def gates_of(fit: "Fit", prior: tuple[float, float], anchors: "Sequence[Anchor]") -> list[Gate]:
    """The checks of a drive."""
    heard = float(fit.audible[fit.beside & ~fit.quiet.dead].mean()) if fit.beside.any() else 0.0
    audible = fit.picks.audible[: fit.legs.count]
    stray = float((fit.along.weight[: fit.legs.count][audible] < 0.999).mean()) if audible.any() else 1.0
    factor, _ = factor_of(fit, prior)
    off = abs(factor - prior[0]) / prior[1]
    return [
        Gate(
            "converged",
            "passed" if fit.converged else "failed",
            "the clock stands still" if fit.converged else "the clock did not come to rest",
            ("check the GPS track and the length factor",),
        ),
        Gate(
            "heard",
            "passed" if heard >= MOST else "failed",
            f"{100 * heard:.0f} % of the channels beside the car hear it",
            ("see which stretches are not heard; drive again slowly, or in another lane",),
            found=heard,
            expected=MOST,
        ),
        Gate(
            "clock",
            "passed" if fit.clock_sigma < CLOCK else "failed",
            clock_words(fit),
            ("drive with stops or a U-turn, which tell the clock from the place",),
            found=fit.clock_sigma,
            expected=CLOCK,
        ),
        Gate(
            "picks",
            "passed" if stray < STRAY else "failed",
            f"{100 * (1 - stray):.0f} % of the picks agree with their neighbors",
            ("see the misfit along the path; check the GPS track and the channel spacing",),
            found=stray,
            expected=STRAY,
        ),
        Gate(
            "length",
            "passed" if off < OFF else "failed",
            f"{factor:.3f} m of cable per m of map",
            ("check the channel spacing and length_factor in [route]",),
            found=factor,
            expected=prior[0],
            scatter=prior[1],
        ),
        second_leg(fit),
        rival(fit),
        places(fit),
        *anchor_gate(fit, anchors),
        others(fit),
        companions(fit),
        as_stated(fit.misstated, fit.stated),
    ]


def rival(fit: "Fit") -> Gate:
    """Whether any other clock offset explains the record nearly as well."""
    clear, lead = fit.coarse.told_apart, fit.coarse.lead
    return Gate(
        "other offsets",
        "passed" if clear else "failed",
        "no other clock offset explains the record as well"
        if clear
        else "another clock offset explains the record nearly as well",
        ("drive again with less traffic, with stops and a U-turn; or give an anchor",),
        found=lead if np.isfinite(lead) else float("nan"),
        expected=LEAD,
    )


def second_leg(fit: "Fit") -> Gate:
    """Whether passes of one place agree; open where it was passed once."""
    audible = fit.picks.audible[: fit.legs.count]
    both = audible.sum(0) >= 2
    if both.sum() < 5:
        return Gate("passes", "open", "whether two passes of one place agree, as none was driven twice")
    off = np.where(audible, fit.along.residual[: fit.legs.count] / fit.picks.sigma[: fit.legs.count], np.nan)[:, both]
    size = float(np.nanmedian(np.abs(off)) / 0.6745)
    return Gate(
        "passes",
        "passed" if size < 2 else "failed",
        f"passes of one place agree within {size:.1f} of their sigmas",
        ("see the misfit along the path",),
        found=size,
        expected=1.0,
    )


def advice(fit: "Fit", unheard: list[Unheard]) -> list[str]:
    """What a second drive or a tap test should look at, a line each."""
    channel = fit.quiet.channel
    lines = []
    for one in unheard[:NAMED]:
        where = f"channels {channel[one.first]} to {channel[one.last]}, {one.begin / 1e3:.2f} to {one.end / 1e3:.2f} km"
        middle = channel[(one.first + one.last) // 2]
        if one.other:
            lines.append(
                f"{where}: another vehicle is heard in place of the car; drive again with less traffic, or tap near "
                f"channel {middle}"
            )
        elif one.beside:
            lines.append(
                f"{where}: the car drove beside the map and nothing was heard: the fiber may run elsewhere, lie in a "
                f"duct that is decoupled, or be coiled; a tap test near channel {middle} tells"
            )
        else:
            lines.append(f"{where}: the car was not beside the map; drive there, or tap near channel {middle}")
        slack, sigma = slack_of(fit, one)
        if slack > SURE * sigma:
            lines[-1] += f". {slack:.0f} ± {sigma:.0f} m of slack lie somewhere on them"
    if len(unheard) > NAMED:
        lines.append(
            f"{len(unheard) - NAMED} more stretches are not heard; route.csv has them (`constrained` is false)"
        )
    side = float(np.median(fit.aside.sigma[fit.audible])) if fit.audible.any() else 0.0
    if side > 2.0:
        lines.append(
            "on which side of the road the fiber lies is not decided: where the car drove in one lane the map alone "
            f"tells it, and across the road the fiber is known to {side:.1f} m (1 sigma); a second drive in the other "
            "direction, two lanes away, would decide it"
        )
    if fit.clock_sigma > SET:
        lines.append(
            "a drive back along the same road, or with more stops, would set the clock"
            if not fit.both_ways
            else "a longer drive back, or more stops, would set the clock"
        )
    return lines
