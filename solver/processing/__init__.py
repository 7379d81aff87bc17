"""Processing stage: what is done to the record before it is fitted."""

from solver.processing.decimation import FIT_RATE, decimated
from solver.processing.fk import fk_filter, fk_filtered, fk_mask
from solver.processing.median import median_filtered

__all__ = ["FIT_RATE", "decimated", "fk_filter", "fk_filtered", "fk_mask", "median_filtered"]
