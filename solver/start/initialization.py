"""Where to begin: rough route and active channels of a fiber from what the matched filter sees of the passes."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from solver.start.alignment import align, direction_residual
from solver.start.coupling_curve import CouplingCurve, coupling_curve
from solver.start.detections import FRAME_RATE, Detections, MatchedFilter, excess, thinned
from solver.start.fiber_line import CLOCK, FiberLine
from solver.start.lateral import binned_widths, locate_sides
from solver.start.wavelets import SCALES, Array
from solver.survey.das.record import DASRecord
from solver.trajectory.vehicle_pass import Pass
from vision.contract import InputError

APART = 25.0  # m between two vehicles whose responses do not overlap
CROWDED_DB = 14.0  # dB that a response counts less beside another one
DISTANT = 12.0  # m; lateral offset that the bank must cover
FEWEST_CHANNELS = 10
DEPTHS = (0.75, 1.0, 1.25)  # in units of the prior mean


@dataclass(frozen=True)
class Initialization:
    """Rough fiber from the matched filter.

    Parameters
    ----------
    active : first and last channel number that vehicles passed in view and that recorded them
    direction : 1 for a fiber that runs along +x, -1 against it
    x_of_channel : x0 and slope of x = x0 + slope channel, m and m per channel
    channel : numbers of the active channels [channel]
    lateral, mirror : y of the fiber and of its best alternative on the other side of the traffic [channel], m
    side_evidence : by how much the mirror fits the widths worse, summed over passes, in standard deviations; 0 = the
        passes cannot tell, above about 3 the side is decided
    width_factor : measured over modeled widths; far from 1 the ground, the gauge length or the wheels are not as
        assumed
    clock_ahead : how far the clock of the trajectories is ahead of the DAS's, s; 0 where all vehicles go one way.
        Loads that are not in the middle of the wheelbase count as a few hundredths
    direction_residual : median of x of the vehicle minus x of the channel that senses it, m, for vehicles going along
        (1) and against (-1) +x; the line is halfway between the two
    detections : of each pass, in the order given
    snr_db : median of each pass's detections [pass], dB; -inf for a pass never seen
    offset : distance between lane and fiber that the median width of each pass says, by its coupling curve alone
        [pass], m; NaN for a pass never seen
    route : x, y, z of the active channels [channel, 3], m
    coil : channel near which fiber seems to lie coiled, and how much, m; None where none does
    polarity : 1 or -1, of the responses to vehicles going along +x, see `MatchedFilter.detect`
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
    offset: Array
    route: Array
    coil: tuple[int, float] | None = None
    polarity: int = 1


def bank_scales(curves: Sequence[CouplingCurve], channel_spacing: float) -> Array:
    """Scales of the bank, in channels: the paper's 2 to 20, stretched where they do not hold the expected widths.

    >>> curve = coupling_curve("car", depth=0.9, gauge_length=10.0, poisson_ratio=0.25)
    >>> bank_scales([curve], 1.02)[[0, -1]].tolist(), bank_scales([curve], 0.25)[[0, -1]].round(1).tolist()
    ([2.0, 20.0], [10.8, 108.3])
    """
    narrow = min(curve.width[0] for curve in curves) / channel_spacing
    wide = max(float(curve.width_at(DISTANT)) for curve in curves) / channel_spacing
    fits = narrow > 1.5 * SCALES[0] and wide < SCALES[-1] / 1.2
    return SCALES if fits else SCALES * (narrow / 5)


def quieter_when_crowded(passes: Sequence[Pass], detections: Sequence[Detections]) -> list[Detections]:
    """Lower the SNR of detections of a vehicle near another one, whose response overlaps."""
    last = max(int(one.rows[-1]) for one in passes) + 1
    place = np.full((len(passes), last), np.inf)
    for index, one in enumerate(passes):
        place[index, one.rows] = one.position[:, 0]
    lowered = []
    for index, seen in enumerate(detections):
        others = np.delete(place, index, axis=0)[:, seen.row]
        crowded = (np.abs(others - seen.x) < APART).any(0)
        lowered.append(replace(seen, snr_db=seen.snr_db - CROWDED_DB * crowded))
    return lowered


def curves_by_depth(
    vehicle_class: str, depth: float, gauge_length: float, poisson_ratio: float
) -> dict[float, CouplingCurve]:
    """Coupling curves of a class for the prior mean depth and for others, by their share of it."""
    return {
        share: coupling_curve(
            vehicle_class, depth=share * depth, gauge_length=gauge_length, poisson_ratio=poisson_ratio
        )
        for share in DEPTHS
    }


