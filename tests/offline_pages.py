"""What holds of every page: one small file that fetches nothing, on which what others wrote is text."""

import re

EVIL = "<img src=x onerror=alert(1)>"
LARGEST = 8_000_000
#: Whatever a browser would fetch by itself.
LOADED = re.compile(
    r"""<(?:script|link|img|iframe|source|image|use|video|audio|object|embed)\b[^>]*\b(?:src|href|data)\s*=\s*["']?"""
    r"""(?:https?:)?//|url\(\s*["']?(?:https?:)?//|@import""",
    re.IGNORECASE,
)
#: Words in a figure whose color is not one of the theme's, which change with it.
UNTHEMED = re.compile(r"<text\b[^>]*fill: ?#")
#: What comes next, with a command in it.
NEXT = re.compile(r'<section class="next">.*?<h2>.*?<code>roadfiber \w', re.DOTALL)


def is_whole(text: str) -> bool:
    """Whether a page fetches nothing, is small and themed, and names the command that comes next."""
    return is_offline(text) and is_themed(text) and NEXT.search(text) is not None


def is_offline(text: str) -> bool:
    """Whether a page fetches nothing and is small."""
    return LOADED.search(text) is None and len(text.encode()) < LARGEST


def tells(text: str) -> bool:
    """Whether `EVIL` stands on a page, and only as text."""
    return EVIL not in text and "<img src=x" not in text and ("&lt;img" in text or "\\u003cimg" in text)


def is_themed(text: str) -> bool:
    """Whether words in figures have the colors of text, light or dark as the page is."""
    return UNTHEMED.search(text) is None
