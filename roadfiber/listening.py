"""Vehicles that the fiber heard, beside those that the camera saw."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from solver.run.heard_passes import heard_with
from solver.run.run import Run
from solver.run.strict_json import strict
from solver.start.heard import Hearing, Paired, middle_times, pair
from solver.start.initialization import initialize
from solver.start.regauge import shorter_gauges
from solver.survey.survey import Survey
from solver.trajectory.passes import smooth_passes
from solver.trajectory.vehicle_pass import Pass
from vision.contract import InputError
from vision.contract.rounding import with_sigma

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, repr=False)
class Vehicles:
    """Vehicles that the fiber heard, matched with those that the camera saw.

    Parameters
    ----------
    paired : what was heard and what was seen
    passes : that were seen
    start : of the record, UTC
    """

    paired: Paired
    passes: list[Pass]
    start: np.datetime64

    @property
    def clock_offset(self) -> float:
        """Time by the record less time by the trajectories, s; NaN without a pair."""
        return self.paired.offset

    @property
    def clock_sigma(self) -> float:
        """Standard deviation of `clock_offset`, s."""
        return self.paired.sigma

    @property
    def unheard(self) -> list[str]:
        """Tracks that go by the middle of the channels and were not heard."""
        heard = set(self.paired.seen.tolist())
        there = np.isfinite(self.paired.middle)
        return [one.track_id for number, one in enumerate(self.passes) if there[number] and number not in heard]

    @cached_property
    def table(self) -> "pd.DataFrame":
        """One row per vehicle that was heard.

        `time` (UTC) of passing the middle of the channels; `speed`, m/s along x; `snr_db` and `share` of the channels
        that heard it; `track_id` and `class`, empty where no camera saw it; `late`, s after the track.
        """
        import pandas as pd

        heard, seen = self.paired.heard, self.paired.seen
        known = [self.passes[number] if number >= 0 else None for number in seen]
        middle = [self.paired.middle[number] if number >= 0 else np.nan for number in seen]
        time = np.array([one.time for one in heard])
        stamp = self.start.astype("datetime64[ns]") + (1e9 * time).astype("timedelta64[ns]")
        return pd.DataFrame(
            {
                "time": pd.to_datetime(stamp, utc=True),
                "speed": [one.speed for one in heard],
                "snr_db": [one.snr_db for one in heard],
                "share": [one.share for one in heard],
                "track_id": [one.track_id if one else "" for one in known],
                "class": [one.vehicle_class if one else "" for one in known],
                "late": time - np.array(middle, float),
            }
        )

    @property
    def headline(self) -> str:
        """How many were heard and seen, and how far the clocks are apart, in a line."""
        both = int((self.paired.seen >= 0).sum())
        alone = len(self.paired.heard) - both
        said = f"the fiber heard {len(self.paired.heard)} vehicles; {both} of them are in the trajectories"
        said += f", {alone} {'is' if alone == 1 else 'are'} not" if alone else ""
        if self.unheard:
            said += f"; {len(self.unheard)} that the camera saw were not heard"
        if not np.isfinite(self.clock_offset):
            return said
        way = "ahead of" if self.clock_offset > 0 else "behind"
        return (
            f"{said}; the record's clock is {with_sigma(abs(self.clock_offset), self.clock_sigma)} s {way} the tracks'"
        )

    @cached_property
    def facts(self) -> dict[str, Any]:
        """What `roadfiber vehicles --json` prints."""
        rows = self.table.assign(time=self.table["time"].map(lambda one: one.isoformat()))
        facts = {"headline": self.headline, "clock_offset": self.clock_offset, "clock_sigma": self.clock_sigma}
        checked: dict[str, Any] = strict(facts | {"unheard": self.unheard, "vehicles": rows.to_dict("records")})
        return checked

    def __repr__(self) -> str:
        return f"<Vehicles: {self.headline}>"

    def _repr_html_(self) -> str:
        return f"<p>{self.headline}</p>{self.table.to_html(index=False)}"


def vehicles(survey: Survey | Path | str, run: Run | None = None) -> Vehicles:
    """List the vehicles that the fiber heard, matched with those that the camera saw.

    The matched filter's map of place and time is searched for straight lines, at all times of the record: vehicles that
    nobody listed are found too. Pairs of what was heard and seen tell how far the clocks are apart.

    On a busy street vehicles hide each other. With a run of the survey, its vehicles are those that have a weight in
    its fit, and others are listened for in what it leaves; `locate` with `unlisted` fits them, too, which finds most.

    Parameters
    ----------
    survey : as `read` returns it or built in memory, with trajectories; or the path of a site.toml
    run : of this survey, as `locate` returns it

    Returns
    -------
    vehicles : its `table`, `clock_offset`, `clock_sigma`, `unheard`

    Raises
    ------
    InputError
        If the survey cannot be used, no vehicle of the trajectories is seen in the record, or the run is of another.

    Examples
    --------
    >>> heard = rf.vehicles(survey)
    >>> bool(len(heard.table) >= 2), heard.table.columns[0]
    (True, 'time')
    """
    whole = survey if isinstance(survey, Survey) else Survey.read(survey)
    if whole.tracks is None:
        raise InputError(f"{whole.name}: has a camera only; track its video first and give the trajectories")
    passes = smooth_passes(whole.tracks, whole.record)
    believed = whole.ground.means
    rough = initialize(shorter_gauges(whole.record), passes, **believed, sure=False)
    record = whole.at_all_times().record
    passes = smooth_passes(whole.tracks, record)
    if run is None:
        heard = Hearing.of(shorter_gauges(record), rough, **believed).vehicles()
    else:
        heard = heard_with(run, record, rough, shorter_gauges, believed)
    x0, slope = rough.x_of_channel
    middle = middle_times(passes, x0 + slope * float(rough.channel.mean()), record.time)
    return Vehicles(pair(heard, middle, np.array([one.speed for one in passes])), passes, record.start)
