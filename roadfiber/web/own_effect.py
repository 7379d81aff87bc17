"""The code box: what it begins with, and where its text is kept."""

import re
from pathlib import Path

from vision.contract import InputError, writing

#: File name that the box begins with.
NAME = "my_effect.py"
#: Ten lines that define an effect.
TEMPLATE = """\
from roadfiber import Parameter, effect


@effect(
    "downforce", "load", [Parameter("share", "1", 0.05, lower=-0.5, upper=0.5)],
    physics="Air presses on a vehicle, by the square of its speed.", source="Hucho 1998, section 2.",
)
def downforce(load, p, survey):
    factor = 1 + p["share"] * (load.trajectory.speed / 30) ** 2
    return load.modulated(factor, 0 * factor)
"""
#: A file name of Python code.
PYTHON = re.compile(r"[A-Za-z_]\w{0,60}\.py")


def kept_beside(run: Path, name: str, text: str, written: dict[Path, str]) -> Path:
    """Write a file beside a run, never into a run folder, and never over one that was not written from here.

    Parameters
    ----------
    run : its folder
    name : of the file
    written : texts of the files that were written from here; this one is added

    Raises
    ------
    InputError
        If the name is none of a Python file, or taken, or it cannot be written.
    """
    if not PYTHON.fullmatch(name):
        raise InputError(f"{name}: no file name; give one such as my_effect.py")
    path = run.parent / name
    if (path.parent / "fit.json").exists():
        raise InputError(f"{path.parent}: is a run folder, which holds no code; move the run elsewhere")
    if path.exists() and written.get(path) != path.read_text(encoding="utf-8", errors="replace"):
        raise InputError(f"{path}: is there already, and not from here; choose another name")
    with writing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    written[path] = text
    return path
