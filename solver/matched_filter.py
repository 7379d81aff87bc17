"""Where to begin: rough route and active channels of a fiber from what the matched filter sees of the passes."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from solver.coupling import CouplingCurve, coupling_curve
from solver.das import DASRecord
from solver.detections import FRAME_RATE, Detections, MatchedFilter, thinned
from solver.fiber_line import TOLERANCE, FiberLine, ransac_line
from solver.lateral import binned_widths, locate_sides
from solver.trajectory import Pass
from solver.wavelets import SCALES, Array
from vision.contract import InputError

GATE = 0.5  # gauge lengths to either side of where a vehicle is expected
SEEN = 0.5  # share of the frames in which a channel must see its vehicle
BRIDGE = 2.0  # gauge lengths of unseen channels that do not end the active range
FOLLOWING = 0.3  # share of the detections that must follow the trajectories
FEWEST = 6  # detections that make a line
CLOCK = 2.0  # s of clock error that a survey can bear
APART = 25.0  # m between two vehicles whose responses do not overlap
CROWDED_DB = 14.0  # dB that a response counts less beside another one
DISTANT = 12.0  # m; lateral offset that the bank must cover
NOISE_DB = 12.0  # what the loudest of a few hundred channels of noise stays under
CLOCK_MEND = "check the clocks, and that the DAS is of the fiber along this road"


@dataclass(frozen=True)
class Initialization:
    """Rough fiber from the matched filter.

    Parameters
    ----------
    active : first and last channel number that vehicles passed in view and that felt them
    direction : 1 for a fiber that runs along +x, -1 against it
    x_of_channel : x0 and slope of x = x0 + slope channel, m and m per channel
    channel : numbers of the active channels [channel]
    lateral, mirror : y of the fiber and of its best alternative on the other side of the traffic [channel], m
    side_evidence : by how much the mirror fits the widths worse, summed over passes, in standard deviations; 0 = the
        passes cannot tell, above about 2 the side is decided
    width_factor : measured over modeled widths; far from 1 the ground, the gauge length or the wheels are not as
        believed
    clock_ahead : how far the clock of the trajectories is ahead of the DAS's, s; 0 where all vehicles go one way
    direction_residual : median of x of the vehicle minus x of the channel that feels it, m, for vehicles going along
        (1) and against (-1) +x; the line is halfway between the two
    detections : of each pass, in the order given
    snr_db : median of each pass's detections [pass], dB; -inf for a pass never seen
    route : x, y, z of the active channels [channel, 3], m
    """

    active: tuple[int, int]
    direction: int
    x_of_channel: tuple[float, float]
    channel: NDArray[np.int64]
    lateral: Array
    mirror: Array
    side_evidence: float
    width_factor: float
    clock_ahead: float
    direction_residual: dict[int, float]
    detections: tuple[Detections, ...]
    snr_db: Array
    route: Array


def bank_scales(curves: Sequence[CouplingCurve], channel_spacing: float) -> Array:
    """Scales of the bank, in channels: the paper's, stretched where its 2 to 20 do not hold the widths to expect.

    >>> curve = coupling_curve("car", depth=0.9, gauge_length=10.0, poisson_ratio=0.25)
    >>> bank_scales([curve], 1.02)[[0, -1]].tolist(), bank_scales([curve], 0.25)[[0, -1]].round(1).tolist()
    ([2.0, 20.0], [10.8, 108.3])
    """
    narrow = min(curve.width[0] for curve in curves) / channel_spacing
    wide = max(float(curve.width_at(DISTANT)) for curve in curves) / channel_spacing
    fits = narrow > 1.5 * SCALES[0] and wide < SCALES[-1] / 1.2
    return SCALES if fits else SCALES * (narrow / 5)


def together(detections: Sequence[Detections]) -> tuple[Array, Array, Array]:
    """x, speed and channel of the detections of all passes [detection]."""
    x, speed, channel = (
        np.concatenate([getattr(one, name) for one in detections]) for name in ("x", "speed", "channel")
    )
    return x, speed, channel


def find_line(matched: MatchedFilter, passes: Sequence[Pass], channel_spacing: float) -> tuple[FiberLine, int]:
    """Line of channel against position, and the polarity of the responses under which most detections follow one.

    Raises
    ------
    InputError
        If what is detected does not move as the vehicles do.
    """
    lines: list[tuple[float, FiberLine, int]] = []
    loudest = -np.inf
    for polarity in (1, -1):
        found = [matched.detect(one, polarity) for one in passes]
        snr_db = np.concatenate([one.snr_db for one in found])
        loudest = max(loudest, float(np.median(snr_db)) if len(snr_db) else -np.inf)
        line, inliers = ransac_line(*together(found), channel_spacing)
        if line is not None and inliers.sum() >= max(FEWEST, FOLLOWING * len(inliers)):
            lines.append((float(snr_db[inliers].sum()), line, polarity))
    if lines:
        _, line, polarity = max(lines, key=lambda choice: choice[0])
        return line, polarity
    if loudest < NOISE_DB:
        raise InputError(
            f"DAS record: no vehicle is seen in it (half of the frames stay under {NOISE_DB:g} dB, as noise does); "
            f"{CLOCK_MEND}, or give more and heavier vehicles"
        )
    raise InputError(f"DAS record: what moves in it does not follow the trajectories; {CLOCK_MEND}")


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
    """First and last channel index of the longest stretch in view that sees its vehicles.

    Parameters
    ----------
    share : see `seen_share` [channel]
    view : channel indices at the ends of the view, ascending
    bridge : how many unseen channels within a stretch do not end it

    >>> active_range(np.array([0, 1, 1, 0, 1, 1, 1, 0, 0, 0, 1.0]), (0, 10), 2)
    (1, 6)
    """
    inside = np.arange(np.ceil(view[0]), np.floor(view[1]) + 1).astype(int)
    inside = inside[(inside >= 0) & (inside < len(share))]
    seen = inside[np.nan_to_num(share[inside]) >= SEEN]
    if not len(seen):
        raise InputError(f"DAS record: no channel sees the vehicles in view; {CLOCK_MEND}")
    stretches = np.split(seen, np.flatnonzero(np.diff(seen) > bridge + 1) + 1)
    longest = max(stretches, key=lambda stretch: stretch[-1] - stretch[0])
    return int(longest[0]), int(longest[-1])


def quieter_when_crowded(passes: Sequence[Pass], detections: Sequence[Detections]) -> list[Detections]:
    """Lower the SNR of detections of a vehicle near another one, whose response overlaps."""
    last = max(int(one.rows[-1]) for one in passes) + 1
    place = np.full((len(passes), last), np.inf)
    for index, one in enumerate(passes):
        place[index, one.rows] = one.position[:, 0]
    believed = []
    for index, seen in enumerate(detections):
        others = np.delete(place, index, axis=0)[:, seen.row]
        crowded = (np.abs(others - seen.x) < APART).any(0)
        believed.append(replace(seen, snr_db=seen.snr_db - CROWDED_DB * crowded))
    return believed


@dataclass(frozen=True)
class Alignment:
    """Line, active channel indices, and the detections near the line and within them, of each pass."""

    line: FiberLine
    active: tuple[int, int]
    detections: list[Detections]


def detect_near(matched: MatchedFilter, one: Pass, polarity: int, line: FiberLine, gate: int) -> Detections:
    """Detections of a pass on the line, looked for up to `gate` channels off it."""
    found = matched.detect(one, polarity, line.channel_of(one.position[:, 0], one.velocity[:, 0]), gate)
    return found.where(np.abs(line.residuals(found.x, found.speed, found.channel)) < TOLERANCE)


def align(matched: MatchedFilter, passes: Sequence[Pass], channel_spacing: float, gauge: float) -> Alignment:
    """Find the line among all detections, then again among those near it on the channels that see the vehicles.

    Parameters
    ----------
    gauge : gauge length in channels
    """
    line, polarity = find_line(matched, passes, channel_spacing)
    gate = max(2, round(GATE * gauge))
    x = np.concatenate([one.position[one.in_view, 0] for one in passes])
    channels = matched.positive.shape[1]
    for _ in range(2):
        near = [detect_near(matched, one, polarity, line, gate) for one in passes]
        share = seen_share(line, passes, near, channels, gate)
        view = line.channel_of(x)
        active = active_range(share, (float(view.min()), float(view.max())), round(BRIDGE * gauge))
        near = [one.where((one.channel >= active[0] - gate) & (one.channel <= active[1] + gate)) for one in near]
        again, _ = ransac_line(*together(near), channel_spacing)
        line = balanced(again or line, near)
    return Alignment(line, active, near)


def initialize(
    record: DASRecord, passes: Sequence[Pass], *, depth: float = 0.9, poisson_ratio: float = 0.25
) -> Initialization:
    """Rough route and active channels from the matched filter.

    A derivative-of-Ricker bank is correlated with every frame along the channels; each scale is divided by its median
    absolute deviation. What exceeds 7 dB with the polarity of the direction of travel is a detection. A RANSAC line of
    channel against vehicle position over all passes gives x and the active channels; the widths of the responses give
    the lateral offset through the coupling curve.

    Parameters
    ----------
    record : strain rate
    passes : vehicles, smoothed, at the record's rows
    depth : believed depth of the fiber, m
    poisson_ratio : believed, of the ground

    Raises
    ------
    InputError
        If no vehicle is seen in the record, what is seen does not follow the trajectories, or their clocks are more
        than 2 s apart.
    """
    stride = max(1, int(record.sampling_rate / FRAME_RATE))
    frames, thin = thinned(record.strain_rate, passes, stride)
    spacing = record.channel_spacing
    curves = [
        coupling_curve(one.vehicle_class, depth=depth, gauge_length=record.gauge_length, poisson_ratio=poisson_ratio)
        for one in thin
    ]
    matched = MatchedFilter(frames, thin, bank_scales(curves, spacing))
    gauge = record.gauge_length / spacing
    found = align(matched, thin, spacing, gauge)
    line, (first, last) = found.line, found.active
    if abs(line.lag) > CLOCK:
        side = "ahead of" if line.lag > 0 else "behind"
        raise InputError(
            f"trajectories: their clock is {abs(line.lag):.1f} s {side} that of the DAS; shift one of them by that"
        )
    edges = np.linspace(first - 0.5, last + 0.5, max(1, round((last - first + 1) / gauge)) + 1)
    widths = binned_widths(edges, quieter_when_crowded(thin, found.detections), matched.scales, spacing)
    sides = locate_sides(widths, curves, spacing)
    index = np.arange(first, last + 1)
    lateral, mirror = (np.interp(index, sides.channel, y) for y in (sides.y, sides.mirror))
    origin = int(record.channel[0])
    detections = tuple(
        replace(one, row=one.row * stride + stride // 2, channel=one.channel + origin) for one in found.detections
    )
    return Initialization(
        active=(first + origin, last + origin),
        direction=1 if line.slope > 0 else -1,
        x_of_channel=(line.x0 - line.slope * origin, line.slope),
        channel=index + origin,
        lateral=lateral,
        mirror=mirror,
        side_evidence=sides.evidence,
        width_factor=sides.width_factor,
        clock_ahead=line.lag,
        direction_residual=direction_residual(line, found.detections),
        detections=detections,
        snr_db=np.array([np.median(one.snr_db) if len(one) else -np.inf for one in detections]),
        route=np.stack([line.x_of(index), lateral, np.full(len(index), depth)], axis=1),
    )


def direction_residual(line: FiberLine, detections: Sequence[Detections]) -> dict[int, float]:
    """Median of the vehicle's x minus that of the channel that feels it, m, by the direction of travel (1, -1)."""
    x, speed, channel = together(detections)
    off = x - line.x_of(channel)
    return {sign: float(np.median(off[speed * sign > 0])) for sign in (1, -1) if (speed * sign > 0).any()}
