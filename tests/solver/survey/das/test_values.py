"""Numbers that were written without measuring are gaps, in every way in which a record is read."""

from dataclasses import replace

import h5py
import numpy as np
import pytest

from solver.survey.das.block import fingerprint, linked_files
from solver.survey.das.description import describe
from solver.survey.das.ingest import ingest
from solver.survey.das.prodml import write_prodml
from solver.survey.das.reader import read_das, record_from
from solver.survey.das.values import filled_cells, measured_runs
from vision.contract import InputError

START = np.datetime64("2025-08-11T06:00:00", "ns")
NOISE = np.random.default_rng(0).normal(size=(60, 12))


def runs(values):
    return [(run.start, run.stop) for run in measured_runs(values)]


@pytest.mark.parametrize("fill", [0.0, np.nan, -9999.0])
def test_rows_of_one_number_are_not_measured(fill):
    values = NOISE.copy()
    values[:, 4] = 7.0  # a dead channel
    values[10:25] = values[40] = values[55:] = fill
    assert runs(values) == [(0, 10), (25, 40), (41, 55)]


def test_a_frozen_row_is_measured_once():
    values = NOISE.copy()
    values[21:30] = values[20]
    assert runs(values) == [(0, 21), (30, 60)]


def test_what_is_measured_stays():
    coarse = np.rint(0.3 * NOISE[:, :3])  # many rows are all zeros, and repeat
    assert (coarse == 0).all(1).sum() > 20
    slow = np.repeat(NOISE[:20], 3, axis=0)  # a slow record that is written at a higher rate
    for values in (NOISE, coarse, slow, NOISE[:1], np.zeros((30, 1))):
        assert runs(values) == [(0, len(values))]


@pytest.fixture
def dropouts(tmp_path):
    """A file of 40 Hz with two dropouts, and its strain rate."""
    rate = 1e-8 * np.random.default_rng(1).normal(size=(1200, 9))
    rate[300:420] = rate[1000:] = 0.0
    path = tmp_path / "a.h5"
    write_prodml(path, rate, start=START, sampling_rate=40.0, gauge_length=10.0, channel_spacing=1.0)
    return path, rate


def test_dropouts_are_gaps_and_told(dropouts, tmp_path):
    path, rate = dropouts
    gone = (rate == 0).all(1)
    record, known = read_das([path]), describe([path])
    assert np.array_equal(record.measured, ~gone)
    assert np.allclose(record.gaps, [(7.5, 10.475), (25.0, 29.975)])
    assert record.cautions[0].startswith("in 320 samples (8.0 s) all channels hold one number")
    store = ingest(known, [path], {}, tmp_path / "store", 20.0)
    for found in (record_from(known, rate=20.0), store.record()):
        assert np.allclose(found.gaps, record.gaps, atol=0.6)  # of the last, what the filter reaches
        assert any("all channels hold one number" in line for line in found.cautions)
        assert not found.measured[140:215].any() and found.measured[10:140].all()


