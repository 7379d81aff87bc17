"""Which channels lie beside the road in view, and where: the matched filter's detections against the trajectories."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from solver.start.coil import JumpingLine, find_coil
from solver.start.detections import Detections, MatchedFilter
from solver.start.fiber_line import CLOCK, TOLERANCE, FiberLine, ransac_line, tolerance
from solver.start.wavelets import Array
from solver.trajectory.vehicle_pass import Pass
from vision.contract import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

GATE = 0.5  # gauge lengths to either side of where a vehicle is expected
SEEN = 0.5  # share of the frames in which a channel must see its vehicle
BRIDGE = 2.0  # gauge lengths of unseen channels that do not end the active range
FOLLOWING = 0.2  # share of the detections beside recorded channels that must follow; of noise up to 0.12 does
USUAL = 240.0  # m of fiber over which it does, at the usual tolerance
SHOWN = 0.5  # share of all that is asked for where a lag is free: of another street up to 0.44 does, else 0.62
MOST = 0.6  # that is asked for of short fibers: beside 15 m up to 0.47 of noise follows, and 0.84 of vehicles
FEWEST = 6  # that must do so beyond that share
NOISE_DB = 12.0  # what the loudest of a few hundred channels of noise stays under
CLOCK_MEND = "check the clocks, and that the DAS is of the fiber along this road"


def together(detections: Sequence[Detections]) -> tuple[Array, Array, Array]:
    """x, speed and channel of the detections of all passes [detection]."""
    x, speed, channel = (
        np.concatenate([getattr(one, name) for one in detections]) for name in ("x", "speed", "channel")
    )
    return x, speed, channel


def enough(channel_spacing: float, length: float) -> float:
    """Share of detections that must follow the trajectories over so many meters of fiber: more than noise does.

    >>> enough(1.0, 240.0), round(enough(5.1, 306.0), 2), enough(5.1, 3000.0), enough(1.0, 30.0)
    (0.2, 0.24, 0.2, 0.6)
    """
    return min(MOST, FOLLOWING * max(1.0, tolerance(channel_spacing) / TOLERANCE * USUAL / length))


@dataclass(frozen=True)
class Seen:
    """What the matched filter saw of a survey that it refuses.

    Parameters
    ----------
    x, speed, channel : of the detections, m, m/s along x, column [detection]
    inliers : which follow one line [detection]
    beside : which are of a vehicle that this line puts beside a recorded channel; all without a line [detection]
    needed : how many would have to
    near : how far off the line they may be, m
    snr_db : median of the detections, dB
    """

    x: Array
    speed: Array
    channel: Array
    inliers: NDArray[np.bool_]
    beside: NDArray[np.bool_]
    needed: float
    near: float
    snr_db: float

    @property
    def words(self) -> str:
        """The gate and its figures."""
        on, beside = int(self.inliers.sum()), int(self.beside.sum())
        return (
            f"{on} of {beside} detections are within {self.near:.1f} m of one line, "
            f"{np.ceil(self.needed):.0f} are needed; half of them are under {self.snr_db:.0f} dB"
        )

    def figure(self) -> "Figure":
        """Where vehicles were said to be and which channel was loudest then."""
        from solver.start.refused_figure import refused_figure

        return refused_figure(self)


class Drawn(Protocol):
    """What was seen of a record, to be drawn."""

    def figure(self) -> "Figure":
        """The picture."""


class NotFollowingError(InputError):
    """Nothing in a record follows the trajectories: what was `said` of it, what to mend, what was `seen` instead."""

    def __init__(self, said: str, seen: Drawn, mend: str = ""):
        super().__init__(f"{said}; {mend}" if mend else said)
        self.said, self.seen = said, seen


def find_line(
    matched: MatchedFilter, passes: Sequence[Pass], channel_spacing: float, sure: bool = False
) -> tuple[FiberLine, int]:
    """Line of channel against position, and the polarity of the responses under which most detections follow one.

    Parameters
    ----------
    sure : whether it must be shown beyond doubt, as where it rests on a guess

    Raises
    ------
    InputError
        If what is detected does not move as the vehicles do.
    """
    lines: list[tuple[float, FiberLine, int]] = []
    looks: list[Seen] = []
    for polarity in (1, -1):
        found = [matched.detect(one, polarity) for one in passes]
        snr_db = np.concatenate([one.snr_db for one in found])
        line, inliers = ransac_line(*together(found), channel_spacing)
        channels, beside = matched.measured.shape[1], np.ones_like(inliers)
        if line is not None:
            # Beyond the recorded channels a vehicle is loudest anywhere, and contradicts nothing.
            at = line.channel_of(*together(found)[:2])
            beside = (at > -0.5) & (at < channels - 0.5) | inliers
        needed = FEWEST + enough(channel_spacing, channel_spacing * channels) * beside.sum()
        if line is not None and (sure or abs(line.lag) > CLOCK):
            needed = max(needed, SHOWN * len(inliers))
        median = float(np.median(snr_db)) if len(snr_db) else -np.inf
        looks.append(Seen(*together(found), inliers, beside, needed, tolerance(channel_spacing), median))
        if line is not None and inliers.sum() >= needed:
            lines.append((float(snr_db[inliers].sum()), line, polarity))
    if lines:
        # Upside down, the filter sees the outer lobes on either side of the vehicle: two lines, each fainter. In dB,
        # since where the ground is soft its lobes are louder than all that is recorded elsewhere.
        _, line, polarity = max(lines, key=lambda choice: choice[0])
        return line, polarity
    best = max(looks, key=lambda one: int(one.inliers.sum()))
    if max(one.snr_db for one in looks) < NOISE_DB:
        raise NotFollowingError(
            f"DAS record: no vehicle is seen in it (half of the frames are under {NOISE_DB:g} dB, as noise is)",
            best,
            f"{CLOCK_MEND}, filter what the matched filter sees (--filter fk), or give more and heavier vehicles",
        )
    said = f"DAS record: what moves in it does not follow the trajectories ({best.words})"
    raise NotFollowingError(said, best, CLOCK_MEND)


def balanced(line: FiberLine, detections: Sequence[Detections]) -> FiberLine:
    """Shift a line so that vehicles going either way are off it by the same amount, passes counting alike."""
    shifts: dict[bool, list[float]] = {}
    for one in detections:
        if len(one):
            off = float(np.median(line.residuals(one.x, one.speed, one.channel)))
            shifts.setdefault(bool(np.median(one.speed) > 0), []).append(off)
    return replace(line, x0=line.x0 + float(np.mean([np.median(offs) for offs in shifts.values()])))


def seen_share(
    line: FiberLine, passes: Sequence[Pass], detections: Sequence[Detections], channels: int, half: int
) -> Array:
    """Share [channel] of the frames in view in which a vehicle within `half` channels was detected; NaN if none came.

    Parameters
    ----------
    detections : of each pass, near the line
    channels : number of channels of the record
    """
    edges = np.arange(channels + 1) - 0.5
    due, met = np.zeros(channels), np.zeros(channels)
    for one, seen in zip(passes, detections, strict=True):
        expected = line.channel_of(one.position[:, 0], one.velocity[:, 0])
        due += np.histogram(expected[one.in_view], edges)[0]
        met += np.histogram(expected[one.in_view & np.isin(one.rows, seen.row)], edges)[0]
    box = np.ones(2 * half + 1)
    due, met = (np.convolve(count, box, mode="full")[half : half + channels] for count in (due, met))
    return np.divide(met, due, out=np.full(channels, np.nan), where=due > 0.5)


def active_range(share: Array, view: tuple[float, float], bridge: int) -> tuple[int, int]:
    """First and last channel index in view that see their vehicles, without single finds far from the longest stretch.

    A silent stretch between, as in a conduit where the fiber slips, is part of the fiber: the same line continues
    beyond it.

    Parameters
    ----------
    share : see `seen_share` [channel]
    view : channel indices at the ends of the view, ascending
    bridge : how many unseen channels within a stretch do not end it, and how many a stretch must have to count

    >>> active_range(np.array([0, 1, 1, 0, 1, 1, 1, 0, 0, 0, 1.0]), (0, 10), 2)
    (1, 6)
    >>> active_range(np.array([0, 1, 1, 0, 1, 1, 1, 0, 0, 0, 1.0, 1.0]), (0, 11), 2)
    (1, 11)
    """
    inside = np.arange(np.ceil(view[0]), np.floor(view[1]) + 1).astype(int)
    inside = inside[(inside >= 0) & (inside < len(share))]
    seen = inside[np.nan_to_num(share[inside]) >= SEEN]
    if not len(seen):
        raise InputError(f"DAS record: no channel sees the vehicles in most frames (under 7 dB); {CLOCK_MEND}")
    stretches = np.split(seen, np.flatnonzero(np.diff(seen) > bridge + 1) + 1)
    longest = max(len(stretch) for stretch in stretches)
    counted = [stretch for stretch in stretches if len(stretch) >= min(bridge, longest)]
    return int(counted[0][0]), int(counted[-1][-1])


def direction_residual(line: FiberLine, detections: Sequence[Detections]) -> dict[int, float]:
    """Median of the vehicle's x minus that of the channel that senses it, m, by the direction of travel (1, -1)."""
    x, speed, channel = together(detections)
    off = x - line.x_of(channel)
    return {sign: float(np.median(off[speed * sign > 0])) for sign in (1, -1) if (speed * sign > 0).any()}


