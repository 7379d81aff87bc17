"""Reading a part of a record, and reducing it as it is read, give what reading all and reducing that gives."""

import json
import tracemalloc

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from solver.survey.das import decimated, read_das
from solver.survey.das.array_files import LARGE
from solver.survey.das.description import describe
from solver.survey.das.prodml import write_prodml
from solver.survey.das.reader import record_from
from solver.survey.das.reduced import SLAB
from solver.survey.das.samples import InHDF5, OnDisk
from solver.survey.das.units import strain_per_radian

START = np.datetime64("2025-08-11T06:00:00", "ns")
SCALES = {"1/s": 1e-8, "strain": 1e-9, "rad": 1.0, "rad/s": 1e-2, "m/s": 1e-7}


def signal(rows, channels, seed=0):
    return np.random.default_rng(seed).normal(size=(rows, channels)).cumsum(0) * 0.1


def array_files(folder, unit, parts, rate=100.0, rows=700, channels=30):
    whole = SCALES[unit] * signal(rows * (max(parts) + 1), channels)
    paths = []
    for part in parts:
        path = folder / f"{part}.npy"
        np.save(path, whole[part * rows : (part + 1) * rows].astype(np.float32 if unit != "rad" else np.float64))
        at = START + np.timedelta64(round(part * rows * 1e9 / rate), "ns")
        side = {"start": f"{at}Z", "sampling_rate": rate, "channel_spacing": 1.0, "gauge_length": 4.0, "unit": unit}
        path.with_suffix(".json").write_text(json.dumps(side))
        paths.append(path)
    return paths


def same(found, wanted, tolerance=2e-6):
    """Numbers agree as far as single precision goes, and none is there that was not."""
    both = np.isfinite(found) & np.isfinite(wanted)
    assert not (np.isfinite(found) & ~np.isfinite(wanted)).any()
    assert both.mean() > 0.6
    assert np.abs(found - wanted)[both].max() < tolerance * np.abs(wanted[both]).max()
    # A filter that also differentiates leaves 20 samples more out, a fifth of a second, at either end of both runs.
    assert (np.isfinite(wanted) & ~np.isfinite(found)).any(1).sum() <= 16


@pytest.mark.parametrize("unit", list(SCALES))
def test_all_quantities_reduce_alike_as_they_are_read(tmp_path, unit):
    paths = array_files(tmp_path, unit, [0, 1, 3])
    slow, found = decimated(read_das(paths)), record_from(describe(paths), rate=20.0)
    same(found.strain_rate, slow.strain_rate, 2e-5 if unit in ("strain", "rad") else 2e-6)
    assert found.strain_rate.dtype == np.float32
    assert np.allclose(found.time, slow.time, atol=1e-9)
    assert (found.start, found.gaps, found.cautions) == (slow.start, slow.gaps, slow.cautions)
    assert (found.gauge_length, found.sampling_rate) == (slow.gauge_length, slow.sampling_rate)
    assert np.array_equal(found.channel, slow.channel)
    assert np.array_equal(found.distance, slow.distance)


def test_slabs_do_not_show(tmp_path, monkeypatch):
    paths = array_files(tmp_path, "1/s", [0, 1])
    whole = record_from(describe(paths), rate=20.0).strain_rate
    monkeypatch.setattr("solver.survey.das.reduced.SLAB", 4 * 30 * 37)
    again = record_from(describe(paths), rate=20.0).strain_rate
    assert np.array_equal(np.isfinite(again), np.isfinite(whole))
    assert np.nanmax(np.abs(again - whole)) < 1e-6 * np.nanmax(np.abs(whole))


