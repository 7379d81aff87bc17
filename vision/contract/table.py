"""The trajectory table: one row per fix of one vehicle; what `vision` writes and `solver` reads."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from vision.contract.classes import plain_name
from vision.contract.columns import (
    ALSO_CALLED,
    check_meters,
    check_names,
    check_positive,
    finite,
    first_row,
    to_frame,
    with_positions,
)
from vision.contract.csv_table import read_csv
from vision.contract.errors import InputError
from vision.contract.files import writing
from vision.contract.frame import LocalFrame
from vision.contract.gpx import read_gpx
from vision.contract.statements import Statement, Statements, statement
from vision.contract.text import TIME_MEND, YEARS

if TYPE_CHECKING:
    import pandas as pd

COLUMNS = ("time", "track_id", "class", "x", "y", "sigma_x", "sigma_y")
WHEELBASE = ("wheelbase", "sigma_wheelbase")  # of a track, m; optional, and empty where only the class is known
GPS_COLUMNS = ("time", "track_id", "class", "latitude", "longitude", "sigma")
SUFFIXES = (".csv", ".parquet", ".gpx")
TEXT_COLUMNS = ("time", "track_id", "class")
PLACES = ("x", "y", "latitude", "longitude")
# Rows whose text is looked at for the digits of places.
LOOKED_AT = 1000

# A time of day, then Z or an offset; without these the time zone is unknown.
ZONED = r"\d{1,2}:\d{2}.*(?:[Zz]|UTC|[+-]\d{2}(?::?\d{2})?)\s*$"
# What of a time as text says its zone.
OFFSET = r"([Zz]|UTC|[+-]\d{2}(?::?\d{2})?)\s*$"
# Unix times of the years 2001 to 2096, s; in ms, us and ns they are 10^3, 10^6 and 10^9 times that.
UNIX = (1e9, 4e9)
UNIX_UNITS: dict[Literal["s", "ms", "us", "ns"], float] = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}
# Days since 1899-12-30 of the same years, as spreadsheets count.
SPREADSHEET = (36892, 72000)


def read_as_is(path: Path) -> "pd.DataFrame":
    """Read one file by its suffix, unchecked.

    Raises
    ------
    InputError
        If the suffix is unknown or the file is missing, empty or corrupt.
    """
    from pyarrow import ArrowException

    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"{path}: unknown kind of trajectory file; give one of {', '.join(SUFFIXES)}")
    if not path.is_file():
        raise InputError(f"{path}: no such file; give the path of a trajectory table")
    try:
        if suffix == ".csv":
            return read_csv(path, TEXT_COLUMNS)
        return read_parquet(path) if suffix == ".parquet" else read_gpx(path)
    except (OSError, ArrowException) as error:
        reason = str(error).splitlines()[0]
        raise InputError(f"{path}: cannot be read ({reason}); check that the file is whole") from error


def read_parquet(path: Path) -> "pd.DataFrame":
    """Read numbers, times and texts of a parquet file; not what pandas noted there of its own, nor lists and bytes."""
    from pyarrow.parquet import ParquetFile
    from pyarrow.types import is_binary, is_nested, is_string

    with ParquetFile(path) as file:
        kinds = [(one.name, one.type) for one in file.schema_arrow if not (is_nested(one.type) or is_binary(one.type))]
        rows = file.metadata.num_rows
    names = [name for name, _ in kinds]
    if twice := [name for name, count in Counter(names).items() if count > 1]:
        raise InputError(f"{path}: two columns are called {twice[0]}; keep one")
    if rows > path.stat().st_size:
        raise InputError(f"{path}: states {rows} rows in fewer bytes, and no two fixes are alike; write it again")
    # Else each row has a copy of a text that the file holds once.
    text = [name for name, kind in kinds if is_string(kind)]
    with ParquetFile(path, read_dictionary=text) as file:
        table = file.read(names).replace_schema_metadata(None).to_pandas()
    return table.astype(dict.fromkeys(text, object))


def check_columns(table: "pd.DataFrame", path: Path) -> None:
    """Raise InputError unless `table` has rows, and the columns of meters or those of GPS."""
    names = GPS_COLUMNS if "latitude" in table and "x" not in table else COLUMNS
    if missing := [name for name in names if name not in table]:
        raise InputError(
            f"{path}: no column {', '.join(missing)}; a trajectory table has {', '.join(COLUMNS)} "
            f"(GPS: {', '.join(GPS_COLUMNS[3:])} in place of the last four)"
        )
    if table.empty:
        raise InputError(f"{path}: no fixes; a trajectory table has one row per fix")
    for name in ("track_id", "class"):
        if table[name].isna().any():
            raise InputError(f"{path}: row {first_row(table[name].isna())}: {name} is empty; fill it in")


def unix_times(column: "pd.Series") -> "pd.Series | None":
    """Times of a column that counts s, ms, us or ns since 1970, UTC, datetime64[ns, UTC]; None where it does not.

    >>> import pandas as pd
    >>> str(unix_times(pd.Series(["1754892000250", "1754892001250"]))[0])
    '2025-08-11 06:00:00.250000+00:00'
    """
    import pandas as pd

    numbers = pd.to_numeric(column, errors="coerce")
    for unit, factor in UNIX_UNITS.items():
        if numbers.between(UNIX[0] * factor, UNIX[1] * factor).all():
            return pd.to_datetime(numbers, unit=unit, utc=True).dt.round("us" if unit == "s" else "ns")
    return None


def to_utc(column: "pd.Series", path: Path) -> "pd.Series":
    """Times as ISO 8601 text, aware datetimes or numbers since 1970 -> datetime64[ns, UTC].

    Raises
    ------
    InputError
        At the first value that is not a time or has no zone.

    >>> import pandas as pd
    >>> str(to_utc(pd.Series(["2025-08-11T08:00:00.5+02:00"]), Path("a.csv"))[0])
    '2025-08-11 06:00:00.500000+00:00'
    """
    import pandas as pd

    if isinstance(column.dtype, pd.DatetimeTZDtype):
        times, naive = column.dt.tz_convert("UTC"), column.isna()
    elif pd.api.types.is_datetime64_any_dtype(column):
        raise InputError(f"{path}: column time has no time zone; store it as a timestamp in UTC")
    elif (since_1970 := unix_times(column)) is not None:
        return since_1970.dt.as_unit("ns")
    else:
        text = column.astype(str).str.replace(",", ".")
        numbers = pd.to_numeric(text, errors="coerce")
        if numbers.between(*SPREADSHEET).all():
            raise InputError(f"{path}: row 1: time {text.iloc[0]!r} is a day number of a spreadsheet; {TIME_MEND}")
        if numbers.notna().all():
            raise InputError(
                f"{path}: times are numbers from {numbers.min():.16g} to {numbers.max():.16g}, not all in one of s, "
                f"ms, us and ns since 1970; {TIME_MEND}"
            )
        times = pd.to_datetime(text, utc=True, format="ISO8601", errors="coerce")
        naive = ~text.str.contains(ZONED, regex=True)
    strange = (times < YEARS[0]) | (times >= YEARS[1])
    of_no_year = f"is of no year from {YEARS[0].year} to {YEARS[1].year - 1}"
    for bad, problem in ((times.isna(), "is not a time"), (naive, "has no time zone"), (strange, of_no_year)):
        if bad.any():
            row = first_row(bad)
            raise InputError(f"{path}: row {row}: time {str(column.iloc[row - 1])!r} {problem}; {TIME_MEND}")
    return times.dt.as_unit("ns")


def to_meters(table: "pd.DataFrame", frame: LocalFrame | None, path: Path) -> "pd.DataFrame":
    """Return `table` with finite x, y and positive sigma_x, sigma_y, m, GPS projected into `frame`."""
    if "x" in table:
        table = finite(table, COLUMNS[3:], path)
        check_positive(table, ("sigma_x", "sigma_y"), path)
        check_meters(table, frame, path)
        return table
    table = finite(table, GPS_COLUMNS[3:], path)
    check_positive(table, ("sigma",), path)
    if frame is None:
        raise InputError(f"{path}: GPS positions need a frame; give [frame] origin and x_azimuth in site.toml")
    x, y = to_frame(table["latitude"].to_numpy(), table["longitude"].to_numpy(), frame, path)
    rest = table.drop(columns=["latitude", "longitude", "sigma"])
    return rest.assign(x=x, y=y, sigma_x=table["sigma"], sigma_y=table["sigma"])


def with_wheelbase(table: "pd.DataFrame", path: Path) -> "pd.DataFrame":
    """Return `table` with the columns of `WHEELBASE`, where it has them, as numbers, NaN where they are empty.

    Raises
    ------
    InputError
        Where one is given without the other, is not a number, or is not above 0.
    """
    import pandas as pd

    for name in WHEELBASE:
        if name not in table:
            continue
        numbers = pd.to_numeric(table[name], errors="coerce").astype(float)
        bad = table[name].notna() & ~(numbers > 0)
        if bad.any():
            row = first_row(bad)
            raise InputError(
                f"{path}: row {row}: {name} is {str(table[name].iloc[row - 1])!r}; give m above 0 or nothing"
            )
        table = table.assign(**{name: numbers})
    given = [table[name].notna() if name in table else table["class"].isna() for name in WHEELBASE]
    if (lone := given[0] != given[1]).any():
        raise InputError(f"{path}: row {first_row(lone)}: give both of {' and '.join(WHEELBASE)}, or neither")
    return table


def without_repeats(table: "pd.DataFrame", path: Path) -> "pd.DataFrame":
    """Drop rows that repeat another one; a vehicle at two places at once is an InputError."""
    table = table.drop_duplicates()
    twice = table.duplicated(["track_id", "time"])
    if twice.any():
        row = table[twice].iloc[0]
        if (table["time"] == table["time"].dt.floor("s")).all():
            raise InputError(f"{path}: times are whole seconds, several fixes in one; write fractions of seconds too")
        raise InputError(
            f"{path}: track {row['track_id']} is at two places at {row['time'].isoformat()}; "
            "keep one fix, or give two vehicles two track_ids"
        )
    return table


def unmeasured(table: "pd.DataFrame") -> "pd.Series":
    """Which fixes [fix] of an ordered table repeat the last place exactly while the vehicle moved on.

    A receiver or a tracker that loses its vehicle may write the last place again. It does if the vehicle comes to that
    place by more than the sigma of a fix, and is gone from it as fast as it came, or never goes on.

    >>> import pandas as pd
    >>> times = pd.date_range("2025-08-11T06:00:00Z", periods=7, freq="1s")
    >>> rows = {"time": times, "track_id": "a", "x": [0.0, 1, 2, 2, 2, 5, 6], "y": 0.0, "sigma_x": 0.1, "sigma_y": 0.1}
    >>> unmeasured(pd.DataFrame(rows)).tolist()
    [False, False, False, True, True, False, False]
    """
    named = table["track_id"]
    again = (table[["x", "y"]] == table[["x", "y"]].shift()).all(axis=1) & (named == named.shift())
    # Of each place the first fix: how the vehicle came there, and how it went on.
    first, run = table[~again], (~again).cumsum()
    own = first["track_id"] == first["track_id"].shift()
    step = ((first[["x", "y"]].diff() ** 2).sum(axis=1) ** 0.5).where(own)
    came = step / first["time"].diff().dt.total_seconds()
    sudden = step > first[["sigma_x", "sigma_y"]].max(axis=1)
    moved_on = sudden & ~(came.shift(-1) < 0.5 * came)
    return again & moved_on.set_axis(range(1, len(first) + 1)).reindex(run).to_numpy()


def decimals_of(path: Path, names: Sequence[str] = PLACES) -> int | None:
    """Most decimals that columns of a csv are written with; None of another file, whose numbers have no digits."""
    if path.suffix.lower() != ".csv":
        return None
    text = read_csv(path, (*names, *ALSO_CALLED), rows=LOOKED_AT)
    written = with_positions(text).filter(list(names)).stack().astype(str)
    return int(written.str.extract(r"[.,](\d+)", expand=False).str.len().fillna(0).max()) if len(written) else None


def with_rounding(
    table: "pd.DataFrame",
    frame: LocalFrame | None,
    decimals: int,
    columns: Sequence[str] = ("sigma_x", "sigma_y"),
    of: str = "fixes",
) -> "tuple[pd.DataFrame, list[Statement]]":
    """Add the error of rounding to sigmas below it, and say so.

    Parameters
    ----------
    table : with the sigmas, m
    frame : of places in degrees; None of those in meters
    decimals : that places are written with
    columns, of : names of the sigmas, and what they are of

    >>> import pandas as pd
    >>> table, (told,) = with_rounding(pd.DataFrame({"sigma_x": [0.003], "sigma_y": [0.1]}), None, 1)
    >>> table.round(4).values.tolist(), told.caution
    ([[0.029, 0.1]], 'of 1 fixes it is below the 0.029 m by which rounding alone is off; this is added')
    """
    step = 10.0**-decimals
    if frame is not None:
        latitude, longitude = frame.origin
        step = float(np.hypot(*frame.to_local(latitude + step, longitude + step))) / 2**0.5
    error = step / 12**0.5  # the standard deviation of what is spread evenly over a step
    sigma = table[list(columns)]
    below = sigma < error
    if not below.any(axis=None):
        return table, []
    caution = f"of {below.any(axis=1).sum()} {of} it is below the {error:.2g} m by which rounding alone is off"
    told = Statement("sigma", (("places", f"{decimals} decimals"),), "with rounding", f"{caution}; this is added")
    return table.assign(**sigma.mask(below, (sigma**2 + error**2) ** 0.5)), [told]


def read_tracks(
    paths: Sequence[Path], frame: LocalFrame | None = None
) -> "tuple[pd.DataFrame, tuple[Statements, ...]]":
    """Read trajectory files, as `read_trajectories` does, and what each states and what is taken of it."""
    import pandas as pd

    if not paths:
        raise InputError("no trajectory files; give at least one .csv, .parquet or .gpx")
    paths = [Path(path) for path in paths]
    read = [checked_tracks(read_as_is(path), frame, path, decimals_of(path)) for path in paths]
    tables = [table for table, _ in read]
    shared = Counter(name for table in tables for name in table["track_id"].unique())
    for index, (path, table) in enumerate(zip(paths, tables, strict=True)):
        taken = table["track_id"].map(shared) > 1
        tables[index] = table.assign(track_id=table["track_id"].mask(taken, f"{path.stem}:" + table["track_id"]))
    return ordered(pd.concat(tables, ignore_index=True)), tuple(stated for _, stated in read)


def trajectories_of(table: "pd.DataFrame", frame: LocalFrame | None, path: Path = Path("tracks")) -> "pd.DataFrame":
    """Check a table of one source and bring it into the form that `read_trajectories` returns.

    Parameters
    ----------
    table : columns as in `read_trajectories`
    frame : local frame that GPS positions are projected into
    path : its name in errors

    Raises
    ------
    InputError
        As in `read_trajectories`.
    """
    return checked_tracks(table, frame, path)[0]


def checked_tracks(
    table: "pd.DataFrame", frame: LocalFrame | None, path: Path = Path("tracks"), decimals: int | None = None
) -> "tuple[pd.DataFrame, Statements]":
    """Check a table as `trajectories_of` does, and say what it states and what is taken of it.

    `decimals` are those that its places are written with; None where they are not rounded.
    """
    import pandas as pd

    table = with_positions(table)
    check_columns(table, path)
    written, fixes, odd = table["time"].astype(str), len(table), list[Statement]()
    geographic = "latitude" in table and "x" not in table
    if geographic:
        nowhere = (table[["latitude", "longitude"]].apply(pd.to_numeric, errors="coerce") == 0).all(axis=1)
        if nowhere.any() and not nowhere.all():
            odd.append(Statement("no position", (), left_out(nowhere), "receivers without a fix write 0, 0"))
            table = table[~nowhere]
    table = to_meters(table.assign(time=to_utc(table["time"], path)), frame, path)
    if decimals is not None:
        table, told = with_rounding(table, frame if geographic else None, decimals)
        odd += told
    names = {name: table[name].astype(str).str.strip() for name in ("track_id", "class")}
    table = table.assign(track_id=names["track_id"], **{"class": names["class"].map(plain_name)})
    check_names(table, ("track_id", "class"), path)
    table = ordered(without_repeats(with_wheelbase(table, path), path))
    held = unmeasured(table)
    if held.any():
        odd.append(
            Statement("held fixes", (), left_out(held), "they repeat the last place exactly while the vehicle moved on")
        )
        table = table[~held].reset_index(drop=True)
    return table, Statements(path.name, (*stated_rows(table, written, fixes, geographic), *odd))


def left_out(rows: "pd.Series") -> str:
    """How many fixes are left out, in words."""
    return f"{rows.sum()} fixes left out"


def stated_rows(table: "pd.DataFrame", written: "pd.Series", fixes: int, geographic: bool) -> list[Statement]:
    """What a checked table holds: of times as they were `written`, and so many `fixes`."""
    step = table.groupby("track_id", sort=False)["time"].diff().dt.total_seconds()
    usual = float(step.median())
    gaps = int((step > 1.5 * usual).sum())
    sigma = float(table[["sigma_x", "sigma_y"]].max(axis=1).median())
    offsets = sorted(set(written.str.extract(OFFSET, expand=False).fillna("none")))
    classes = ", ".join(
        f"{count} {name}" for name, count in table.groupby("track_id")["class"].first().value_counts().items()
    )
    ends = [time.tz_convert(None).to_datetime64() for time in (table["time"].min(), table["time"].max())]
    columns = "latitude, longitude" if geographic else "x, y"
    return [
        statement("start", (), ends[0]),
        statement("end", (), ends[1]),
        statement("zone", [("time", ", ".join(offsets))], "UTC"),
        statement("rate", (), 1 / usual if usual > 0 else None, unit="fixes/s"),
        statement("vehicles", (), f"{table['track_id'].nunique()} ({classes})"),
        statement("fixes", [("rows", fixes)], f"{len(table)}"),
        statement("places", [("columns", columns)], f"m, usual sigma {sigma:.3g} m"),
        statement("gaps", (), f"{gaps} longer than 1.5 usual steps"),
    ]


def ordered(table: "pd.DataFrame") -> "pd.DataFrame":
    """The table sorted by track and time, the columns of `COLUMNS` first."""
    leading = [*COLUMNS, *(name for name in table if name not in COLUMNS)]
    return table[leading].sort_values(["track_id", "time"], kind="stable", ignore_index=True)


def read_trajectories(paths: Sequence[Path], frame: LocalFrame | None = None) -> "pd.DataFrame":
    r"""Read trajectory files into one table.

    Parameters
    ----------
    paths : `.csv` or `.parquet` with the columns of `COLUMNS`, or GPS: `latitude, longitude, sigma` (or `lat, lon`) in
        place of x, y, sigma_x, sigma_y; or `.gpx`. `wheelbase, sigma_wheelbase` (m) of a track override those of its
        class. Further columns are kept.
    frame : local frame that GPS positions are projected into; not needed for meters

    Returns
    -------
    table [fix] sorted by track and time: `time` datetime64[ns, UTC]; `track_id` text; `class` text, as `plain_name`
        spells it; `x, y, sigma_x, sigma_y` float64, m. A track_id that several files use is told apart as
        `file:track_id`.

    Raises
    ------
    InputError
        If a file is missing, empty, corrupt or of an unknown kind, a column or the frame is missing, a time has no
        zone, a position is not a number or far off the frame, a sigma is not positive, or a track is at two places at
        once.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "tracks.csv"
    >>> _ = path.write_text("time,track_id,class,x,y,sigma_x,sigma_y\n2025-08-11T06:00:00Z,1,Car,2.5,0,.1,.1\n")
    >>> read_trajectories([path])[["track_id", "class", "x"]].values.tolist()
    [['1', 'car', 2.5]]
    """
    return read_tracks(paths, frame)[0]


def write_trajectories(table: "pd.DataFrame", path: Path) -> None:
    """Write a trajectory table, whole or not at all.

    Parameters
    ----------
    table : as `read_trajectories` returns it; further columns are written after those of `COLUMNS`
    path : `.csv` (times ISO 8601 in UTC with microseconds) or `.parquet`; an existing file is replaced

    Raises
    ------
    InputError
        If the suffix is neither, or a column of `COLUMNS` is missing.
    """
    path = Path(path)
    if path.suffix.lower() not in (".csv", ".parquet"):
        raise InputError(f"{path}: trajectories are written as .csv or .parquet; give one of these suffixes")
    if missing := [name for name in COLUMNS if name not in table]:
        raise InputError(f"{path}: no column {', '.join(missing)} to write; a trajectory table needs them")
    table = table[[*COLUMNS, *(name for name in table if name not in COLUMNS)]]
    with writing(path) as temporary:
        if path.suffix.lower() == ".parquet":
            table.to_parquet(temporary, index=False)
        else:
            text = table["time"].dt.tz_convert("UTC").dt.strftime("%Y-%m-%dT%H:%M:%S.%fZ")
            table.assign(time=text).to_csv(temporary, index=False, float_format="%.10g")
