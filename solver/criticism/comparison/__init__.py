"""Model against measurement: where, when and how they differ, in numbers, pictures and words."""

from solver.criticism.comparison.compare import compare
from solver.criticism.comparison.contents import Comparison
from solver.criticism.comparison.files import write_comparison
from solver.criticism.comparison.page import render

__all__ = ["Comparison", "compare", "render", "write_comparison"]
