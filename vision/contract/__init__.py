"""What the packages agree on: errors, the local frame, the trajectory table, whole-file writing, progress.

`solver` imports this and nothing else of `vision`.
"""

from vision.contract.errors import InputError
from vision.contract.files import require_writable, writing, writing_into
from vision.contract.frame import LocalFrame
from vision.contract.progress import progress
from vision.contract.table import COLUMNS, WHEELBASE, read_trajectories, trajectories_of, write_trajectories
from vision.contract.text import read_text, read_toml

__all__ = [
    "COLUMNS",
    "WHEELBASE",
    "InputError",
    "LocalFrame",
    "progress",
    "read_text",
    "read_toml",
    "read_trajectories",
    "require_writable",
    "trajectories_of",
    "write_trajectories",
    "writing",
    "writing_into",
]
