"""Model against measurement: where, when and how they differ, in numbers, pictures and words."""

from solver.criticism.comparison.compare import compare
from solver.criticism.comparison.comparison import Comparison
from solver.criticism.comparison.comparison_files import write_comparison
from solver.criticism.comparison.comparison_page import render

__all__ = ["Comparison", "compare", "render", "write_comparison"]
