"""The report of a run: figures, words, and one page that opens offline."""

from solver.run.report.page import render
from solver.run.report.words import told

__all__ = ["render", "told"]
