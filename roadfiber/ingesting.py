"""A record of any length: kept at the rate of the fit, and looked at."""

import time as clock
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from solver.survey.das.description import describe
from solver.survey.das.ingest import ingest as ingest_record
from solver.survey.das.lowpass import FIT_RATE
from solver.survey.das.opened import Raw, opened, plain
from solver.survey.das.store import FILE, Store
from solver.survey.site import Site, read_site
from vision.contract import InputError
from vision.contract.statements import Statement, Statements
from vision.contract.table import read_tracks

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Seconds that are looked at of files without a store where nobody says how many.
LOOKED_AT = 600.0


@dataclass(frozen=True)
class Ingested:
    """A store that was written.

    Parameters
    ----------
    store : its folder
    start, end : UTC
    sampling_rate : Hz
    channels : first and last
    dead : channels that hold no signal
    noise : median of the channels' noise, 1/s
    bytes : that the store takes, and `raw_bytes` that its files do
    gaps : how many
    cautions : what is left out and why, and what else must be known, a line each
    statements : what each file of the record and of the tracks states, and what was taken of it
    seconds : that this call took
    """

    store: Path
    start: str
    end: str
    sampling_rate: float
    channels: tuple[int, int]
    dead: int
    noise: float
    bytes: int
    raw_bytes: int
    gaps: int
    cautions: tuple[str, ...]
    statements: tuple[Statements, ...]
    seconds: float

    def to_dict(self) -> dict[str, Any]:
        """What `roadfiber ingest --json` prints."""
        return asdict(self) | {"store": str(self.store), "channels": list(self.channels)}

    def record(self, **part: Any) -> Any:
        """Read the store, or a part of it: `channels` (first, last), `times` [(start, end)]."""
        return Store.open(self.store).record(**part)


def ingest(site: Path | str, out: Path | str | None = None, *, rate: float = FIT_RATE) -> Ingested:
    """Keep a record of any length at the rate of the fit, filtered and decimated once, with its health.

    Memory does not grow with the length. A call that was ended, however, is gone on with by the next. `locate` uses the
    store as long as site.toml and the files stay as they are.

    Parameters
    ----------
    site : path of a site.toml, or of its folder; neither camera nor trajectories are needed
    out : folder of the store; `store` in `[das]` of site.toml by default, and that `das-store` beside it
    rate : sampling rate wanted, Hz, or a little above

    Returns
    -------
    ingested : where the store is, and how the record is. `channels.csv` and `files.csv` there are the health tables

    Raises
    ------
    InputError
        If no file can be used, or the store cannot be written: parts that are there stay.

    Examples
    --------
    >>> done = rf.ingest(folder / "survey" / "site.toml", folder / "store")
    >>> done.sampling_rate, done.dead, len(done.record(channels=(40, 60)).channel)
    (5.0, 0, 21)
    """
    begun = clock.perf_counter()
    described = site_of(Path(site))
    das = described.das
    if not rate > 0:
        raise InputError(f"rate {rate:g} Hz; give one above 0")
    folder = das.store if out is None else Path(out)
    known = describe(das.files, **das.said)
    store = ingest_record(known, das.files, plain(das.said), folder, rate)
    return Ingested(
        store=folder,
        start=f"{np.datetime_as_string(store.start, unit='ms')}Z",
        end=f"{np.datetime_as_string(store.end, unit='ms')}Z",
        sampling_rate=1e9 / store.interval,
        channels=store.channels,
        dead=int(store.table["dead"].sum()),
        noise=float(np.nanmedian(store.table["noise"])),
        bytes=sum(path.stat().st_size for path in folder.iterdir() if path.is_file()),
        raw_bytes=sum(max(0, one.bytes) for one in store.said.files),
        gaps=len(store.said.gaps),
        cautions=store.said.cautions,
        statements=(*store.statements, *tracks_stated(described)),
        seconds=clock.perf_counter() - begun,
    )


def site_of(path: Path) -> Site:
    """A site.toml, or the one in a folder; it need not name trajectories."""
    return read_site(path / "site.toml" if path.is_dir() else path, moving=False)


