"""What the workbench says, as HTML whose every value is escaped, and as lines of its lists."""

from collections.abc import Mapping
from html import escape
from typing import TYPE_CHECKING, Any

from roadfiber.web.bench import Bench
from roadfiber.web.job import Job
from solver.run.report.parts import with_commands
from solver.run.rung import rung_names
from vision.contract import InputError
from vision.contract.rounding import at_most, fall_words
from vision.contract.statements import Statements, table_html

if TYPE_CHECKING:
    from roadfiber.web.film import Film
    from roadfiber.web.preview import Preview
    from solver.criticism.comparison.regions import Region

#: Style of the workbench's own parts; colors are those of all pages.
STYLE = """
:host { font: 14px/1.4 system-ui, -apple-system, "Segoe UI", Roboto, sans-serif; color: #1f2933; }
h1 { font-size: 19px; margin: 0 0 2px; } h2 { font-size: 15px; margin: 10px 0 2px; } p { margin: 2px 0; }
small, .muted { color: #5d6873; } .grade { border-left: 4px solid; padding-left: 8px; }
.good { border-color: #0072b2; } .fair { border-color: #56b4e9; } .weak { border-color: #e69f00; }
.poor { border-color: #d55e00; } b.big { font-size: 18px; font-variant-numeric: tabular-nums; }
code { color: #5d6873; overflow-wrap: anywhere; }
"""
#: Until the run was compared.
LOOKING = "<small>Looking where the model fails ...</small>"


def head(bench: Bench) -> str:
    """The run, its rung, and whether its route may be relied on."""
    run = bench.run
    rung = f"rung {bench.at + 1} of {len(bench.runs)} on this bench" if len(bench.runs) > 1 else "as it was opened"
    model = ", ".join(map(bench.title, run.effects)) or "the base model"
    grade = escape(str(run.facts["trust"]["grade"]))
    trust = with_commands(run.trust.replace("RUN", bench.folder.name))
    return (
        f"<small>{escape(run.name)} · {escape(str(bench.folder))} · {rung} · {escape(model)}</small>"
        f"<h1>{escape(run.headline)}</h1><p class='grade {grade}'>{trust}</p>"
        f"{table_html([Statements.of(one) for one in run.facts.get('statements', ())])}"
    )


def news_of(bench: Bench) -> str:
    """What happened, the last first."""
    if not bench.messages:
        return (
            "<small>Choose what may be missing, move its size, add it; or click the map where the fiber turns.</small>"
        )
    *before, last = bench.messages
    older = "".join(f"<br><small>{escape(one)}</small>" for one in reversed(before[-2:]))
    return f"<span id='said'>{escape(last)}</span>{older}"


def work_words(job: Job | None, elapsed: float) -> str:
    """How far the work in the background is."""
    if job is None:
        return "<small>No work in the background.</small>"
    if job.ended:
        return f"<small>{job.came}: {escape(job.title)}</small>"
    last = job.fits[-1] if job.fits else None
    step = f" · fit {len(job.fits)}, step {last[1][-1][0]}: {last[1][-1][1]:.3f}" if last and last[1] else ""
    far = f" · {job.done} of {job.of}" if job.of else ""
    return f"<b>{escape(job.title)}</b> · {elapsed:.0f} s{far}{step}<br><small>{escape(job.words)}</small>"


def region_lines(bench: Bench) -> list[str]:
    """Where the model fails, a line each, as a list shows them."""
    if bench.comparison is None:
        return []
    return [f"{number}. {region_told(region, bench)}" for number, region in enumerate(bench.comparison.regions, 1)]


def region_told(region: "Region", bench: Bench) -> str:
    """A region that fails, in a sentence."""
    # There is a region once a worker has compared; to load what speaks of it takes longer than to draw the page.
    from solver.criticism.comparison.comparison_words import region_words

    return region_words(region, bench.run)


def regions_news(bench: Bench) -> str:
    """What there is to say of the list of regions before one is chosen."""
    if bench.comparison is None:
        return LOOKING
    if not bench.comparison.regions:
        return "<p><b>Where the model fails:</b> nowhere that this survey shows.</p>"
    return ""


