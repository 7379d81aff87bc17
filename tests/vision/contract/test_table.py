import logging

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from pyarrow import parquet as pq

from vision.contract import COLUMNS, InputError, LocalFrame, read_trajectories, write_trajectories
from vision.contract.columns import with_positions
from vision.contract.table import checked_tracks, read_tracks, trajectories_of

FRAME = LocalFrame((32.113, 34.804), 78.0)
HEADER = ",".join(COLUMNS)
ROW = "2025-08-11T06:00:00.25Z,1,Car,2.5,-1.5,0.1,0.2"
GPS_HEADER = "time,track_id,class,latitude,longitude,sigma"


def written(folder, text, name="tracks.csv"):
    path = folder / name
    path.write_text(text)
    return path


def a_table(rows=3):
    return pd.DataFrame(
        {
            "time": pd.date_range("2025-08-11T06:00:00.123456Z", periods=rows, freq="80ms").as_unit("ns"),
            "track_id": ["7"] * rows,
            "class": ["bus"] * rows,
            "x": np.arange(rows) * 1.25,
            "y": -0.5,
            "sigma_x": 0.05,
            "sigma_y": 0.07,
            "confidence": 0.9,
        }
    )


def test_meters_are_taken_as_they_are(tmp_path):
    table = read_trajectories([written(tmp_path, f"{HEADER},length\n{ROW},4.5\n")])
    assert list(table) == [*COLUMNS, "length"]
    assert str(table["time"].dtype) == "datetime64[ns, UTC]"
    assert table["time"][0] == pd.Timestamp("2025-08-11T06:00:00.25Z")
    assert table[["track_id", "class"]].to_numpy().tolist() == [["1", "car"]]
    assert table[["x", "y", "sigma_x", "sigma_y", "length"]].to_numpy().tolist() == [[2.5, -1.5, 0.1, 0.2, 4.5]]


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_written_table_reads_back(tmp_path, suffix):
    write_trajectories(a_table(), tmp_path / f"tracks{suffix}")
    back = read_trajectories([tmp_path / f"tracks{suffix}"])
    pd.testing.assert_frame_equal(back, a_table(), check_dtype=False)
    assert sorted(path.name for path in tmp_path.iterdir()) == [f"tracks{suffix}"]


def test_csv_times_are_utc_with_microseconds(tmp_path):
    local = a_table(1).assign(time=a_table(1)["time"].dt.tz_convert("Asia/Jerusalem"))
    write_trajectories(local, tmp_path / "tracks.csv")
    assert (tmp_path / "tracks.csv").read_text().splitlines()[1].startswith("2025-08-11T06:00:00.123456Z,7,bus,")


