"""The search for regions that fail: each is explained by the simplest change that removes most of it."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from solver.criticism.comparison.cells import SLOWEST, Cells
from solver.criticism.comparison.regions import Region
from solver.criticism.comparison.unseen import unseen_windows
from solver.criticism.comparison.windows import Window, fitted, gain_statistic, looked_at, summed, threshold, widest
from solver.run.run import Run

Array = NDArray[np.float64]

#: Probability that noise makes any region, shared by the scans of changes, of power, and of power far from vehicles.
FALSE_ALARM = 0.04
MOST, TRIED = 10, 24
STEPS = 4  # most that an estimate takes
#: Width of the bins of distance ahead, m, and how far they reach.
AHEAD, AROUND = 2.5, 25.0


def groups_of(run: Run, cells: Cells) -> list[NDArray[np.int64]]:
    """Passes that may fail alike: all, those of one direction or class, and each for itself."""
    count = len(run.passes)
    classes = np.array([one.vehicle_class for one in run.passes])
    masks = [np.ones(count, bool), cells.approach.forward, ~cells.approach.forward]
    masks += [classes == name for name in sorted(set(classes.tolist()))]
    found = {tuple(np.flatnonzero(mask).tolist()) for mask in masks if mask.any()} | {(i,) for i in range(count)}
    return [np.array(group) for group in sorted(found, key=lambda group: (-len(group), group))]


def by_pass(values: Array, at: NDArray[np.int64], owner: NDArray[np.int64], shape: tuple[int, int]) -> Array:
    """Sums [pass, position] of cells' values by their pass and position; either below 0 leaves a cell out."""
    use = (owner >= 0) & (at >= 0)
    return np.asarray(np.bincount(owner[use] * shape[1] + at[use], values[use], shape[0] * shape[1]), float).reshape(
        shape
    )