def candidate_line(row: Mapping[str, Any]) -> str:
    """An effect in the list of candidates."""
    how = "fitted" if row.get("refitted") else "scored"
    likely = f"{100 * row['probability']:.0f} % · " if row.get("probability") else ""
    return f"{title(row)} · {likely}chi² {fall_words(row.get('delta_chi2') or 0.0)} ({how})"


def title(row: Mapping[str, Any]) -> str:
    """Title of a candidate."""
    return str(row["told"].get("title") or row["effect"])


def candidate_words(row: Mapping[str, Any] | None, bench: Bench) -> str:
    """What is known of a candidate, or why there is none."""
    if bench.refused:
        return f"<p>Nothing can be added to this {with_commands(bench.refused)}.</p>"
    if row is None:
        return "<small>Choose one of the list.</small>"
    titles = {one["effect"]: title(one) for one in bench.candidates}
    lines = [escape(str(row["told"].get("sentence") or ""))]
    kind = "A discrepancy model: it names no cause. " if row.get("generic") else ""
    lines.append(f"<small>{kind}At the {escape(str(row.get('stage')))} stage.</small>")
    if row.get("route_change"):
        lines.append(f"<small>Ignored, it moves the route by {at_most(row['route_change'])}.</small>")
    if row.get("confounded_with"):
        other = ", ".join(escape(titles.get(one, str(one))) for one in row["confounded_with"])
        lines.append(f"<small>This survey cannot tell it from: {other}.</small>")
    return "".join(f"<p>{line}</p>" for line in lines)


def preview_words(shown: "Preview | None", bench: Bench) -> str:
    """What a size chosen by hand would do."""
    if shown is None:
        return ""
    now = bench.run.result.chi2_per_dof
    return (
        f"<p>{escape(shown.sentence)}</p><p>Misfit <b class='big' id='expected' data-size='{shown.value:.6g}'>"
        f"{shown.misfit:.3f}</b> "
        f"<small>expected; {now:.3f} without it, noise alone leaves {floor_words(bench)}</small></p>"
    )


def floor_words(bench: Bench) -> str:
    """The noise floor."""
    floor = bench.run.facts["noise_floor"]
    return "an unknown part" if floor is None else f"{floor:.3f}"


def ladder_words(bench: Bench) -> str:
    """The rungs with their misfits, as a table."""
    rungs = bench.run.rungs
    if not rungs:
        misfit = bench.run.result.chi2_per_dof
        return misfit_words(misfit, bench)
    rows = "".join(
        f"<p>{at}. {escape(name)}: misfit {rung.chi2_per_dof:.3f}, held out {held_words(rung)}"
        f"<small>, moved {rung.moved}</small></p>"
        for at, (rung, name) in enumerate(zip(rungs, rung_names(rungs, bench.title), strict=True), 1)
    )
    doubts = "".join(f"<p><small>{with_commands(one)}</small></p>" for one in rungs[-1].words)
    last = rungs[-1].chi2_per_dof
    return misfit_words(last, bench) + rows + doubts


def misfit_words(misfit: float, bench: Bench) -> str:
    """Misfit of a run beside that of noise."""
    floor = f"<small>noise alone leaves {floor_words(bench)}</small>"
    return f"<p>Misfit <b class='big' id='misfit'>{misfit:.3f}</b> {floor}</p>"


def held_words(rung: Any) -> str:
    """Misfit of held-out passes."""
    held = rung.held_out_chi2_per_dof
    return "-" if held is None else f"{held:.3f}"


def small(line: str) -> str:
    """A line beside what it is of."""
    return f"<small>{escape(line)}</small>"


def frame(film: "Film", place: int | None) -> str:
    """A frame of the video as HTML; words where there is none, or it cannot be read."""
    try:
        source = "" if place is None else film.at(place)
    except InputError as error:
        return small(str(error))
    if not source:
        return small("The video shows nothing at this moment.")
    return f"<img src='{source}' alt='the street at this moment' style='width:100%'>"
