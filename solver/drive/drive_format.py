"""What marks the run folder of a drive."""

from pathlib import Path

from vision.contract import InputError

FORMAT = "roadfiber drive 2"


def is_drive(folder: Path) -> bool:
    """Whether a folder holds the run of a drive, by the first word of its fit.json."""
    path = Path(folder) / "fit.json"
    try:
        with path.open(encoding="utf-8") as file:
            return f'"{FORMAT.rpartition(" ")[0]} ' in file.read(200)
    except (OSError, UnicodeDecodeError):
        return False


def require_street(folder: Path) -> None:
    """Refuse the run folder of a drive where that of a street is needed; InputError says what to give."""
    if is_drive(folder):
        raise InputError(f"{folder}: the run of a drive, which has one car; give the run of a street")