@pytest.mark.parametrize(
    ("name", "drop", "says"), [("tracks.xlsx", [], ".csv or .parquet"), ("a.csv", ["y"], "column y")]
)
def test_what_cannot_be_written_leaves_nothing(tmp_path, name, drop, says):
    with pytest.raises(InputError, match=says):
        write_trajectories(a_table().drop(columns=drop), tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_times_with_an_offset_become_utc(tmp_path):
    row = ROW.replace("06:00:00.25Z", "08:00:00.25+02:00")
    assert read_trajectories([written(tmp_path, f"{HEADER}\n{row}\n")])["time"][0].hour == 6


def test_gps_is_projected(tmp_path):
    latitude, longitude = FRAME.to_geographic([30.0], [-4.0])
    row = f"2025-08-11T06:00:00Z,1,car,{latitude[0]:.9f},{longitude[0]:.9f},0.5"
    table = read_trajectories([written(tmp_path, f"{GPS_HEADER}\n{row}\n")], FRAME)
    assert np.allclose(table[["x", "y", "sigma_x", "sigma_y"]], [[30.0, -4.0, 0.5, 0.5]], atol=1e-3)
    assert "latitude" not in table


@pytest.mark.parametrize("names", ["lat,lon", "Lat,Lng", "lat,longitude"])
def test_latitude_and_longitude_may_have_their_short_names(tmp_path, names):
    latitude, longitude = FRAME.to_geographic([30.0], [-4.0])
    row = f"2025-08-11T06:00:00Z,1,car,{latitude[0]:.9f},{longitude[0]:.9f},0.5"
    header = GPS_HEADER.replace("latitude,longitude", names)
    table = read_trajectories([written(tmp_path, f"{header}\n{row}\n")], FRAME)
    np.testing.assert_allclose(table[["x", "y"]], [[30.0, -4.0]], atol=1e-3)


def test_short_names_beside_meters_or_long_ones_are_left_alone():
    for header in ("x,y,lat,lon", "latitude,longitude,lat,lon", "lat"):
        table = pd.DataFrame(columns=header.split(","))
        assert list(with_positions(table)) == header.split(",")


@pytest.mark.parametrize("namespace", ["", ' xmlns="http://www.topografix.com/GPX/1/1"'])
def test_gpx_segments_are_tracks(tmp_path, namespace, caplog):
    point = '<trkpt lat="{}" lon="34.804"><time>2025-08-11T06:00:0{}Z</time></trkpt>'
    segments = [f"<trkseg>{point.format(32.113 + k * 1e-4, k)}{point.format(32.1131, k + 3)}</trkseg>" for k in (0, 1)]
    track = f"<trk><name>tour</name><type>Van</type>{''.join(segments)}</trk>"
    path = written(tmp_path, f"<gpx{namespace}>{track}<trk>{segments[0]}</trk></gpx>", "tour.gpx")
    with caplog.at_level(logging.INFO, logger="roadfiber"):
        table = read_trajectories([path], FRAME)
    assert sorted(set(table["track_id"])) == ["2", "tour/1", "tour/2"]
    assert set(table["class"]) == {"van", "vehicle"}
    assert set(table["sigma_x"]) == {3.0}
    assert "3 m assumed" in caplog.text


def test_the_same_track_id_in_two_files_is_two_vehicles(tmp_path):
    other = ROW.replace(",1,Car", ",2,Car")
    first = written(tmp_path, f"{HEADER}\n{ROW}\n{other}\n", "east.csv")
    second = written(tmp_path, f"{HEADER}\n{ROW}\n", "west.csv")
    assert set(read_trajectories([first, second])["track_id"]) == {"east:1", "west:1", "2"}


def test_repeated_rows_count_once(tmp_path):
    assert len(read_trajectories([written(tmp_path, f"{HEADER}\n{ROW}\n{ROW}\n")])) == 1


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "empty file"),
        (HEADER + "\n" + ROW.replace("Car", "Car\x1b[2J"), r"row 1: class is 'car\x1b[2j'; give at most 200 char"),
        (f"{HEADER}\n{ROW.replace(',1,', ',' + 'a' * 70_000 + ',')}\n", "row 1: track_id is 'aaaa"),
        (HEADER + "\n", "no fixes"),
        ("time,track_id,class,x\na,b,c,d", "no column y, sigma_x, sigma_y"),
        ("time,track_id,class,latitude\na,b,c,d", "no column longitude, sigma"),
        (f"{HEADER}\n{ROW}\n{ROW.replace('2025-08-11T06:00:00.25Z', 'noon')}", "row 2: time 'noon' is not a time"),
        (
            f"{HEADER}\n"
            + "\n".join(ROW.replace("2025-08-11T06:00:00.25Z", t) for t in ("1754892000250", "1754892001250000")),
            "times are numbers from 1754892000250 to 1754892001250000, not all in one of s, ms, us and ns since 1970",
        ),
        (f"{HEADER}\n{ROW.replace('2025', '9999')}", "row 1: time '9999-08-11T06:00:00.25Z' is of no year from 1970"),
        (f"{HEADER}\n{ROW.replace('25Z', '25')}", "row 1: time '2025-08-11T06:00:00.25' has no time zone; write ISO"),
        (f"{HEADER}\n{ROW.replace('T06:00:00.25Z', '')}", "has no time zone"),
        (f"{HEADER}\n{ROW.replace('2025-08-11T06:00:00.25Z', '')}", "row 1: time 'nan' is not a time"),
        (f"{HEADER}\n{ROW.replace('2.5', '')}", "row 1: x is 'nan'"),
        (f"{HEADER}\n{ROW.replace('2.5', 'inf')}", "row 1: x is 'inf'"),
        (f"{HEADER}\n{ROW.replace('-1.5', 'left')}", "row 1: y is 'left'"),
        (f"{HEADER}\n{ROW.replace(',0.2', ',0')}", "row 1: sigma_y is 0; give a standard deviation above 0 m"),
        (f"{HEADER}\n{ROW.replace(',0.2', ',1e-300')}", "row 1: sigma_y is 1e-300; give a standard deviation above 0"),
        (f"{HEADER}\n{ROW.replace(',0.2', ',1e300')}", "row 1: sigma_y is 1e+300; give a standard deviation above 0 m"),
        (f"{HEADER}\n{ROW.replace(',1,', ',,')}", "row 1: track_id is empty"),
        (f"{HEADER}\n{ROW}\n{ROW.replace('2.5', '9.5')}", "track 1 is at two places at 2025-08-11T06:00:00.25"),
        (f"{HEADER}\n{ROW}\n{ROW},1,2,3\n", "cannot be read (Error tokenizing data"),
        (
            f"{HEADER}\n{ROW.replace('.5', ',5')}\n",
            "row 1 has 9 fields, but the header 7; with decimal commas, separate",
        ),
        (f"{HEADER},x\n{ROW},1\n", "column x is there twice"),
        (
            f"{HEADER}\n{ROW.replace('2025-08-11T06:00:00.25Z', '45880.2502')}",
            "is a day number of a spreadsheet; write",
        ),
        (f"{HEADER}\n{ROW.replace('.25Z', 'Z')}\n{ROW.replace('.25Z', 'Z').replace('2.5', '9.5')}", "whole seconds"),
        (
            f"{HEADER}\n{ROW.replace('2.5,-1.5', '32.1135,34.8041')}",
            "x and y hold latitude and longitude; name the",
        ),
        (
            f"{HEADER}\n{ROW.replace('2.5,-1.5', '34.8041,32.1135')}",
            "x and y hold longitude and latitude; name the",
        ),
        (
            f"{HEADER}\n{ROW.replace('2.5,-1.5', '670032,3541851.3')}",
            "row 1: x and y are 670032 and 3541851.3, which are no meters of a local frame",
        ),
    ],
)
def test_bad_csv_is_one_clear_line(tmp_path, text, says):
    path = written(tmp_path, text)
    with pytest.raises(InputError) as caught:
        read_trajectories([path], FRAME)
    assert says in str(caught.value)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("place", "says"),
    [
        ("97.0,34.8", "row 1: latitude is 97; give degrees within ±90"),
        ("32.1,190.0", "row 1: longitude is 190"),
        ("34.804,32.113", "look swapped, there or in the frame's origin"),
        ("33.113,36.804", "km from the frame's origin"),
        (",34.8", "row 1: latitude is 'nan'"),
    ],
)
def test_bad_positions_are_one_clear_line(tmp_path, place, says):
    path = written(tmp_path, f"{GPS_HEADER}\n2025-08-11T06:00:00Z,1,car,{place},0.5\n")
    with pytest.raises(InputError, match=says):
        read_trajectories([path], FRAME)


