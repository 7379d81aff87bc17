"""The page of one route from several runs; it opens offline."""

from html import escape
from typing import TYPE_CHECKING

from solver.run.report.parts import next_section, page
from vision.contract.figures import svg

if TYPE_CHECKING:
    from solver.run.combined import Combined

HEAD = "<tr><th>run</th><th>passes</th><th>across, m</th><th>sigmas</th><th>depth, m</th><th>sigmas</th></tr>"
NEXT = (
    "`roadfiber compare FOLDER`, with the folder of a run that disagrees, shows what is wrong with it.",
    "`route.geojson` beside this page opens in any GIS: the route with its 95 % corridor.",
)


def combined_page(combined: "Combined") -> str:
    """The whole page."""
    rows = "".join(
        f"<tr><td>{escape(one.run)}</td><td>{one.passes}</td><td>{one.across:+z.3f}</td><td>{one.across_z:+z.1f}</td>"
        f"<td>{one.depth:+z.3f}</td><td>{one.depth_z:+z.1f}</td></tr>"
        for one in combined.agreement
    )
    widened = f" All sigmas are times {combined.widened:.1f} since the runs differ." if combined.widened > 1 else ""
    body = (
        f"<header><p>{escape(combined.name)} · one route of several runs</p><h1>{escape(combined.headline)}.</h1>"
        "</header><section><h2>Where the fiber is</h2><p>The line is the combined route with its 95 % corridor; thin "
        "lines are the runs by themselves. It is the route that one fit of all passes finds, not an average."
        f"{widened}</p>{svg(combined.plot())}</section><section><h2>Do the runs agree?</h2><p>Mean difference of each "
        "run by itself from the combined route, in meters and in the sigmas of such a difference: beyond 3 look at "
        f'that run.</p><div class="wide-table"><table>{HEAD}{rows}</table></div></section>{next_section(NEXT)}'
    )
    return page(f"{combined.name}: combined route", body)
