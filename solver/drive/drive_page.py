"""The page of a located drive; it opens offline."""

from html import escape
from typing import TYPE_CHECKING

from solver.drive.drive_figures import channel_figure, misfit_figure, plan_figure, waterfall_figure
from solver.run.report.parts import EXPORT, next_section, page, with_commands
from vision.contract.figures import svg
from vision.contract.statements import Statements, table_html

if TYPE_CHECKING:
    from solver.drive.drive_run import DriveRun

WIDE = 1060  # px
TOLD = 0.75  # of the standard deviation before the drive: a depth that is surer is told by it


def drive_page(run: "DriveRun") -> str:
    """One page: what was found, the drive over the waterfall, the channel map, the route, the misfit."""
    facts = run.facts
    grade = escape(str(facts["trust"]["grade"]))
    start = str(facts["start"])[:19].replace("T", " ")
    body = (
        f"<header><p>{escape(run.name)} · drive of {start} UTC</p><h1>{escape(run.headline)}.</h1>"
        f'<p class="grade {grade}" style="color: var(--ink)">{with_commands(run.trust)}</p></header>'
        f"{numbers(run)}"
        f"{section('The drive', DRIVE, svg(waterfall_figure(run, WIDE)))}"
        f"{section('Which channel lies where', MAP, svg(channel_figure(run, WIDE)))}"
        f"{section('From above', PLAN + depth_words(run), svg(plan_figure(run, WIDE)))}"
        f"{section('Misfit along the path', MISFIT, svg(misfit_figure(run, WIDE)))}"
        f"{loop_section(run)}{stated_section(run)}{next_section([*map(sentence, run.warnings), EXPORT])}{made(run)}"
    )
    return page(f"{run.name}: {run.headline}", body)


DRIVE = (
    "Each dark line is a vehicle that drives along the fiber. The orange line is the GPS car, by the clock and the "
    "channel map that were found: where it lies on a dark line, both are right. Other vehicles are other lines."
)
MAP = (
    "Channels are as far apart along the path as cable was laid straight. Where cable is coiled in a manhole, channels "
    "go on and the path does not."
)
PLAN = (
    "The place along the path is what the drive measures. The distance from the road comes from the shape of what is "
    "recorded, the side of the road from the map where the car drove in one lane only. "
)
MISFIT = "A stretch where legs are off to one side, or where few channels hear the car, is where to look again."
STATED = (
    "Gauge length, channel spacing and clock are taken from files, which may be wrong. The shape of what channels hear "
    "tells the gauge length, the cable between two places the spacing, passes at different times the clock."
)


def depth_words(run: "DriveRun") -> str:
    """On which channels the drive tells how deep the fiber lies."""
    prior, spread = run.facts["settings"]["depth"]
    sigma = run.arrays["covariance"][run.arrays["constrained"], 2, 2] ** 0.5
    told = sigma[sigma < TOLD * spread]
    assumed = f"what was assumed, {prior:g} ± {spread:g} m"
    if not len(told):
        return f"Depth is {assumed}: a pass tells it where the car is within some 4 m of the fiber."
    return (
        f"Depth is told on {len(told)} of {len(sigma)} located channels, which the car passed within some 4 m, to "
        f"{sorted(told)[len(told) // 2]:.2f} m (1 sigma); elsewhere it is {assumed}."
    )


def sentence(line: str) -> str:
    """A line as a sentence.

    >>> sentence("which side is not known")
    'Which side is not known.'
    """
    return f"{line[:1].upper()}{line[1:].rstrip('.')}."


def section(title: str, words: str, content: str) -> str:
    """One section."""
    return f"<section><h2>{title}</h2><p>{words}</p>{content}</section>"


def numbers(run: "DriveRun") -> str:
    """The four figures of the head."""
    found = run.facts["parameters"]
    clock, factor = found["clock_offset"], found["length_factor"]
    sigma = run.arrays["sigma_along"][run.arrays["constrained"]]
    wide = f"{float(sigma.max()):.1f} m at most" if len(sigma) else ""
    middle = f"{float(sorted(sigma)[len(sigma) // 2]):.2f} m" if len(sigma) else "none"
    items = [
        ("Along the path, 1 sigma", middle, wide),
        ("Clock of the record", f"{clock['value']:+.2f} s", f"± {clock['sigma']:.2f} s, less that of the GPS"),
        (
            "Loops of slack",
            str(len(run.facts["loops"])),
            f"{sum(one['length'] for one in run.facts['loops']):.0f} m of cable",
        ),
        ("Cable per meter of map", f"{factor['value']:.3f}", f"± {factor['sigma']:.3f}, loops left out"),
    ]
    return (
        '<dl class="figures">'
        + "".join(
            f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd><dd>{escape(more)}</dd></div>"
            for name, value, more in items
        )
        + "</dl>"
    )


def loop_section(run: "DriveRun") -> str:
    """The table of loops."""
    loops = run.facts["loops"]
    if not loops:
        return section("Loops of slack", "None longer than a gauge was found where the car is heard.", "")
    head = "".join(f"<th>{one}</th>" for one in ("channels", "along the map, m", "cable, m", "latitude", "longitude"))
    rows = "".join(
        f"<tr><td>{one['first_channel']} to {one['last_channel']}</td><td>{one['along']:.0f}</td>"
        f"<td>{one['length']:.0f} <small>± {one['sigma']:.0f}</small></td>"
        f"<td>{one['latitude']:.6f}</td><td>{one['longitude']:.6f}</td></tr>"
        for one in loops
    )
    words = "Channels of a loop lie at its manhole: it is where to open the ground, and where to splice."
    return section("Loops of slack", words, f'<div class="wide-table"><table><tr>{head}</tr>{rows}</table></div>')


def stated_section(run: "DriveRun") -> str:
    """What files may state wrongly."""
    from solver.drive.drive_run import how_probable

    lines = "".join(
        f"<li><b>{escape(one['title'])}</b>, {how_probable(one)}. {escape(one['words'])}</li>"
        for one in run.facts["misstated"]
    )
    return section("Are the files right?", STATED, f"<ul>{lines}</ul>")


def made(run: "DriveRun") -> str:
    """What the run was made from."""
    facts = run.facts
    left = facts["gps_left_out"]
    reverse = " The map runs against the channels." if facts["map_reversed"] else ""
    sign = "positive" if facts["parameters"]["polarity"]["value"] > 0 else "negative"
    settings = facts["settings"]
    words = (
        f"{len(run.arrays['channel'])} channels of {settings['channel_spacing']:g} m with gauges of "
        f"{settings['gauge_length']:g} m; the record is {sign} where the fiber is stretched; {facts['clock']}; "
        f"{facts['legs']} legs; {left} GPS fixes left out as wrong.{reverse} The map is a prior with sigma "
        f"{settings['map_sigma']:g} m."
    )
    files = "".join(f"<li><code>{escape(one['path'].rpartition('/')[2])}</code></li>" for one in facts["inputs"][:8])
    more = "<li>...</li>" if len(facts["inputs"]) > 8 else ""
    table = table_html([Statements.of(one) for one in facts["statements"]])
    return section("What it was made from", escape(words), f"<ul>{files}{more}</ul>{table}")
