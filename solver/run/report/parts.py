"""What the pages of a run share: the frame of a page, its style, and commands within a sentence."""

import json
import re
from collections.abc import Sequence
from html import escape
from importlib.resources import files
from typing import Any

from solver.run.report.glossary import glossary
from solver.run.strict_json import strict

PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>{title}</title>
<style>
{style}
</style>
</head>
<body>
<main>
<!-- pages --><!-- /pages -->
{body}
{terms}
</main>
</body>
</html>
"""


def resource(name: str) -> str:
    """Text of a file beside this one."""
    return files("solver.run.report").joinpath(name).read_text(encoding="utf-8")


def page(title: str, body: str) -> str:
    """A whole page."""
    return PAGE.format(title=escape(title), style=resource("style.css"), body=body, terms=glossary())


#: What is done with a route that may be relied on.
EXPORT = "`roadfiber export RUN --to route.gpkg` writes the route for a GIS or CAD; `RUN/route.geojson` opens in any."


def next_section(lines: Sequence[str]) -> str:
    """What to do next, commands between backticks; nothing where there is nothing."""
    items = "".join(f"<li>{with_commands(line)}</li>" for line in lines)
    note = " <small>(RUN is the folder of this page)</small>" if "RUN" in " ".join(lines) else ""
    return f'<section class="next"><h2>Next{note}</h2><ul>{items}</ul></section>' if items else ""


def with_commands(text: str) -> str:
    """Text as HTML, with what stands between backticks as commands.

    >>> with_commands("a < b: `roadfiber diagnose RUN`")
    'a &lt; b: <code>roadfiber diagnose RUN</code>'
    """
    return re.sub("`([^`]+)`", r"<code>\1</code>", escape(text))


def json_text(value: Any) -> str:
    """JSON that can stand in HTML."""
    return (
        json.dumps(strict(value), allow_nan=False, separators=(",", ":"))
        .replace("<", "\\u003c")
        .replace("'", "\\u0027")
    )
