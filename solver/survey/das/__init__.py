"""DAS files of any maker, and arrays in memory, as one record of strain rate."""

from solver.survey.das.decimation import decimated
from solver.survey.das.reader import read_das
from solver.survey.das.record import DASRecord

__all__ = ["DASRecord", "decimated", "read_das"]