def test_gps_needs_a_frame(tmp_path):
    path = written(tmp_path, f"{GPS_HEADER}\n2025-08-11T06:00:00Z,1,car,32.1,34.8,0.5\n")
    with pytest.raises(InputError, match="need a frame"):
        read_trajectories([path])


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("a.parquet", b"PAR1 no such thing", "cannot be read"),
        ("a.gpx", b"<gpx><trk>", "not a readable GPX file"),
        ("a.gpx", b"<gpx></gpx>", "no fixes"),
        ("a.csv", b"\xff\xfe\x00\x01", "no column time"),
        ("a.csv", b"PK\x03\x04" + bytes(50), "a workbook or an archive, no csv; open it and save it as CSV UTF-8"),
        ("a.csv", bytes(range(256)), "is not text"),
        ("a.csv", f"{HEADER}\n{ROW}".encode().replace(b"Car", b"C\xe4r"), r"not UTF-8 text \(byte 0xe4\)"),
        ("a.txt", b"", "unknown kind of trajectory file; give one of .csv, .parquet, .gpx"),
    ],
)
def test_bad_files_are_one_clear_line(tmp_path, name, content, says):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=says):
        read_trajectories([tmp_path / name], FRAME)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be"])
@pytest.mark.parametrize(
    "form",
    [
        lambda text: text,
        lambda text: text.replace(",", ";"),
        lambda text: text.replace(",", "\t"),
        lambda text: text.replace(",", ";").replace(".", ","),
        lambda text: f"sep=;\n# made by hand\n{text}".replace(",", ";").replace("\n", "\r\n"),
        lambda text: text.replace(HEADER, HEADER.upper().replace(",", " , ")),
    ],
    ids=["commas", "semicolons", "tabs", "decimal commas", "Excel", "padded"],
)
def test_tables_as_other_programs_write_them(tmp_path, encoding, form):
    (tmp_path / "a.csv").write_text(form(f"{HEADER}\n{ROW}\n{ROW.replace('00.25', '00.35')}\n"), encoding, newline="")
    table = read_trajectories([tmp_path / "a.csv"], FRAME)
    assert table["time"].dt.microsecond.tolist() == [250000, 350000]
    assert table.iloc[0][["track_id", "class", *COLUMNS[3:]]].tolist() == ["1", "car", 2.5, -1.5, 0.1, 0.2]