def test_a_part_is_what_it_is_in_the_whole(tmp_path):
    paths = array_files(tmp_path, "1/s", [0, 1, 2, 3])
    known = describe(paths)
    whole = record_from(known, rate=20.0)
    second = np.timedelta64(1, "s")
    times = [(START + 3 * second, START + 6 * second), (START + 15 * second, START + 20 * second)]
    part = record_from(known, rate=20.0, channels=(4, 9), times=times)
    assert part.start == START + 3 * second
    assert part.channel.tolist() == [4, 5, 6, 7, 8, 9]
    row = round(float((part.start - whole.start) / second) * 20)
    there = whole.strain_rate[row : row + len(part.time), 4:10]
    read = part.measured
    assert np.abs(part.strain_rate[read] - there[read]).max() < 2e-6 * np.nanmax(np.abs(there))
    assert read[:60].all() and not read[70:230].any() and read[240:340].all()
    assert part.gaps == ()
    assert (part.recorded.start, part.recorded.channels) == (START, (0, 29))
    assert part.recorded.end == START + np.timedelta64(27_990, "ms")
    assert whole.recorded.channels == (0, 29) and whole.extent is None
    # Files of which nothing was wanted are not named, nor is their checksum taken.
    assert [path.rpartition("/")[2] for path in part.provenance["files"]] == ["0.npy", "2.npy"]
    slow = record_from(known, channels=(4, 9), times=times)
    assert np.array_equal(slow.strain_rate[:300], read_das(paths).strain_rate[300:600, 4:10])


def test_stored_integers_show_their_steps_and_where_they_are_cut_off(tmp_path):
    values = np.clip(np.rint(300 * signal(2000, 8)), -900, 900).astype(np.int16)
    values[:, 5] = 7
    np.save(tmp_path / "a.npy", values)
    side = {"start": f"{START}Z", "sampling_rate": 100.0, "channel_spacing": 1.0, "gauge_length": 4.0}
    (tmp_path / "a.json").write_text(json.dumps(side))
    said = {"quantity": "strain_rate", "scale": 1e-11}
    slow = decimated(read_das([tmp_path / "a.npy"], **said))
    found = record_from(describe([tmp_path / "a.npy"], **said), rate=20.0)
    same(found.strain_rate[:, ~found.dead], slow.strain_rate[:, ~slow.dead])
    assert found.dead.tolist() == slow.dead.tolist() == [False] * 5 + [True] + [False] * 2
    assert np.allclose(found.rounding.step, slow.rounding.step)
    assert found.cautions == slow.cautions
    assert "stand at the same" in found.cautions[0]


@pytest.mark.parametrize("unit", ["1/s", "strain", "m/s"])
def test_nan_samples_are_gaps_of_their_channels_and_told(tmp_path, unit):
    (path,) = array_files(tmp_path, unit, [0])
    whole = record_from(describe([path]), rate=20.0)
    values = np.load(path)
    values[300, 13:16] = np.nan
    values[500:, 15], values[:, 22] = np.inf, np.nan
    np.save(path, values)
    for record in (record_from(describe([path]), rate=20.0), decimated(read_das([path]))):
        lost = ~np.isfinite(record.strain_rate)
        assert lost[60, 14] and not lost[30, 14] and not lost[90, 14] and lost[-5, 15] and not lost[30, 15]
        assert not lost[15:-15, :8].any() and record.dead[22]
        assert any("no number, one and the same, or a straight line for a while" in one for one in record.cautions)
        off = np.abs(record.strain_rate - whole.strain_rate[: len(lost)])[~lost]
        assert np.nanmax(off) < 1e-5 * np.nanmax(np.abs(whole.strain_rate))


