"""The house stands as ARCHITECTURE.md draws it: rooms, order, and imports that run one way."""

import ast
import re
from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SOLVER = ROOT / "solver"


def drawn() -> list[list[str]]:
    """Rooms of solver by floor, top floor first, as the picture in ARCHITECTURE.md has them."""
    text = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    picture = re.search(r"```text\n(.*?)```", text, re.S)
    assert picture, "ARCHITECTURE.md has no picture"
    return [re.findall(r"\b([a-z_]+)/", line) for line in picture[1].splitlines() if "/" in line]


def name_of(path: Path) -> str:
    """Dotted name of a module."""
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


MODULES = {name_of(path): path for path in SOLVER.rglob("*.py")}


def imported(name: str) -> set[str]:
    """Modules of solver that a module imports, within functions too."""
    tree = ast.parse(MODULES[name].read_text(encoding="utf-8"))
    found = set[str]()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "solver":
            for alias in node.names:
                full = f"{node.module}.{alias.name}"
                found.add(full if full in MODULES else str(node.module))
    return found - {name}


def room_of(name: str) -> str:
    """Folder of solver that a module stands in; "" for those that stand in none."""
    parts = name.split(".")
    return parts[1] if len(parts) > 1 and (SOLVER / parts[1]).is_dir() else ""


def test_the_picture_has_every_room_once() -> None:
    rooms = Counter(room for floor in drawn() for room in floor)
    folders = {path.parent.name for path in SOLVER.glob("*/__init__.py")}
    assert set(rooms) == folders
    assert max(rooms.values()) == 1


@pytest.mark.parametrize("room", sorted({room_of(name) for name in MODULES} - {""}))
def test_imports_run_down(room: str) -> None:
    floor = {name: number for number, names in enumerate(drawn()) for name in names}
    for name in MODULES:
        if room_of(name) == room:
            for other in imported(name):
                there = room_of(other)
                assert there in ("", room) or floor[there] > floor[room], f"{name} imports {other}, which is not below"


def test_solver_shows_a_newcomer_few_things() -> None:
    assert len([path for path in SOLVER.iterdir() if path.name != "__pycache__"]) <= 20


def test_no_two_modules_of_one_name() -> None:
    names = Counter(path.name for path in SOLVER.rglob("*.py") if path.name != "__init__.py")
    assert [name for name, count in names.items() if count > 1] == []