@dataclass
class Search:
    """The search for regions in one run; `residual` and `open` [sample, channel] are what is not yet explained.

    Parameters
    ----------
    run, cells : what is searched
    groups : of passes that may fail alike
    residual : whitened
    open : bool, still counted in the scans of power
    """

    run: Run
    cells: Cells
    groups: list[NDArray[np.int64]]
    residual: Array
    open: NDArray[np.bool_]

    @property
    def columns(self) -> NDArray[np.int64]:
        """Index of the channel of each cell [sample, channel]."""
        return np.broadcast_to(np.arange(self.residual.shape[1]), self.residual.shape)

    @property
    def bins(self) -> NDArray[np.int64]:
        """Bin of distance ahead of each cell [sample, channel], -1 beyond."""
        index = np.floor((np.nan_to_num(self.cells.approach.ahead, nan=np.inf) + AROUND) / AHEAD)
        return np.where((index >= 0) & (index < round(2 * AROUND / AHEAD)), index, -1).astype(int)

    def within(self, window: Window, at: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Cells of a window whose positions are `at`."""
        own = np.isin(self.cells.approach.owner, self.groups[window.group])
        return own & (at >= window.first) & (at <= window.last)

    # ---- changes: gain, delay, place, offset -------------------------------------------------------------------------

    def change_sums(self, field: Array) -> tuple[Array, Array]:
        """Running sums of score and information of a change, by group and channel."""
        shape = (len(self.run.passes), self.residual.shape[1])
        owner, where = self.cells.approach.owner, self.columns
        level = self.cells.level  # the noise as it is, so that a level that was told too low makes no region
        score, information = (
            by_pass(p, where, owner, shape) for p in (field * self.residual / level, field**2 / level)
        )
        return summed(score, self.groups), summed(information, self.groups)

    def change(self) -> tuple[str, Window] | None:
        """The change that stands out most; None where noise could have made it."""
        fields = {name: getattr(self.cells, name) for name in ("gain", "late", "place", "offset")}
        limit = threshold(2 * len(fields) * looked_at(len(self.groups), self.residual.shape[1]), FALSE_ALARM / 3)
        found = {}
        for name, field in fields.items():
            sums = self.change_sums(field)
            if name == "place":
                # For traffic in one direction a shift along the fiber equals a delay, and is reported as one.
                sums = sums[0] * self.both_ways, sums[1]
            if name == "offset":
                sums = sums[0], sums[1] * self.slow  # larger information, smaller statistic
            found[name] = fitted(widest(sums, power=False), sums, power=False)
        name = max(found, key=lambda key: found[key].z)
        return (name, found[name]) if found[name].z > limit else None

    @cached_property
    def both_ways(self) -> Array:
        """Which groups [group, 1] have passes that go up and down the channels, or are all there are: 1, else 0."""
        forward = self.cells.approach.forward
        mixed = [len(g) > 1 and (len(set(forward[g])) == 2 or len(g) == len(forward)) for g in self.groups]
        return np.array(mixed, float)[:, None]

    @cached_property
    def slow(self) -> float:
        """Variance of offsets over what the noise's law predicts: no noise is quite stationary.

        From the quartiles over channels, of all passes together and of each.
        """
        ratios = [1.0]
        for part in zip(*self.change_sums(self.cells.offset), strict=True):
            score, information = (np.diff(values) for values in part)
            low, high = np.quantile(gain_statistic(score, information), [0.25, 0.75])
            ratios.append(((high - low) / 1.349) ** 2)
        return float(max(ratios))

    def take_change(self, name: str, window: Window) -> Region:
        """Estimate a change by least squares (Gauss and Newton), and take what it explains out of the residual."""
        cells, where = self.cells, self.within(window, self.columns)
        change, amount = cells.changes[name], 0.0
        for _ in range(STEPS):
            column = self.exactly(change.slope(amount), where)
            information = float((column**2).sum())
            left = self.residual - self.exactly(change.by(amount), where)
            step = float((column * left).sum()) / information
            amount += step
            if abs(step) < 0.1 * np.sqrt(cells.floor / information):
                break
        before = float((self.residual**2).sum())
        self.residual = self.residual - self.exactly(change.by(amount), where)
        return replace(
            self.region(name, window, where),
            channels=self.channels(window.first, window.last),
            x=self.place(window.first, window.last),
            amount=amount,
            sigma=float(np.sqrt(cells.floor / information)),
            chi2=before - float((self.residual**2).sum()),
        )

    def exactly(self, raw: Array, where: NDArray[np.bool_]) -> Array:
        """What a change [sample, channel] in some cells alone does to the whitened data [sample, channel]."""
        return self.cells.whiten(np.where(where, raw, 0.0), slice(None))

    # ---- power -------------------------------------------------------------------------------------------------------

    def power_sums(self, at: NDArray[np.int64], size: int) -> tuple[Array, Array]:
        """Running sums of energy and degrees of freedom near vehicles, by group and position."""
        cells = self.cells
        use = np.where(self.open & cells.approach.near, at, -1)
        shape = (len(self.run.passes), size)
        energy = by_pass(self.residual**2 / cells.level, use, cells.approach.owner, shape)
        number = by_pass(np.ones_like(self.residual), use, cells.approach.owner, shape)
        return summed(energy / cells.spread, self.groups), summed(number / cells.spread, self.groups)

    def power(self) -> Region | None:
        """Where near vehicles, by channel or by distance ahead, most power is left; it is then no longer counted."""
        plans = {
            "power": (self.columns, self.residual.shape[1]),
            "shape": (self.bins, int(self.bins.max(initial=0)) + 1),
        }
        windows = sum(looked_at(len(self.groups), size) for _, size in plans.values())
        limit = threshold(windows, FALSE_ALARM / 3)
        found = {}
        for name, (at, size) in plans.items():
            sums = self.power_sums(at, size)
            found[name] = fitted(widest(sums, power=True), sums, power=True)
        name = max(found, key=lambda key: found[key].z)
        if found[name].z <= limit:
            return None
        window, at = found[name], plans[name][0]
        where = self.within(window, at) & self.open & self.cells.approach.near
        region = self.closed(self.region(name, window, where), where)
        if name == "power":
            x = self.place(window.first, window.last)
            return replace(region, channels=self.channels(window.first, window.last), x=x)
        ends = (window.first * AHEAD - AROUND, (window.last + 1) * AHEAD - AROUND)
        return replace(region, ahead=ends)

    def closed(self, region: Region, where: NDArray[np.bool_]) -> Region:
        """The region with its power; its cells no longer count."""
        number = int((where & self.cells.there).sum())
        energy = float((self.residual[where] ** 2).sum())
        self.open = self.open & ~where
        level, spread = self.cells.floor, self.cells.spread
        sigma = level * np.sqrt(2 * spread / max(number, 1))
        return replace(region, amount=energy / max(number, 1), sigma=sigma, chi2=energy - level * number)

    def unseen(self) -> list[Region]:
        """Where far from all known vehicles power is left."""
        regions = []
        for patch in unseen_windows(self.residual, self.open, self.cells, self.run, FALSE_ALARM / 3):
            where = patch.where & self.open
            rows = np.flatnonzero(where.any(1))
            bare = self.region("unseen", Window(0, *patch.columns, patch.z), where)
            seconds = (float(self.run.time[rows[0]]), float(self.run.time[rows[-1]]))
            region = replace(bare, passes=(), every_pass=False, time=seconds, speed=patch.speed)
            regions.append(self.closed(region, where))
        return regions

    # ---- words' raw material -----------------------------------------------------------------------------------------

    def channels(self, first: int, last: int) -> tuple[int, int]:
        """Numbers of channels by their indices."""
        fitted_channel = self.run.result.fitted_channel
        return int(fitted_channel[first]), int(fitted_channel[last])

    def place(self, first: int, last: int) -> tuple[float, float]:
        """Meters of x at channels of these indices."""
        result = self.run.result
        at = np.searchsorted(result.channel, result.fitted_channel[[first, last]])
        return float(result.route[at[0], 0]), float(result.route[at[1], 0])

    def region(self, kind: str, window: Window, where: NDArray[np.bool_]) -> Region:
        """A region over the cells `where`, its size still unknown."""
        run, group = self.run, self.groups[window.group]
        rows, columns = (np.flatnonzero((where & self.cells.approach.near).any(axis)) for axis in (1, 0))
        if not len(rows):
            rows, columns = (np.flatnonzero(where.any(axis)) for axis in (1, 0))
        return Region(
            kind=kind,
            passes=tuple(run.passes[i].track_id for i in group),
            every_pass=len(group) == len(run.passes),
            channels=self.channels(columns[0], columns[-1]),
            x=self.place(columns[0], columns[-1]),
            time=(float(run.time[rows[0]]), float(run.time[rows[-1]])) if len(group) == 1 else None,
            ahead=None,
            amount=0.0,
            sigma=0.0,
            meters=None,
            speed=None,
            chi2=0.0,
            z=window.z,
        )


def in_meters(region: Region, run: Run) -> Region:
    """A delay of one pass as a distance too."""
    if region.kind != "late" or len(region.passes) != 1:
        return region
    speed = next(abs(one.speed) for one in run.passes if one.track_id == region.passes[0])
    return replace(region, meters=region.amount * max(speed, SLOWEST))


def regions_of(run: Run, cells: Cells, advance: Callable[[int], None] = lambda n: None) -> list[Region]:
    """Find the regions that fail, largest first, at most ten.

    Changes (a gain, a delay, a shift along the fiber, an offset, of some channels in some passes) are looked for first,
    each taken out before the next; then power that none of them explains.

    Parameters
    ----------
    advance : told of each step
    """
    search = Search(run, cells, groups_of(run, cells), cells.residual, cells.there.copy())
    regions: list[Region] = []
    while len(regions) < TRIED and (found := search.change()):
        regions.append(in_meters(search.take_change(*found), run))
        advance(1)
    powers: list[Region] = search.unseen()
    while len(powers) < TRIED and (region := search.power()):
        powers.append(region)
        advance(1)
    return sorted(regions + powers, key=lambda region: -region.chi2)[:MOST]