@dataclass(frozen=True)
class Alignment:
    """Line, active channel indices, detections of each pass near it and within them, where it jumps, polarity."""

    line: FiberLine
    active: tuple[int, int]
    detections: list[Detections]
    jump: JumpingLine | None = None
    polarity: int = 1


def detect_near(
    matched: MatchedFilter, one: Pass, polarity: int, line: FiberLine, gate: int, near: float
) -> Detections:
    """Detections of a pass on the line, within `near` m of it, looked for up to `gate` channels off it."""
    found = matched.detect(one, polarity, line.channel_of(one.position[:, 0], one.velocity[:, 0]), gate)
    return found.where(np.abs(line.residuals(found.x, found.speed, found.channel)) < near)


def align(
    matched: MatchedFilter, passes: Sequence[Pass], channel_spacing: float, gauge: float, sure: bool = False
) -> Alignment:
    """Find the line among all detections, then again among those near it on the channels that see the vehicles.

    Parameters
    ----------
    gauge : gauge length in channels
    sure : as of `find_line`
    """
    line, polarity = find_line(matched, passes, channel_spacing, sure)
    every = together([matched.detect(one, polarity) for one in passes])
    if (jump := find_coil(line, *every, channel_spacing)) is not None:
        return aligned_beyond(matched, passes, polarity, jump, gauge, tolerance(channel_spacing))
    gate, within = max(2, round(GATE * gauge)), tolerance(channel_spacing)
    x = np.concatenate([one.position[one.in_view, 0] for one in passes])
    channels = matched.positive.shape[1]
    for _ in range(2):
        near = [detect_near(matched, one, polarity, line, gate, within) for one in passes]
        share = seen_share(line, passes, near, channels, gate)
        view = line.channel_of(x)
        active = active_range(share, (float(view.min()), float(view.max())), round(BRIDGE * gauge))
        near = [one.where((one.channel >= active[0] - gate) & (one.channel <= active[1] + gate)) for one in near]
        again, _ = ransac_line(*together(near), channel_spacing)
        line = balanced(again or line, near)
    return Alignment(line, active, near, polarity=polarity)


