"""What the code says of itself: commands, public names that no page of a folder shows, terms of its pages.

`{commands}` is every command as `--help` has it, `{other-names}` and `{terms}` are the others.
"""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective


def leaves(command: Any, name: str) -> Iterator[tuple[str, Any]]:
    """Commands without commands of their own, by their full names."""
    below = getattr(command, "commands", None)
    if below is None:
        yield name, command
        return
    for word, one in below.items():
        yield from leaves(one, f"{name} {word}")


def label(parameter: Any) -> str:
    """How a parameter is written."""
    if parameter.param_type_name == "argument":
        return str(parameter.name).upper()
    return ", ".join(parameter.opts)


class CommandsDirective(SphinxDirective):
    """One section per command."""

    def run(self) -> list[nodes.Node]:
        """Make the nodes."""
        import typer

        from roadfiber.command import app

        return [self.section(name, one) for name, one in sorted(leaves(typer.main.get_command(app), "roadfiber"))]

    def section(self, name: str, command: Any) -> nodes.section:
        """What one command does and takes."""
        made = nodes.section(ids=[nodes.make_id(name)], names=[nodes.fully_normalize_name(name)])
        made += nodes.title(text=name)
        for part in (command.help or "").split("\n\n"):
            made += self.parse_text_to_nodes(part.strip())
        shown = [one for one in command.params if one.name not in ("help",) and not one.hidden]
        items = nodes.definition_list()
        for one in shown:
            term = nodes.term("", "", nodes.literal(text=label(one)))
            text = self.parse_text_to_nodes(one.help or "")
            items += nodes.definition_list_item("", term, nodes.definition("", *text))
        if shown:
            made += items
        return made


class OtherNamesDirective(SphinxDirective):
    """Public names that no page beside this one shows."""

    def run(self) -> list[nodes.Node]:
        """Make the nodes."""
        import roadfiber as rf

        folder = Path(self.env.doc2path(self.env.docname)).parent
        shown = "".join(page.read_text(encoding="utf-8") for page in folder.glob("*.md"))
        lines = ["```{eval-rst}"]
        for name in rf.__all__:
            if not re.search(rf":: roadfiber\.{name}$", shown, re.MULTILINE):
                kind = "autoclass" if isinstance(getattr(rf, name), type) else "autofunction"
                lines += [f".. {kind}:: roadfiber.{name}", *(["   :members:"] if kind == "autoclass" else [])]
        return self.parse_text_to_nodes("\n".join([*lines, "```"])) if len(lines) > 1 else []


class TermsDirective(SphinxDirective):
    """The terms that pages use, as they tell them."""

    def run(self) -> list[nodes.Node]:
        """Make the nodes."""
        from solver.run.report.glossary import TERMS

        listed = nodes.definition_list()
        for name, words in TERMS.items():
            meaning = nodes.definition("", nodes.paragraph(text=words))
            listed += nodes.definition_list_item("", nodes.term(text=name, ids=[nodes.make_id(name)]), meaning)
        return [listed]


def setup(app: Sphinx) -> dict[str, Any]:
    """Register with Sphinx."""
    app.add_directive("commands", CommandsDirective)
    app.add_directive("other-names", OtherNamesDirective)
    app.add_directive("terms", TermsDirective)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
