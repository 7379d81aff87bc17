"""Run folders beside the one that is on the workbench, and what of a diagnosis lies in one."""

from pathlib import Path
from typing import Any


def reserved(folder: Path) -> Path:
    """An empty folder beside another, of its name and the first number that is free: two benches never share one.

    >>> import tempfile
    >>> first = Path(tempfile.mkdtemp()) / "run"
    >>> reserved(first).name, reserved(first).name
    ('run-2', 'run-3')
    """
    number = 2
    while True:
        path = folder.with_name(f"{folder.name}-{number}")
        try:
            path.mkdir()
            return path
        except FileExistsError:
            number += 1


def kept_candidates(folder: Path) -> list[dict[str, Any]]:
    """Candidates of a run's diagnosis, best first; none where there is none, or it cannot be read."""
    from solver.run.report.joined import facts_in, rows_in

    rows = rows_in(facts_in(folder, "diagnosis.json"), "candidates")
    return [row for row in rows if isinstance(row.get("effect"), str) and isinstance(row.get("told"), dict)]