@pytest.mark.parametrize("time", ["1754892000.25", "1754892000250", "1754892000250000", "1754892000250000000"])
def test_times_since_1970_are_utc(tmp_path, time):
    table = read_trajectories([written(tmp_path, f"{HEADER}\n{ROW.replace('2025-08-11T06:00:00.25Z', time)}\n")])
    assert table["time"][0] == pd.Timestamp("2025-08-11T06:00:00.25Z")


def test_gpx_without_times_is_refused(tmp_path):
    path = written(tmp_path, '<gpx><trk><trkseg><trkpt lat="32.1" lon="34.8"/></trkseg></trk></gpx>', "a.gpx")
    with pytest.raises(InputError, match="row 1: time '' is not a time"):
        read_trajectories([path], FRAME)


def test_missing_files_are_one_clear_line(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_trajectories([tmp_path / "none.csv"])
    with pytest.raises(InputError, match="no trajectory files"):
        read_trajectories([])


def parquet(folder, columns, noted=None):
    """A parquet file with some columns of `a_table` replaced, and with what pandas would note in it."""
    table = pa.Table.from_pandas(a_table(), preserve_index=False)
    for name, column in columns.items():
        there = name in table.column_names
        table = table.set_column(table.column_names.index(name), name, column) if there else table
        table = table if there else table.append_column(name.strip("+"), column)
    pq.write_table(table.replace_schema_metadata(noted or {}), folder / "a.parquet", compression="zstd")
    return folder / "a.parquet"


@pytest.mark.parametrize("noted", [b"\xff", b"[]", b'{"index_columns":["none"],"columns":[]}'])
def test_what_pandas_notes_in_parquet_is_not_taken(tmp_path, noted):
    read = read_trajectories([parquet(tmp_path, {}, {b"pandas": noted})])
    pd.testing.assert_frame_equal(read, trajectories_of(a_table(), None))


@pytest.mark.parametrize(
    ("columns", "says"),
    [
        ({"track_id": [["a"]]}, "no column track_id"),
        ({"class": [b"\xff"]}, "no column class"),
        ({"+x": [1.0]}, "two columns are called x; keep one"),
    ],
)
def test_columns_of_parquet_that_cannot_be_are_one_line(tmp_path, columns, says):
    columns = {name: pa.array(value * len(a_table())) for name, value in columns.items()}
    with pytest.raises(InputError, match=says):
        read_trajectories([parquet(tmp_path, columns)])


def test_parquet_of_alike_rows_is_not_unfolded(tmp_path):
    pq.write_table(pa.table({"x": np.zeros(10**6)}), tmp_path / "a.parquet", compression="zstd")
    with pytest.raises(InputError, match="states 1000000 rows in fewer bytes"):
        read_trajectories([tmp_path / "a.parquet"])


@pytest.mark.parametrize("zone", [None, "Asia/Jerusalem"])
def test_parquet_needs_a_zone_too(tmp_path, zone):
    table = a_table()
    table["time"] = table["time"].dt.tz_convert(zone) if zone else table["time"].dt.tz_localize(None)
    table.to_parquet(tmp_path / "a.parquet")
    if zone is None:
        with pytest.raises(InputError, match="has no time zone; store it as a timestamp in UTC"):
            read_trajectories([tmp_path / "a.parquet"])
    else:
        assert read_trajectories([tmp_path / "a.parquet"])["time"][0] == a_table()["time"][0]


def test_practice_surveys_read(shared_data):
    paths = sorted(shared_data.glob("practice/survey-*/trajectories.csv"))
    assert len(paths) == 14
    for path in paths:
        table = read_trajectories([path], FRAME)
        assert table["x"].between(-100, 200).all()
        assert 8 <= table["track_id"].nunique() <= 10


@pytest.mark.parametrize(
    ("header", "values", "complaint"),
    [
        ("wheelbase", "2.7", "give both of wheelbase and sigma_wheelbase"),
        ("wheelbase,sigma_wheelbase", "2.7,", "give both of wheelbase and sigma_wheelbase"),
        ("wheelbase,sigma_wheelbase", "long,0.1", "row 1: wheelbase is 'long'; give m above 0 or nothing"),
        ("wheelbase,sigma_wheelbase", "2.7,0", "row 1: sigma_wheelbase is '0"),
    ],
)
def test_wheelbases_that_cannot_be_used(header, values, complaint, tmp_path):
    path = tmp_path / "t.csv"
    path.write_text(f"{','.join(COLUMNS)},{header}\n2025-08-11T06:00:00Z,1,car,2.5,-1.5,0.1,0.2,{values}\n")
    with pytest.raises(InputError, match=complaint):
        read_trajectories([path])


def test_wheelbases_come_and_go_by_track(tmp_path):
    path = tmp_path / "t.csv"
    rows = ["1,car,2.5,-1.5,0.1,0.2,2.48,0.06", "2,bus,9.5,-1.5,0.1,0.2,,"]
    path.write_text(
        f"{','.join(COLUMNS)},wheelbase,sigma_wheelbase\n" + "".join(f"2025-08-11T06:00:00Z,{row}\n" for row in rows)
    )
    table = read_trajectories([path])
    assert table["wheelbase"].tolist()[0] == 2.48 and table["wheelbase"].isna().tolist() == [False, True]
    assert table["sigma_wheelbase"].dtype == float


@pytest.mark.parametrize(
    ("header", "places", "sigma", "error"),
    [
        (HEADER, ("2.5,0.5", "3.1,0.0"), 0.001, 0.029),
        (HEADER, ("2.512,0.5", "3.1,0.0"), 0.001, None),
        (GPS_HEADER, ("32.11301,34.80412", "32.11298,34.80422"), 0.01, 0.3),
        (GPS_HEADER, ("32.1130112,34.80412", "32.11298,34.80422"), 0.01, None),
    ],
)
def test_a_sigma_below_what_digits_carry_is_raised_and_told(tmp_path, header, places, sigma, error):
    stated_sigma = f"{sigma},{sigma}" if header == HEADER else f"{sigma}"
    rows = [f"2025-08-11T06:00:0{second}Z,1,car,{place},{stated_sigma}" for second, place in enumerate(places)]
    table, (stated,) = read_tracks([written(tmp_path, "\n".join([header, *rows]))], FRAME)
    if error is None:
        assert stated.cautions == [] and (table["sigma_x"] == sigma).all()
    else:
        assert table["sigma_x"].to_numpy() == pytest.approx(np.hypot(sigma, error), rel=0.03)
        told = f"sigma: of 2 fixes it is below the {error:.2g} m by which rounding alone is off; this is added"
        assert stated.cautions == [told]


def test_fixes_without_a_position_are_left_out_and_told(tmp_path):
    rows = [
        f"2025-08-11T09:00:0{second}+03:00,1,car,{place},2"
        for second, place in enumerate(["32.113,34.804"] * 2 + ["0,0"])
    ]
    rows[1] = rows[1].replace("34.804", "34.8041001")
    table, (stated,) = read_tracks([written(tmp_path, "\n".join([GPS_HEADER, *rows]))], FRAME)
    assert len(table) == 2
    assert stated.cautions == ["no position: receivers without a fix write 0, 0"]
    told = {one.what: one for one in stated.rows}
    assert (told["zone"].stated, told["zone"].taken) == ((("time", "+03:00"),), "UTC")
    assert (told["start"].taken, told["fixes"].stated, told["fixes"].taken) == (
        "2025-08-11T06:00:00.000Z",
        (("rows", "3"),),
        "2",
    )


@pytest.mark.parametrize(
    ("x", "kept"),
    [
        ([0, 8, 16, 16, 16, 40, 48], [0, 8, 16, 40, 48]),  # frozen for two fixes
        ([0, 8, 16, 24, 24, 24, 24], [0, 8, 16, 24]),  # frozen to the end
        ([0, 0, 10, 10, 20, 20, 30], [0, 0, 10, 20, 30]),  # written twice as often as it was measured
        ([0, 8, 12, 12, 12, 13, 15], [0, 8, 12, 12, 12, 13, 15]),  # waits, and goes on
        ([5, 5, 5, 5, 5, 5, 5], [5, 5, 5, 5, 5, 5, 5]),  # parked
    ],
)
def test_places_that_are_held_while_a_vehicle_moves_on_are_left_out(x, kept):
    table, stated = checked_tracks(a_table(7).assign(x=np.array(x, float)), None)
    assert table["x"].tolist() == kept
    assert bool(stated.cautions) == (x != kept)
