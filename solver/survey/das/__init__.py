"""DAS files of any maker, and arrays in memory, as one record of strain rate."""

from solver.survey.das.decimation import decimated
from solver.survey.das.record import DASRecord, read_das

__all__ = ["DASRecord", "decimated", "read_das"]
