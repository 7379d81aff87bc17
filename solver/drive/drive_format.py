"""What marks the run folder of a drive."""

from pathlib import Path

FORMAT = "roadfiber drive 3"


def is_drive(folder: Path) -> bool:
    """Whether a folder holds the run of a drive, by the first word of its fit.json."""
    path = Path(folder) / "fit.json"
    try:
        with path.open(encoding="utf-8") as file:
            return f'"{FORMAT.rpartition(" ")[0]} ' in file.read(200)
    except (OSError, UnicodeDecodeError):
        return False
