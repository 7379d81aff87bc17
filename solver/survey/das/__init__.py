"""DAS files of any maker as one record of strain rate."""

from solver.survey.das.record import DASRecord, read_das

__all__ = ["DASRecord", "read_das"]
