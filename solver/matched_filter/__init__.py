"""The paper's matched filter: where the vehicles are seen in the DAS, and so where a fit begins."""

from solver.matched_filter.chain import Trace, trace
from solver.matched_filter.initialization import Initialization, initialize

__all__ = ["Initialization", "Trace", "initialize", "trace"]