def test_channels_that_are_filled_for_a_while_are_not_measured_there_and_told(tmp_path):
    rate = 1e-8 * np.random.default_rng(1).normal(size=(1200, 9))
    rate[300:420, 3:5] = rate[800:, 7] = 2e-8
    path = tmp_path / "a.h5"
    write_prodml(path, rate, start=START, sampling_rate=40.0, gauge_length=10.0, channel_spacing=1.0)
    known, said = describe([path]), "no number, one and the same, or a straight line for a while on channels 3-4, 7"
    store = ingest(known, [path], {}, tmp_path / "store", 20.0)
    for record, wide, half in (
        (read_das([path]), 1, 4),
        (record_from(known, rate=20.0), 2, 60),
        (store.record(), 2, 60),
    ):
        assert any(line.startswith(said) for line in record.cautions)
        row = np.searchsorted(record.time, [7.5, 10.475])
        lost = ~np.isfinite(record.strain_rate)
        assert lost[row[0] : row[1] + 1, 3:5].all() and not lost[row[0] - half // wide, 3:5].any()
        assert not lost[:, [0, 1, 2, 5, 6, 8]][half:-half].any() and lost[-half - 10, 7] and not record.gaps


LINE = np.linspace(0, 1, 600, dtype=np.float32)[:, None]


@pytest.mark.parametrize("channels", [2, 30, 40])
@pytest.mark.parametrize("filled", ["interpolated", "held", "zero", "none"])
def test_what_fills_few_channels_or_most_is_found(channels, filled):
    values = np.random.default_rng(3).normal(size=(3000, 40)).astype(np.float32)
    first, last, part = values[800], values[1400], values[800:1400, :channels]
    lines = {"interpolated": first + (last - first) * LINE, "held": first, "zero": 0.0, "none": np.nan}
    part[:] = np.broadcast_to(lines[filled], (600, 40))[:, :channels]
    ((begin, end, which),) = filled_cells(values)
    assert 780 < begin <= 805 and 1399 <= end < 1420 and which.tolist() == list(range(channels))


def test_numbers_that_repeat_are_measured():
    random = np.random.default_rng(2).normal(size=(3000, 40))
    coarse = np.rint(0.4 * random)
    burst = 2 * random[:, :1] * (np.random.default_rng(3).random((3000, 1)) < 0.05)  # on all channels at once
    quiet = coarse * (np.arange(40) != 7)  # of a channel that is far from the road
    quiet[::200, 7] = 1
    upsampled = np.stack([np.interp(np.arange(3000) / 10, np.arange(301), one) for one in random[:301].T], 1)
    for values in (coarse, quiet, np.rint(0.15 * random + burst), upsampled, np.repeat(NOISE, 9, axis=0), NOISE):
        assert filled_cells(values) == []


def test_dropouts_off_the_common_grid_do_not_spread(dropouts):
    _, rate = dropouts
    (one,) = describe([dropouts[0]]).grid.placed
    moved = replace(one, row=1, rows=len(rate) - 1, ahead=0.5).values(1, 1200, slice(0, 9))
    assert np.isnan(moved[300:419]).all() and np.isfinite(moved[:298]).all() and np.isfinite(moved[421:998]).all()
    spoilt = np.array(one.block.data[:298, :])
    spoilt[100:110, 4] = np.nan
    half = replace(one, block=replace(one.block, data=spoilt), count=298, row=1, rows=297, ahead=0.5)
    again = half.values(1, 298, slice(0, 9))
    assert np.flatnonzero(np.isnan(again[:, 4])).tolist() == list(range(99, 110)) and not np.isnan(again[:, 3]).any()
    assert np.allclose(again[:90, 4], moved[:90, 4], rtol=1e-3) and np.isnan(again).sum() == 11


def virtual(folder, sources):
    """A PRODML file whose numbers are those of other files."""
    path = folder / "whole.h5"
    write_prodml(path, 1e-8 * NOISE, start=START, sampling_rate=5.0, gauge_length=10.0, channel_spacing=1.0)
    with h5py.File(path, "r+") as file:
        raw = file["Acquisition/Raw[0]"]
        data, attributes = raw["RawData"][:], dict(raw["RawData"].attrs)
        layout = h5py.VirtualLayout(data.shape, data.dtype)
        for part, rows in enumerate(np.split(np.arange(60), sources)):
            with h5py.File(folder / f"part{part}.raw", "w") as one:
                one["RawData"] = data[rows]
            layout[rows[0] : rows[-1] + 1] = h5py.VirtualSource(f"part{part}.raw", "RawData", (len(rows), 12))
        del raw["RawData"]
        raw.create_virtual_dataset("RawData", layout).attrs.update(attributes)
    return path


def test_a_missing_source_of_a_virtual_dataset_is_named(tmp_path):
    path = virtual(tmp_path, 3)
    assert read_das([path]).cautions == ()
    (tmp_path / "part1.raw").unlink()
    record = read_das([path])
    assert not record.measured[20:40].any() and record.measured.sum() == 40
    line = f"this is missing in {tmp_path}: part1.raw; put it there"
    assert line in record.cautions[0]
    for part in (0, 2):
        (tmp_path / f"part{part}.raw").unlink()
    with pytest.raises(InputError, match=r"missing in .*: part0\.raw and 2 more"):
        read_das([path])


def test_numbers_that_no_fiber_makes_are_not_stored(dropouts, tmp_path):
    known = describe([dropouts[0]], quantity="strain_rate", scale=1.0)
    with pytest.raises(InputError, match=r"the ground never strains faster than 0\.1 1/s; check the file's unit"):
        ingest(known, [dropouts[0]], {}, tmp_path / "store", 20.0)
    assert not (tmp_path / "store").exists()


def test_what_a_file_shows_of_others_is_in_its_checksum(tmp_path):
    path = virtual(tmp_path, 3)
    store = ingest(describe([path]), [path], {}, tmp_path / "store")
    before = fingerprint(path)
    assert store.stale([path], {}) is None
    source = linked_files(path)[-1]
    content = bytearray(source.read_bytes())
    content[-1] ^= 1
    source.write_bytes(content)
    assert fingerprint(path) != before
    assert store.stale([path], {}) == f"{source.name} changed"
    source.unlink()
    assert store.stale([path], {}) == f"{source.name} changed"
