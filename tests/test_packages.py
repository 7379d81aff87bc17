"""What the packages may import of each other, and what must be installed beside them."""

import ast
import subprocess
import sys
from importlib.metadata import distributions
from pathlib import Path

import cv2
import pytest

ROOT = Path(__file__).parents[1]
FOREIGN = {
    "vision": ("solver", "calib", "roadfiber"),
    "calib": ("solver", "roadfiber"),
    "solver": ("calib", "roadfiber"),
}


def imports(path: Path) -> set[str]:
    """Names of the modules that a file imports, wherever in it."""
    found = set[str]()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module)
    return found


@pytest.mark.parametrize("package", FOREIGN)
def test_packages_depend_one_way(package: str) -> None:
    for path in (ROOT / package).rglob("*.py"):
        for name in imports(path):
            assert name.split(".")[0] not in FOREIGN[package], f"{path.name} imports {name}"


def test_solver_knows_only_the_contract_of_vision() -> None:
    for path in (ROOT / "solver").rglob("*.py"):
        for name in imports(path):
            assert not name.startswith("vision") or name.startswith("vision.contract"), f"{path.name} imports {name}"


def test_the_simulator_shares_nothing_with_the_signal_path() -> None:
    shared = {f"solver.{stage}" for stage in ("load", "ground", "cable", "interrogator", "model", "fit", "coupling")}
    for path in (ROOT / "solver" / "simulator").rglob("*.py"):
        assert not any(name.startswith(tuple(shared)) or name == "torch" for name in imports(path)), path.name


def test_opencv_is_the_contrib_build_and_alone() -> None:
    """Any other build of OpenCV overwrites its files without pip noticing."""
    assert hasattr(cv2, "ximgproc")
    names = {name.lower() for d in distributions() if (name := d.metadata["Name"]) and "opencv" in name.lower()}
    assert names == {"opencv-contrib-python-headless"}


def test_help_needs_no_heavy_package() -> None:
    code = (
        "import sys, roadfiber.command; "
        "heavy = {'torch', 'onnxruntime', 'dascore', 'panel', 'pandas', 'scipy', 'cv2', 'matplotlib'}; "
        "print(sorted(heavy & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.strip() == "[]"


def test_help_lists_the_commands() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "roadfiber", "--help"], capture_output=True, text=True, check=True, cwd=ROOT
    )
    for command in ("locate", "track", "calibrate", "simulate", "demo", "workbench"):
        assert command in done.stdout
