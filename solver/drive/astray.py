"""Where a drive's answer may be wrong without looking so: stretches on which what should agree does not."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from solver.drive.path import MISTAKES, STEP
from solver.run.trust import Gate

if TYPE_CHECKING:
    from collections.abc import Sequence

    from solver.drive.channel_fit import Fit
    from solver.survey.anchors import Anchor

Array = NDArray[np.float64]

#: m by which channels in a row are off, and how many of them: no GPS drifts so far, no pick is so far from its place.
FAR, RUN = 10.0, 6
#: Probability beyond which a channel hears another vehicle in place of the car; their share at most.
LIKELY, MANY = 0.5, 0.15
#: Channels in a row that hear another vehicle, and m of path between two such runs, so that it may be one vehicle.
SOME, COMPANY = 3, 400.0
#: Standard deviations of the car's log amplitude by which it is louder than the car.
LOUDER = 1.5
#: Sigmas by which an anchor, or the length factor, is off.
OFF = 3.5


@dataclass(frozen=True)
class Astray:
    """Channels, as indices, of a stretch that is off by `size`, m."""

    first: int
    last: int
    size: float


def others_of(fit: "Fit") -> NDArray[np.bool_]:
    """Which channels beside the car hear another vehicle in its place [channel]."""
    return np.asarray(fit.beside & (fit.channels.other > LIKELY))


def longest_off(size: Array, there: NDArray[np.bool_]) -> Astray | None:
    """The run of `RUN` channels in a row, of those `there` [channel], that is farthest off, if by `FAR` m; `size` in m.

    >>> off = np.where(np.arange(40) // 8 == 2, 12.0, 1.0)
    >>> longest_off(off, np.ones(40, bool))
    Astray(first=16, last=23, size=12.0)
    >>> longest_off(off, np.arange(40) % 2 == 0) is None
    True
    """
    index = np.flatnonzero(there)
    far = size[index] >= FAR
    edges = np.flatnonzero(np.diff(np.concatenate([[False], far, [False]])))
    runs = [one for one in zip(edges[::2], edges[1::2], strict=True) if one[1] - one[0] >= RUN]
    if not runs:
        return None
    begin, end = max(runs, key=lambda one: float(size[index[one[0] : one[1]]].max()))
    return Astray(int(index[begin]), int(index[end - 1]), float(size[index[begin:end]].max()))


def places(fit: "Fit") -> Gate:
    """Whether the car is heard where its GPS has it, and both estimates of the channels' places agree."""
    legs = fit.legs.count
    audible = fit.picks.audible[:legs]
    straight = audible.any(0) & ~fit.channels.loop
    found = [longest_off(np.abs(fit.along.error[leg]) * STEP, audible[leg]) for leg in range(legs)]
    found.append(longest_off(np.abs(fit.channels.cell - fit.along.cell) * STEP, straight))
    worst = max((one for one in found if one is not None), key=lambda one: one.size, default=None)
    if worst is None:
        return Gate("places", "passed", "the car is heard where its GPS has it")
    first, last = fit.quiet.channel[[worst.first, worst.last]]
    return Gate(
        "places",
        "failed",
        f"on channels {first} to {last} what is heard is up to {worst.size:.0f} m from where the GPS has the car",
        (f"do not rely on channels {first} to {last}: another vehicle was taken for the car, or slack was missed",),
        found=worst.size,
        expected=FAR,
    )


def anchor_gate(fit: "Fit", anchors: "Sequence[Anchor]") -> list[Gate]:
    """Whether anchors, on recorded channels, are on the route that they and the car tell; nothing without any."""
    if not anchors:
        return []
    known = np.array([(one.x, one.y) for one in anchors])
    at = np.array([one.channel for one in anchors]) - float(fit.quiet.channel[0])
    told = (fit.cell, fit.aside.lateral, fit.sigma * STEP, fit.aside.sigma)
    cell, lateral, *sigmas = (np.interp(at, np.arange(len(fit.cell)), one) for one in told)
    number = np.clip(np.round(cell).astype(np.int64), 0, len(fit.path.points) - 1)
    axes = np.stack([fit.path.along[number], fit.path.across[number]], 1)
    sigma = np.hypot(np.stack(sigmas, -1), np.array([[one.sigma_xy] for one in anchors]))

    def missed(places: Array) -> tuple[Array, Array]:
        miss = places - fit.path.at(cell, lateral)
        return np.hypot(*miss.T), np.abs(np.einsum("nij,nj->ni", axes, miss) / sigma).max(1)

    distance, off = missed(known)
    wrong = np.flatnonzero(off > OFF).tolist()
    if not wrong:
        count = "1 anchor" if len(anchors) == 1 else f"{len(anchors)} anchors"
        return [Gate("anchors", "passed", f"{count} within {off.max():.1f} sigmas of the route")]
    words = ", ".join(
        f"anchor {anchors[i].name} {distance[i]:.0f} m off the route ({off[i]:.0f} sigmas)" for i in wrong
    )
    mended = [right for right, turn in MISTAKES.items() if (missed(known @ np.array(turn))[1] < OFF).all()]
    words += f", all on it if {' or if '.join(mended)}" if mended else ""
    mend = ("check the channels and coordinates of the anchors, and the frame of map and GPS",)
    return [Gate("anchors", "failed", words, mend, found=float(off.max()), expected=OFF)]


def between_others(fit: "Fit") -> list[tuple[int, int]]:
    """Runs of channels, first and last index, that may hear the vehicle that is heard before and behind them.

    A vehicle that keeps its distance is not told from the car by its place on one leg; on two, that agree, it is. The
    car is about as loud all the way.
    """
    other, audible = others_of(fit), fit.picks.audible[: fit.legs.count]
    count, loud = audible.sum(0), np.log(np.maximum(fit.picks.amplitude[: fit.legs.count], 1e-9))
    index = np.flatnonzero((other | (count > 0)) & ~fit.channels.loop & ~fit.quiet.dead)
    if not len(index):
        return []
    runs = np.split(index, np.flatnonzero(np.diff(other[index].astype(int))) + 1)
    found = []
    for before, one, after in zip(runs[:-2], runs[1:-1], runs[2:], strict=True):
        way = float(np.ptp(fit.cell[one])) * STEP
        alone = float(np.median(count[one])) < 2 and not other[one[0]]
        if alone and way <= COMPANY and len(one) >= RUN and min(len(before), len(after)) >= SOME:
            inside = np.zeros(len(count), bool)
            inside[one] = True
            mine, rest = loud[audible & inside], loud[audible & ~inside]
            if len(rest) > len(mine) and np.median(mine) - np.median(rest) > LOUDER * rest.std():
                found.append((int(one[0]), int(one[-1])))
    return found


def companions(fit: "Fit") -> Gate:
    """Whether no stretch lies between channels that hear another vehicle."""
    runs = between_others(fit)
    if not runs:
        return Gate("companions", "passed", "no stretch lies between channels that hear another vehicle")
    names = ", ".join(f"{fit.quiet.channel[first]} to {fit.quiet.channel[last]}" for first, last in runs)
    return Gate(
        "companions",
        "failed",
        f"before and behind channels {names} another vehicle is heard: it may have been taken for the car between, too",
        (f"do not rely on channels {names}; drive there again, or tap",),
        found=float(len(runs)),
        expected=0.0,
    )


def others(fit: "Fit") -> Gate:
    """Whether few channels hear another vehicle in place of the car."""
    there = fit.beside & ~fit.quiet.dead
    count, total = int((others_of(fit) & there).sum()), int(there.sum())
    few = count <= MANY * total
    return Gate(
        "other vehicles",
        "passed" if few else "failed",
        f"{count} of the {total} channels beside the car hear another vehicle in its place",
        ("drive again with less traffic; what these channels hear was not used",),
        found=count / max(total, 1),
        expected=MANY,
    )
