"""The report of a run: figures, words, and one page that opens offline."""

from solver.run.report.report_page import render
from solver.run.report.report_words import told

__all__ = ["render", "told"]
