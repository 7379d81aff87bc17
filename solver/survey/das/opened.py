"""A record ready to be read in part: from its store if that was made from the same files, else from the files."""

import json
import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from solver.survey.das.description import Description, describe
from solver.survey.das.lowpass import FIT_RATE
from solver.survey.das.reader import record_from
from solver.survey.das.record import DASRecord
from solver.survey.das.store import FILE, Store
from vision.contract import InputError
from vision.contract.statements import Statements

logger = logging.getLogger("roadfiber")

Times = Sequence[tuple[np.datetime64, np.datetime64]]


@dataclass(frozen=True)
class Raw:
    """Files that are decimated while they are read; attributes and `record` as in `Store`."""

    known: Description

    @property
    def start(self) -> np.datetime64:
        """Time of the first sample, UTC."""
        return self.known.start

    @property
    def end(self) -> np.datetime64:
        """Time of the last sample, UTC."""
        return self.known.end

    @property
    def channels(self) -> tuple[int, int]:
        """First and last channel."""
        return self.known.channels

    @property
    def statements(self) -> tuple[Statements, ...]:
        """What each file states, and what is taken of it."""
        return self.known.statements

    @property
    def channel_spacing(self) -> float:
        """Of the channels, m."""
        return self.known.channel_spacing

    def record(self, *, channels: tuple[int, int] | None = None, times: Times | None = None) -> DASRecord:
        """Read the record, or a part of it, at the rate of the fit."""
        return record_from(self.known, channels=channels, times=times, rate=FIT_RATE)


def plain(said: dict[str, Any]) -> dict[str, Any]:
    """Settings as plain JSON values."""
    found: dict[str, Any] = json.loads(json.dumps(said))
    return found


def opened(files: Sequence[Path], said: dict[str, Any], folder: Path | None = None) -> Store | Raw:
    """Open a record.

    Parameters
    ----------
    files, said : as in `solver.survey.das.description.describe`
    folder : where its store may be; a store of other files or settings is not used, and a message says so

    Raises
    ------
    InputError
        As in `describe`.
    """
    if folder is not None and (folder / FILE).is_file():
        try:
            store = Store.open(folder)
            why = store.stale(files, plain(said))
        except InputError as error:
            logger.warning("%s; the DAS files are read instead", error)
        else:
            if why is None:
                return store
            logger.warning(
                "%s: %s since it was made; the DAS files are read instead, roadfiber ingest renews it", folder, why
            )
    return Raw(describe(files, **said))
