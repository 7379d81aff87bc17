"""Mathematics as MathML, made when the page is built: no script and no network are needed to read it."""

from typing import Any

from docutils.nodes import SkipNode
from math_core import LatexError, LatexToMathML
from sphinx.application import Sphinx
from sphinx.util import logging

CONVERTER = LatexToMathML(fancy_error=False)


def formula(node: Any, *, as_block: bool) -> str:
    """A formula as MathML; a warning, which ends a strict build, where it is not understood."""
    try:
        return CONVERTER.convert_with_local_state(node.astext(), displaystyle=as_block)
    except LatexError as error:
        logging.getLogger(__name__).warning("%s", error, location=node)
        return ""


def inline(translator: Any, node: Any) -> None:
    """Write a formula in a sentence."""
    translator.body.append(formula(node, as_block=False))
    raise SkipNode


def block(translator: Any, node: Any) -> None:
    """Write a formula on a line of its own."""
    translator.body.append(f'<div class="formula">{formula(node, as_block=True)}</div>\n')
    raise SkipNode


def setup(app: Sphinx) -> dict[str, Any]:
    """Register with Sphinx."""
    app.add_html_math_renderer("mathml", (inline, None), (block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