def aligned_beyond(
    matched: MatchedFilter, passes: Sequence[Pass], polarity: int, jump: JumpingLine, gauge: float, within: float
) -> Alignment:
    """Alignment of a fiber that lies coiled somewhere: each side has its line."""
    gate, channels = max(2, round(GATE * gauge)), matched.positive.shape[1]
    x = np.concatenate([one.position[one.in_view, 0] for one in passes])
    sides, ends = [], []
    for line, where in ((jump.line, (0, jump.channel - 1)), (jump.beyond, (jump.channel, channels - 1))):
        near = [detect_near(matched, one, polarity, line, gate, within) for one in passes]
        view = np.clip(np.sort(line.channel_of(np.array([x.min(), x.max()]))), *where)
        share = seen_share(line, passes, near, channels, gate)
        first, last = active_range(share, (float(view[0]), float(view[1])), round(BRIDGE * gauge))
        sides.append([one.where((one.channel >= first) & (one.channel <= last)) for one in near])
        ends.append((first, last))
    both = [
        replace(a, **{f.name: np.concatenate([getattr(a, f.name), getattr(b, f.name)]) for f in fields(a)})
        for a, b in zip(*sides, strict=True)
    ]
    return Alignment(jump.line, (ends[0][0], ends[1][1]), both, jump, polarity)
