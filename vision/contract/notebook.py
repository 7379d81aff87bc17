"""Pages in notebooks."""

from html import escape


def framed(page: str, height: int = 640) -> str:
    """A whole page as a part of another, in a frame that keeps its style and scripts to itself.

    Parameters
    ----------
    page : HTML of a page that needs no other file
    height : of the frame, CSS pixels

    >>> framed("<p>a</p>", 40)
    '<iframe srcdoc="&lt;p&gt;a&lt;/p&gt;" style="width:100%;height:40px;border:0"></iframe>'
    """
    return f'<iframe srcdoc="{escape(page)}" style="width:100%;height:{height}px;border:0"></iframe>'
