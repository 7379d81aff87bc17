"""What the pages of a run share: the frame of a page, its style, and commands within a sentence."""

import re
from html import escape
from importlib.resources import files

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
{body}
</main>
</body>
</html>
"""


def resource(name: str) -> str:
    """Text of a file beside this one."""
    return files("solver.run.report").joinpath(name).read_text(encoding="utf-8")


def page(title: str, body: str) -> str:
    """A whole page."""
    return PAGE.format(title=escape(title), style=resource("style.css"), body=body)


def with_commands(text: str) -> str:
    """Text as HTML, with what stands between backticks as commands.

    >>> with_commands("a < b: `roadfiber diagnose RUN`")
    'a &lt; b: <code>roadfiber diagnose RUN</code>'
    """
    return re.sub("`([^`]+)`", r"<code>\1</code>", escape(text))
