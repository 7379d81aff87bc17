"""What is wrong with single files of a record costs those files, and is told; nothing is silently wrong."""

import shutil

import h5py
import numpy as np
import pytest

from solver.survey.das.description import describe
from solver.survey.das.prodml import write_prodml
from solver.survey.das.reader import read_das, record_from
from solver.survey.das.samples import InHDF5
from vision.contract import InputError

START = np.datetime64("2025-08-11T06:00:00", "ns")
ROWS, RATE = 400, 100.0
WHOLE = 1e-8 * np.random.default_rng(0).normal(size=(10 * ROWS, 12))


def das_file(path, part, rows=ROWS, shift=0, **changes):
    """One of ten files of 4 s, begun `shift` samples late."""
    setting = {"sampling_rate": RATE, "gauge_length": 10.0, "channel_spacing": 1.0} | changes
    start = START + np.timedelta64((part * ROWS + shift) * 10, "ms")
    channels = setting.pop("channels", 12)
    write_prodml(path, WHOLE[part * ROWS : part * ROWS + rows, :channels], start=start, **setting)
    return path


@pytest.fixture
def files(tmp_path):
    return [das_file(tmp_path / f"{part}.h5", part) for part in range(10)]


def check(record, missing):
    """All samples but those of some rows are there, and right."""
    there = np.isfinite(record.strain_rate).all(1)
    assert np.flatnonzero(~there).tolist() == list(missing)
    assert np.allclose(record.strain_rate[there], WHOLE[: len(there)][there], rtol=1e-6, atol=0)


def truncated(path):
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])


def emptied(path):
    path.write_bytes(b"")


def spoilt(path):
    path.write_bytes(b"not what it was" * 500)


@pytest.mark.parametrize(
    ("damage", "why"),
    [
        (truncated, "3.h5 (HDF5 that breaks off after "),
        (emptied, "3.h5 (an empty file, 0 bytes; copy it again)"),
        (spoilt, "3.h5 (text, whatever its name says"),
        (lambda path: path.unlink(), "3.h5 (no such file"),
        (lambda path: das_file(path, 3, channels=11), "3.h5 (channels 11, but 12 in 0.h5)"),
        (lambda path: das_file(path, 3, gauge_length=5.0), "3.h5 (gauge length 5.0, but 10.0 in 0.h5)"),
        (lambda path: das_file(path, 3, channel_spacing=2.0), "3.h5 (channel spacing 2.0, but 1.0 in 0.h5)"),
        (lambda path: das_file(path, 3, first_channel=4), "3.h5 (first channel 4, but 0 in 0.h5)"),
        (lambda path: das_file(path, 3, sampling_rate=200.0), "3.h5 (200 samples/s, but 100 in 0.h5)"),
    ],
)
def test_a_file_in_the_middle_that_cannot_be_used_is_left_out(files, damage, why):
    damage(files[3])
    record = read_das(files)
    check(record, range(3 * ROWS, 4 * ROWS))
    assert record.cautions[0].startswith(f"of 10 files this is left out: {why}")
    assert record.cautions[1].startswith("the record has a gap of 4.0 s, from 2025-08-11T06:00:12Z to 06:00:16Z")
    assert len(record.provenance["left_out"]) == 1
    assert not any(path.endswith("3.h5") for path in record.provenance["files"])


def test_files_need_not_be_sorted(files, tmp_path):
    check(read_das([files[i] for i in (4, 2, 9, 0, 1, 3, 8, 7, 6, 5)]), [])


def test_a_file_given_twice_is_taken_once(files, tmp_path):
    copy = tmp_path / "copy of 4.h5"
    shutil.copy(files[4], copy)
    record = read_das([*files, copy])
    check(record, [])
    assert record.cautions == ("of 11 files this is left out: copy of 4.h5 (4 s that 4.h5 holds too are taken once)",)


def test_files_that_begin_before_the_last_one_ends_are_taken_once(files):
    das_file(files[4], 4, rows=ROWS + 60)
    record = read_das(files)
    check(record, [])
    assert record.cautions == ("of 10 files this is left out: 5.h5 (0.6 s that 4.h5 holds too are taken once)",)


def test_a_clock_that_is_set_back_costs_what_is_in_doubt(files):
    das_file(files[5], 5, shift=-30)
    record = read_das(files)
    missing = np.flatnonzero(~np.isfinite(record.strain_rate).all(1)).tolist()
    # 0.3 s that two files claim, and as much at the end of the one that was moved.
    assert missing == [*range(1970, 2000), *range(2370, 2400)]
    assert "0.3 s overlap 4.h5 with other numbers, so that a clock was set back" in record.cautions[0]
    assert "check them against the camera" in record.cautions[0]


def test_a_clock_that_is_set_forward_leaves_a_gap_and_what_it_then_overlaps(files):
    das_file(files[9], 9, shift=250)
    record = read_das(files)
    assert record.gaps == ((pytest.approx(36.0), pytest.approx(38.49)),)


def test_half_of_another_setting_is_refused(files):
    for part in range(5, 10):
        das_file(files[part], part, gauge_length=5.0)
    with pytest.raises(InputError, match=r"5\.h5: gauge length 5\.0, but 10\.0 in 0\.h5; give files of one recording"):
        read_das(files)


def test_no_file_that_can_be_read_is_the_first_one_s_fault(files):
    for path in files:
        emptied(path)
    with pytest.raises(InputError, match=r"0\.h5: an empty file"):
        read_das(files)


def test_damage_that_only_reading_shows_is_left_out_and_told(files):
    # A chunk of the compressed numbers is overwritten: the header stays right.
    with h5py.File(files[3]) as file:
        numbers = file["Acquisition/Raw[0]/RawData"]
        chunk = numbers.id.get_chunk_info(numbers.id.get_num_chunks() - 1)
    with files[3].open("r+b") as stream:
        stream.seek(chunk.byte_offset)
        stream.write(b"\xff" * chunk.size)
    known = describe(files)
    assert isinstance(known.blocks[3].data, InHDF5) and known.left_out == ()
    for record, missing in ((read_das(files), slice(1200, 1600)), (record_from(known, rate=20.0), slice(250, 310))):
        assert not np.isfinite(record.strain_rate[missing]).any()
        assert record.measured.mean() > 0.8
        (line,) = (line for line in record.cautions if "3.h5" in line)
        assert "damaged or incomplete" in line


def test_many_files_left_out_are_counted(files):
    for part in (1, 3, 5, 6, 8):
        emptied(files[part]) if part < 6 else files[part].unlink()
    line = read_das(files).cautions[0]
    assert line.count("0 bytes") == 3
    assert line.endswith(", and 2 more")