def tracks_stated(site: Site) -> tuple[Statements, ...]:
    """What each track file states, where there are any; of files that cannot be read, why not."""
    if site.trajectories is None:
        return ()
    try:
        return read_tracks(site.trajectories.files, site.frame)[1]
    except InputError as error:
        return (Statements("trajectories", (Statement("tracks", (), "", str(error)),)),)


def moment(text: str | float, start: np.datetime64) -> np.datetime64:
    """A time in UTC: of ISO format, or s since `start`.

    >>> str(moment("2025-08-11T06:00:10Z", np.datetime64("2025-08-11T06:00:00", "ns")))[:19]
    '2025-08-11T06:00:10'
    >>> str(moment(90, np.datetime64("2025-08-11T06:00:00", "ns")))[:19]
    '2025-08-11T06:01:30'
    """
    try:
        return start + np.timedelta64(round(float(text) * 1e9), "ns")
    except ValueError:
        pass
    try:
        return np.datetime64(str(text).removesuffix("Z"), "ns")
    except ValueError as error:
        raise InputError(f"time {text!r}; give UTC as 2025-08-11T06:00:10Z, or seconds since the start") from error


def view(
    site: Path | str,
    start: str | float | None = None,
    end: str | float | None = None,
    channels: tuple[int, int] | None = None,
) -> "Figure":
    """Draw the waterfall of a record, or of a part of it; no trajectories are needed.

    Parameters
    ----------
    site : path of a site.toml or its folder, of a store that `ingest` wrote, or of one DAS file
    start, end : UTC as "2025-08-11T06:00:10Z", or s since the record's start. All of a store by default, or ten minutes
        of files
    channels : first and last; all by default

    Returns
    -------
    figure : strain rate in sigmas of each channel's noise, and the noise

    Raises
    ------
    InputError
        If nothing was recorded then or there.

    Examples
    --------
    >>> figure = rf.view(folder / "survey", start=10, end=60, channels=(40, 120))
    >>> figure.axes[0].get_ylabel()
    'channel'
    """
    return draw_view(site, start, end, channels).figure


@dataclass(frozen=True, eq=False)
class View:
    """What `view` drew.

    Parameters
    ----------
    figure : of it
    statements : what each file that was read states, and the track files, and what is taken of it
    cautions : what must be known about what was read, a line each
    """

    figure: "Figure"
    statements: tuple[Statements, ...]
    cautions: tuple[str, ...]


def draw_view(
    site: Path | str,
    start: str | float | None = None,
    end: str | float | None = None,
    channels: tuple[int, int] | None = None,
) -> View:
    """Draw the waterfall of `view`, and say what its files state and what of them was not measured."""
    from solver.survey.view_figure import waterfall

    source = source_of(Path(site))
    first = source.start if start is None else moment(start, source.start)
    last = source.end if end is None else moment(end, source.start)
    if end is None and isinstance(source, Raw):
        last = min(last, first + np.timedelta64(round(LOOKED_AT * 1e9), "ns"))
    if not (first < last and first < source.end and last > source.start):
        whole = " to ".join(f"{np.datetime_as_string(one, unit='s')}Z" for one in (source.start, source.end))
        raise InputError(f"{site}: nothing from {first}Z to {last}Z; the record is from {whole}")
    if channels is not None and not source.channels[0] <= channels[0] < channels[1] <= source.channels[1]:
        held = f"{source.channels[0]} to {source.channels[1]}"
        raise InputError(f"{site}: no channels {channels[0]} to {channels[1]}; the record has {held}")
    record = source.record(channels=channels, times=[(first, last)])
    path = Path(site)
    of_survey = not (is_store(path) or is_record(path))
    tracks = tracks_stated(site_of(path)) if of_survey else ()
    return View(waterfall(record), (*record.statements, *tracks), record.cautions)


def is_store(path: Path) -> bool:
    """Whether a path is that of a store."""
    return (path / FILE).is_file()


def is_record(path: Path) -> bool:
    """Whether a path is that of one DAS file."""
    return path.is_file() and path.suffix.lower() != ".toml"


def source_of(site: Path) -> Store | Raw:
    """Open the record of a survey, a store, or one DAS file."""
    if is_store(site):
        return Store.open(site)
    if is_record(site):
        return Raw(describe([site]))
    das = site_of(site).das
    return opened(das.files, das.said, das.store)
