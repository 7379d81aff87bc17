"""The run folder: route, fit and report of a located fiber, written whole and read back."""

from solver.run.folder import check_target, open_run, read_run, write_run
from solver.run.run import Run

__all__ = ["Run", "check_target", "open_run", "read_run", "write_run"]