class ClocksApartError(InputError):
    """Detections follow the vehicles, but far ahead or behind: the tracks' clock is `ahead`, s."""

    def __init__(self, message: str, ahead: float):
        super().__init__(message)
        self.ahead = ahead


def check_clocks(line: FiberLine) -> None:
    """Raise ClocksApartError where the detections follow the vehicles, but far ahead or behind."""
    if abs(line.lag) > CLOCK:
        side = "ahead of" if line.lag > 0 else "behind"
        raise ClocksApartError(
            f"trajectories: their clock is {abs(line.lag):.1f} s {side} that of the DAS; "
            f"take {line.lag:.2f} s off their times (clock_offset in [camera])",
            line.lag,
        )


def visible(passes: Sequence[Pass], channels: int) -> list[int]:
    """Which passes have a frame in view [visible]; InputError where none has, or there is no fiber to speak of."""
    if channels < FEWEST_CHANNELS:
        raise InputError(f"DAS record: {channels} channels are too few to see a vehicle pass; give the whole stretch")
    seen = [index for index, one in enumerate(passes) if one.in_view.any()]
    if not seen:
        raise InputError("trajectories: no vehicle is in view during the DAS record; check the clocks")
    return seen


def initialize(
    record: DASRecord, passes: Sequence[Pass], *, depth: float = 0.9, poisson_ratio: float = 0.25, sure: bool = False
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
    depth : prior mean depth of the fiber, m
    poisson_ratio : prior mean of the ground's
    sure : whether it must be shown beyond doubt that these follow the trajectories, as where the passes are a guess

    Raises
    ------
    InputError
        If no vehicle is seen in the record, what is seen does not follow the trajectories, or their clocks are more
        than 2 s apart.
    """
    stride, spacing = max(1, int(record.sampling_rate / FRAME_RATE)), record.channel_spacing
    frames, thin = thinned(record.strain_rate, passes, stride)
    seen = visible(thin, len(record.channel))
    thin = [thin[index] for index in seen]
    curves = [curves_by_depth(one.vehicle_class, depth, record.gauge_length, poisson_ratio) for one in thin]
    expected = [curve[1.0] for curve in curves]
    matched = MatchedFilter(frames, thin, bank_scales(expected, spacing), excess(frames))
    gauge = record.gauge_length / spacing
    found = align(matched, thin, spacing, gauge, sure)
    check_clocks(found.line)
    first, last = found.active
    edges = np.linspace(first - 0.5, last + 0.5, max(1, round((last - first + 1) / gauge)) + 1)
    widths = binned_widths(edges, quieter_when_crowded(thin, found.detections), matched.scales, spacing)
    sides = locate_sides(widths, curves, spacing)

    index, origin = np.arange(first, last + 1), int(record.channel[0])
    lateral, mirror = (np.interp(index, sides.channel, y) for y in (sides.y, sides.mirror))
    detections = [matched.nothing] * len(passes)
    snr_db, offset = np.full(len(passes), -np.inf), np.full(len(passes), np.nan)
    for number, curve, one in zip(seen, expected, found.detections, strict=True):
        detections[number] = replace(one, row=one.row * stride + stride // 2, channel=one.channel + origin)
        if len(one):
            snr_db[number] = np.median(one.snr_db)
            offset[number] = curve.offset_of(float(np.median(one.scale)) * spacing)
    x, jump = found.line.x_of(index), found.jump
    if jump is not None:
        x = np.where(index < jump.channel, x, jump.beyond.x_of(index))
    return Initialization(
        active=(first + origin, last + origin),
        direction=1 if found.line.slope > 0 else -1,
        x_of_channel=(found.line.x0 - found.line.slope * origin, found.line.slope),
        channel=index + origin,
        lateral=lateral,
        mirror=mirror,
        side_evidence=sides.evidence,
        width_factor=sides.width_factor,
        clock_ahead=found.line.lag,
        direction_residual=direction_residual(found.line, found.detections),
        detections=tuple(detections),
        snr_db=snr_db,
        offset=offset,
        route=np.stack([x, lateral, np.full(len(index), depth)], axis=1),
        polarity=found.polarity,
        coil=None if jump is None else (jump.channel + origin, jump.coiled * spacing),
    )
