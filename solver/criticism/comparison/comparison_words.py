"""What a comparison says, in plain words."""

import numpy as np

from solver.criticism.comparison.comparison import Comparison
from solver.criticism.comparison.regions import Region
from solver.criticism.comparison.split import SOURCES
from solver.run.report.report_words import trusted
from solver.run.seen import Seen
from vision.contract.rounding import with_sigma

#: Misfit above the noise, as a share of it, that is worth words.
SLIGHT = 0.01
MEANING = {
    "channel gain": "some channels sense more or less strain than modeled: coupling to the ground, or its stiffness",
    "channel shift": "some channels lie elsewhere along the fiber: channel spacing, slack, spools",
    "pass gain": "some passes are heavier or lighter than modeled",
    "pass shift": "some passes come late or early: clock, tracking, load not under the middle of the wheelbase",
    "kernel": "the same shape travels with every vehicle of a lane: ground, gauge, wheels, filters",
}
NAMES = {
    "channel gain": "strength of channels",
    "channel shift": "place of channels",
    "pass gain": "weight of passes",
    "pass shift": "timing of passes",
    "kernel": "shape of the signal",
}


def clock(run: Seen, seconds: float) -> str:
    """UTC time of day of a time in the record, s.

    >>> from types import SimpleNamespace
    >>> clock(SimpleNamespace(start=np.datetime64("2025-08-11T06:00:00", "ns")), 72.4)
    '06:01:12'
    """
    moment = run.start + np.timedelta64(round(seconds * 1e9), "ns")
    return str(np.datetime_as_string(moment, unit="s"))[11:]


def channel_words(region: Region) -> str:
    """Which channels."""
    first, last = region.channels
    return f"channel {first}" if first == last else f"channels {first}-{last}"


def pass_words(region: Region, run: Seen) -> str:
    """Which passes.

    Directions and classes are named where they are what the passes have in common.
    """
    if region.every_pass:
        return "all passes" if len(run.passes) > 1 else "the pass"
    if len(region.passes) == 1:
        return f"pass {region.passes[0]}"
    members = [one for one in run.passes if one.track_id in region.passes]
    classes = {one.vehicle_class for one in members}
    same = [one for one in run.passes if one.vehicle_class in classes]
    if len(classes) == 1 and len(same) == len(members):
        return f"all passes of class {classes.pop()}"
    ways = {one.speed > 0 for one in members}
    if len(ways) == 1 and sum((one.speed > 0) in ways for one in run.passes) == len(members):
        return f"all passes toward {'+x' if ways.pop() else '-x'}"
    return f"passes {', '.join(region.passes[:-1])} and {region.passes[-1]}"


def time_words(region: Region, run: Seen) -> str:
    """When, or nothing where passes at several times are meant."""
    if region.time is None:
        return ""
    first, last = (clock(run, seconds) for seconds in region.time)
    return first if first == last else f"{first}-{last}"


def ahead_words(first: float, last: float) -> str:
    """Which distances from the vehicle.

    >>> ahead_words(-20.0, 12.5), ahead_words(5.0, 10.0)
    ('from 20 m behind to 12.5 m ahead of the vehicle', '5 to 10 m ahead of the vehicle')
    """
    if first < 0 < last:
        return f"from {-first:g} m behind to {last:g} m ahead of the vehicle"
    low, high = sorted((abs(first), abs(last)))
    return f"{low:g} to {high:g} m {'ahead of' if last > 0 else 'behind'} the vehicle"


def change_words(region: Region) -> str:
    """What is wrong there."""
    amount, size = region.amount, abs(region.amount)
    if region.kind == "gain":
        return f"gain {100 * size:.{0 if size >= 0.1 else 1}f} % {'low' if amount < 0 else 'high'}"
    if region.kind == "late":
        way = "late" if amount > 0 else "early"
        return f"response {f'{abs(region.meters):.2f} m' if region.meters else f'{size:.3f} s'} {way}"
    if region.kind == "place":
        way = "higher" if amount > 0 else "lower"
        return f"response {size:.2f} m toward {way} channels"
    if region.kind == "offset":
        return f"constant offset of {amount:+.2f} noise sigmas"
    if region.kind == "unseen":
        moving = (
            "" if region.speed is None else f", moving {up_down(region.speed)} at {3.6 * abs(region.speed):.0f} km/h"
        )
        return f"something that the trajectories lack{moving}"
    where = "" if region.ahead is None else f"{ahead_words(*region.ahead)}, "
    return f"{where}residual {region.amount:.2f} times the noise, beyond gains and delays: the shape differs"


def up_down(speed: float) -> str:
    """Way along the fiber."""
    return "up the channels" if speed > 0 else "down the channels"


def size_words(region: Region) -> str:
    """Amount with its standard deviation and unit."""
    amount, sigma, unit = region.amount, region.sigma, region.unit
    if region.kind == "gain":
        amount, sigma, unit = 100 * amount, 100 * sigma, "%"
    elif unit == "1":
        return f"{with_sigma(amount, sigma)} × noise"
    return f"{'+' if amount >= 0 else ''}{with_sigma(amount, sigma)} {unit.replace('noise sigma', 'σ')}"


def region_words(region: Region, run: Seen) -> str:
    """Place, passes, time and what is wrong: one line."""
    who = "no vehicle near" if region.kind == "unseen" else pass_words(region, run)
    where = "" if region.kind == "shape" else channel_words(region)
    when = time_words(region, run) if region.kind not in ("gain", "place", "offset") or len(region.passes) == 1 else ""
    return ", ".join(part for part in (where, who, when) if part) + ": " + change_words(region)


def headline(comparison: Comparison, run: Seen) -> str:
    """What the page says first; where a check of the run failed, it does not say that all is well."""
    count = len(comparison.regions)
    if not count and not trusted(run):
        return "No place, vehicle or time stands out, but the fit does not pass every check."
    if not count:
        return "Model and measurement agree to within the noise."
    where = "one region" if count == 1 else f"{count} regions"
    more = " or more" if count == 10 else ""
    return f"Model and measurement differ in {where}{more}."


def largest_source(comparison: Comparison) -> str | None:
    """The source that explains most of the misfit above the noise; None where all explain little of it."""
    split = comparison.split
    above = split.chi2 - split.noise
    name = max(SOURCES, key=lambda source: split.explained[source])
    return name if above > SLIGHT * split.noise and split.explained[name] > 0.2 * above else None


def verdict(comparison: Comparison, run: Seen) -> str:
    """The sentence under the headline."""
    above = comparison.excess
    if above <= SLIGHT and not comparison.regions:
        return "What the model leaves is noise, as far as it can be told: no place, vehicle or time stands out."
    if comparison.noise_floor is None:
        parts = ["What noise alone leaves of the misfit is not known."]
    elif above <= SLIGHT:
        parts = ["The misfit as a whole is hardly more than that of noise, but some of it stands out."]
    else:
        parts = [f"The misfit is {100 * above:.1f} % above the noise."]
    name = largest_source(comparison)
    if name:
        share = comparison.split.explained[name] / (comparison.split.chi2 - comparison.split.noise)
        parts.append(f"Of the causes that were tried, one explains most, {100 * share:.0f} % of that: {MEANING[name]}.")
    elif above > SLIGHT:
        parts.append("Neither channels, nor passes, nor a common shape explain it: it is of single places and times.")
    if comparison.regions:
        parts.append(f"Largest: {region_words(comparison.regions[0], run)}.")
    return " ".join(parts)
