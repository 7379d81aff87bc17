"""Processing stage: what is done to the record before it is fitted."""

from collections.abc import Callable, Mapping, Sequence

from solver.processing.fk import fk_filter, fk_filtered, fk_mask
from solver.processing.median import median_filtered
from solver.survey.das.record import DASRecord
from vision.contract import InputError

#: The paper's filters, as `locate --filter` names them.
FILTERS: Mapping[str, Callable[[DASRecord], DASRecord]] = {"fk": fk_filtered, "median": median_filtered}


def filtered(record: DASRecord, names: Sequence[str]) -> DASRecord:
    """Return a record after some of `FILTERS`, one after the other; InputError for one that is not known."""
    for name in names:
        if name not in FILTERS:
            raise InputError(f"--filter {name}: not known; choose of {', '.join(FILTERS)}")
        record = FILTERS[name](record)
    return record


__all__ = ["FILTERS", "filtered", "fk_filter", "fk_filtered", "fk_mask", "median_filtered"]