def test_headers_tell_all_but_the_numbers(tmp_path, monkeypatch):
    rate = 1e-8 * signal(3000, 20)
    for part in range(3):
        start = START + part * np.timedelta64(10, "s")
        write_prodml(
            tmp_path / f"{part}.h5",
            rate[part * 1000 : part * 1000 + 1000],
            start=start,
            sampling_rate=100.0,
            gauge_length=4.0,
            channel_spacing=1.0,
        )
    read = []
    plain = InHDF5.__getitem__
    monkeypatch.setattr(InHDF5, "__getitem__", lambda self, at: (read.append((self.path.name, at)), plain(self, at))[1])
    known = describe(sorted(tmp_path.glob("*.h5")))
    assert (known.grid.rows, known.channels, known.gauge_length) == (3000, (0, 19), 4.0)
    assert read == []
    record_from(known, rate=20.0, channels=(5, 8), times=[(START, START + np.timedelta64(4, "s"))])
    # Half the filter, 50 samples, is read beyond.
    assert read == [("0.h5", (slice(0, 451), slice(5, 9)))]


def test_large_arrays_stay_on_the_disk(tmp_path):
    (path,) = array_files(tmp_path, "1/s", [0], rows=10_000)
    assert path.stat().st_size > LARGE
    assert isinstance(describe([path]).blocks[0].data, np.memmap)


@pytest.mark.parametrize(
    "name",
    [
        "decimated_optodas.hdf5",
        "iDAS005_hdf5_example.626.h5",
        "iDAS005_tdms_example.626.tdms",
        "prodml_2.0.h5",
        "sample_tdms_file_v4713.tdms",
        "silixa_h5_1.hdf5",
        "terra15_v5_test_file.hdf5",
    ],
)
def test_parts_of_real_files_are_what_they_are_in_the_whole(shared_data, name):
    path = shared_data / "das" / name
    (block,) = describe([path]).blocks
    assert isinstance(block.data, OnDisk | InHDF5)
    from solver.survey.das.units import dascore

    (patch,) = [one for one in dascore().read(path) if "start_frequency" not in dict(one.attrs)]
    whole = patch.transpose("time", "distance").data
    assert block.data.shape == whole.shape
    assert block.data.dtype == whole.dtype
    rows, columns = slice(7, len(whole) - 3), slice(2, 11)
    assert np.array_equal(block.data[rows, columns], whole[rows, columns])
    # Evenly timed files hold no time that could be counted.
    assert isinstance(block.data, InHDF5) or isinstance(block.data.time, range)


@pytest.mark.parametrize("unit", ["strain", "rad"])
def test_a_derivative_of_slabs_is_that_of_the_whole_run(tmp_path, monkeypatch, unit):
    paths = array_files(tmp_path, unit, [0, 1, 3], rate=10.0)
    whole = read_das(paths).strain_rate
    monkeypatch.setattr("solver.survey.das.reduced.SLAB", 4 * 30 * 37)
    assert np.allclose(
        read_das(paths).strain_rate, whole, rtol=1e-6, atol=1e-9 * np.nanmax(np.abs(whole)), equal_nan=True
    )
    stored = np.concatenate([np.load(path) for path in paths[:2]]).astype(np.float64)
    rate = CubicSpline(np.arange(1400) / 10.0, stored, axis=0)(np.arange(1400) / 10.0, 1)
    rate *= strain_per_radian(4.0) if unit == "rad" else 1.0
    assert np.abs(whole[:1400] - rate).max() < 1e-6 * np.abs(rate).max()
    assert np.isfinite(whole).all(1).tolist() == [True] * 1400 + [False] * 700 + [True] * 700


@pytest.mark.parametrize(("unit", "slabs"), [("1/s", 1.5), ("strain", 6)])
def test_a_record_that_need_not_be_decimated_is_read_in_single_precision_without_copies(tmp_path, unit, slabs):
    rows, channels = 60_000, 300
    (path,) = array_files(tmp_path, unit, [0], rate=6.25, rows=rows, channels=channels)
    known = describe([path])
    tracemalloc.start()
    try:
        record = record_from(known, rate=6.0)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert record.strain_rate.dtype == np.float32
    assert record.strain_rate.shape == (rows, channels)
    # Slabs do not grow with the record; in double precision it takes twice as much, and was copied besides.
    assert peak < 4 * rows * channels + slabs * SLAB
