"""`{schema} fit.json`: the file's JSON Schema as tables, and the schema itself as a file beside the pages."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from roadfiber.schemas import FILES, schema


def kind(one: dict[str, Any]) -> str:
    """What a value is, in a few words.

    >>> kind({"anyOf": [{"type": "array", "items": {"type": "number"}}, {"type": "null"}]})
    'list of number, or null'
    """
    if "$ref" in one:
        return str(one["$ref"]).rpartition("/")[2]
    if "anyOf" in one:
        return ", or ".join(dict.fromkeys(map(kind, one["anyOf"])))
    if "const" in one or "enum" in one:
        return ", ".join(f"“{value}”" for value in one.get("enum", [one.get("const")]))
    if "prefixItems" in one:
        return f"[{', '.join(map(kind, one['prefixItems']))}]"
    named = one.get("type", "anything")
    if named == "array":
        return f"list of {kind(one.get('items', {}))}"
    if named == "object" and isinstance(one.get("additionalProperties"), dict):
        return f"object of {kind(one['additionalProperties'])}"
    words = ", or ".join(named) if isinstance(named, list) else str(named)
    return {"date-time": "time, ISO 8601", "path": "path"}.get(one.get("format", ""), words)


def rows(table: dict[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Key, kind and meaning of each property."""
    needed = table.get("required", [])
    for name, one in table.get("properties", {}).items():
        yield name, kind(one) + ("" if name in needed else "; optional"), one.get("description", "")


class SchemaDirective(SphinxDirective):
    """Tables of a schema."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Make the nodes."""
        file = self.arguments[0]
        made = schema(file)
        found: list[nodes.Node] = [self.link(file), self.table(made)]
        for name, part in made.get("$defs", {}).items():
            if part.get("properties"):
                found += [nodes.rubric(text=name), nodes.paragraph(text=part.get("description", "")), self.table(part)]
        return found

    def link(self, file: str) -> nodes.paragraph:
        """Where the schema is."""
        up = "../" * self.env.docname.count("/")
        place = nodes.reference(text=f"{file}.schema.json", refuri=f"{up}_static/schemas/{file}.schema.json")
        said = nodes.paragraph()
        said += [nodes.Text("Schema: "), place, nodes.Text("; also "), nodes.literal(text=f"roadfiber schema {file}")]
        return said

    def table(self, part: dict[str, Any]) -> nodes.table:
        """One object's keys."""
        group = nodes.tgroup(cols=3)
        group += [nodes.colspec(colwidth=width) for width in (22, 28, 50)]
        body = nodes.tbody()
        for name, what, meaning in rows(part):
            cells = (nodes.literal(text=name), nodes.Text(what), nodes.Text(meaning))
            body += nodes.row("", *(nodes.entry("", nodes.paragraph("", "", cell)) for cell in cells))
        head = nodes.row("", *(nodes.entry("", nodes.paragraph(text=t)) for t in ("key", "value", "meaning")))
        group += [nodes.thead("", head), body]
        return nodes.table("", group, classes=["schema"])


def write_schemas(app: Sphinx, error: Exception | None) -> None:
    """Write every schema beside the pages."""
    folder = Path(app.outdir) / "_static" / "schemas"
    folder.mkdir(parents=True, exist_ok=True)
    for file in FILES:
        (folder / f"{file}.schema.json").write_text(json.dumps(schema(file), indent=1) + "\n", encoding="utf-8")


def setup(app: Sphinx) -> dict[str, Any]:
    """Register with Sphinx."""
    app.add_directive("schema", SchemaDirective)
    app.connect("build-finished", write_schemas)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
