"""Locate, and the run it returns: route, fit and report of a fiber, written whole and read back."""

from solver.run.folder import check_target, read_run, write_run
from solver.run.run import Run, run_of

__all__ = ["Run", "check_target", "read_run", "run_of", "write_run"]
