"""The report of a run: figures, words, and one page that opens offline."""

from solver.report.page import render
from solver.report.words import cautions

__all__ = ["cautions", "render"]
