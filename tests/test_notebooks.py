"""Every notebook runs from its first cell to its last, and is kept executed, so that it teaches without being run."""

import ast
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib
import matplotlib.pyplot as plt
import pytest
import torch

NOTEBOOKS = sorted((Path(__file__).parents[1] / "notebooks").glob("*.ipynb"))
#: Those that look into the rooms; the others use the door alone.
INSIDE = {"3_the_signal_path", "paper"}
#: What a notebook may take, bytes.
LARGEST = 1_100_000

each = pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)


def cells(notebook: Path, kind: str = "") -> list[dict[str, Any]]:
    content = json.loads(notebook.read_text(encoding="utf-8"))
    assert content["nbformat"] == 4
    return [cell for cell in content["cells"] if cell["cell_type"].startswith(kind)]


def run_cell(source: str, name: str, names: dict[str, Any]) -> None:
    """Run a cell as a notebook does: what stands last is shown, as a page where it has one."""
    body = ast.parse(source, name).body
    last = body.pop() if body and isinstance(body[-1], ast.Expr) else None
    exec(compile(ast.Module(body, []), name, "exec"), names)
    if isinstance(last, ast.Expr):
        shown = eval(compile(ast.Expression(last.value), name, "eval"), names)
        getattr(shown, "_repr_html_", shown.__repr__)()


def test_there_are_notebooks():
    assert len(NOTEBOOKS) >= 6


@pytest.fixture(autouse=True)
def torch_as_it_was() -> Iterator[None]:
    """A notebook may set the precision that it computes with; the tests after it have their own."""
    before = torch.get_default_dtype()
    yield
    torch.set_default_dtype(before)


@each
def test_a_notebook_runs(notebook: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    matplotlib.use("Agg")
    names: dict[str, Any] = {"__name__": "__main__"}
    for number, cell in enumerate(cells(notebook, "code")):
        run_cell("".join(cell["source"]), f"{notebook.name}, cell {number}", names)
    plt.close("all")


@each
def test_a_notebook_is_kept_executed_in_order_and_without_errors(notebook: Path):
    assert cells(notebook)[0]["cell_type"] == "markdown" and cells(notebook)[0]["source"][0].startswith("# ")
    code = cells(notebook, "code")
    assert [cell["execution_count"] for cell in code] == list(range(1, len(code) + 1))
    outputs = [output for cell in code for output in cell["outputs"]]
    assert not [output for output in outputs if output["output_type"] == "error" or output.get("name") == "stderr"]
    assert sum("image/png" in output.get("data", {}) for output in outputs) >= 2, "pictures teach"
    text = notebook.read_text(encoding="utf-8")
    assert len(text) < LARGEST
    assert not re.findall(r"(?:/(?:tmp|home|root)/|C:\\\\)[\w/]+", text), "a path of the machine that ran it"


@each
def test_a_notebook_uses_the_door_alone(notebook: Path):
    if notebook.stem in INSIDE:
        return
    source = "\n".join("".join(cell["source"]) for cell in cells(notebook, "code"))
    found = {
        name.split(".")[0]
        for node in ast.walk(ast.parse(source))
        for name in (
            [a.name for a in node.names] if isinstance(node, ast.Import) else [getattr(node, "module", "") or ""]
        )
    }
    assert "roadfiber" in found and not found & {"solver", "vision", "calib"}
    assert "from roadfiber." not in source
