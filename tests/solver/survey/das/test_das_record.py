import hashlib
import json
import logging
import pickle

import h5py
import numpy as np
import pytest

from solver.survey.das.prodml import write_prodml
from solver.survey.das.reader import read_das
from solver.survey.das.record import DASRecord, channel_ranges
from solver.survey.das.size import require_room_for_file
from solver.survey.das.units import dascore, strain_per_radian
from solver.survey.das.unreadable import why_unreadable
from vision.contract import InputError

START = np.datetime64("2025-08-11T06:00:00", "ns")
SIDE = {"start": "2025-08-11T08:00:00+02:00", "sampling_rate": 5.0, "channel_spacing": 1.0, "gauge_length": 10.0}


def noise(rows=40, channels=12, seed=0):
    return 1e-8 * np.random.default_rng(seed).normal(size=(rows, channels))


def das_file(path, strain_rate, row=0, **changes):
    setting = {"sampling_rate": 5.0, "gauge_length": 10.0, "channel_spacing": 1.021} | changes
    write_prodml(path, strain_rate, start=START + np.timedelta64(row * 200, "ms"), **setting)
    return path


def array_file(folder, array, name="a.npy", **changes):
    path = folder / name
    np.save(path, array)
    side = {key: value for key, value in (SIDE | changes).items() if value is not None}
    path.with_suffix(".json").write_text(json.dumps(side))
    return path


def test_many_files_are_one_record(tmp_path):
    whole = noise(100)
    paths = [das_file(tmp_path / f"{part}.h5", whole[row : row + 25], row) for part, row in enumerate((50, 0, 75, 25))]
    record = read_das(paths)
    assert np.allclose(record.strain_rate, whole, rtol=1e-6, atol=0)
    assert record.start == START
    assert np.allclose(record.time, np.arange(100) / 5)
    assert (record.gaps, record.measured.all(), record.dead.any()) == ((), True, False)
    assert record.provenance["files"] == [str(paths[index]) for index in (1, 3, 0, 2)]
    assert record.provenance["sha256"][0] == hashlib.sha256(paths[1].read_bytes()).hexdigest()
    assert (record.provenance["format"], record.provenance["scale"]) == ("PRODML 2.0", 1e-9)


def test_missing_files_leave_a_gap(tmp_path):
    whole = noise(100)
    record = read_das([das_file(tmp_path / f"{row}.h5", whole[row : row + 25], row) for row in (0, 50, 75)])
    assert record.gaps == ((pytest.approx(5.0), pytest.approx(9.8)),)
    assert (~record.measured).nonzero()[0].tolist() == list(range(25, 50))
    assert np.allclose(record.strain_rate[50:], whole[50:], rtol=1e-6, atol=0)
    assert np.allclose(np.diff(record.time), 0.2)
    line = "the record has a gap of 5.0 s, from 2025-08-11T06:00:05Z to 06:00:10Z; what lies on either side is used"
    assert record.cautions == (line,)


def test_channels_keep_their_numbers(tmp_path):
    path = das_file(tmp_path / "a.h5", noise(), first_channel=-3)
    record = read_das([path], channels=(2, 5))
    assert record.channel.tolist() == [2, 3, 4, 5]
    assert np.allclose(record.distance, record.channel * 1.021)
    assert np.allclose(record.strain_rate, noise()[:, 5:9], rtol=1e-6, atol=0)
    for channels in ((-4, 5), (2, 9), (5, 5)):
        with pytest.raises(InputError, match="the file has -3 to 8"):
            read_das([path], channels=channels)


def test_what_the_user_says_wins_and_is_told(tmp_path):
    path = das_file(tmp_path / "a.h5", noise())
    record = read_das([path], gauge_length=8.0, channel_spacing=2.0)
    assert (record.gauge_length, record.channel_spacing) == (8.0, 2.0)
    assert np.allclose(record.distance, record.channel * 2.0)
    assert record.cautions == (
        "a.h5: channel spacing: Acquisition SpatialSamplingInterval says 1.021 m; 2 m is taken",
        "a.h5: gauge length: Acquisition GaugeLength says 10 m; 8 m is taken",
    )
    assert read_das([path], gauge_length=10.05).cautions == ()


@pytest.mark.parametrize("missing", ["gauge_length", "channel_spacing"])
def test_absent_lengths_must_be_given(tmp_path, missing):
    path = array_file(tmp_path, noise(), unit="1/s", **{missing: None})
    with pytest.raises(InputError, match=f"{missing.replace('_', ' ')} absent; give {missing}, m, in .das. of site"):
        read_das([path])
    record = read_das([path], **{missing: 4.0})
    assert getattr(record, missing) == 4.0
    assert record.provenance["notes"] == []


def test_nan_channels_are_named(tmp_path):
    array = noise()
    array[3, 4:7] = np.nan
    array[9, 11] = np.inf
    path = array_file(tmp_path, array, unit="1/s", first_channel=100)
    lost = ~np.isfinite((found := read_das([path])).strain_rate)
    assert np.array_equal(lost, ~np.isfinite(array)) and " for a while on channels 104-106, 111: " in found.cautions[0]
    assert np.isfinite(read_das([path], channels=(107, 110)).strain_rate).all()
    record = read_das([path], exclude=[104, 105, 106, 111])
    assert record.channel[record.dead].tolist() == [104, 105, 106, 111]
    assert np.isnan(record.strain_rate[:, record.dead]).all()
    assert np.array_equal(record.strain_rate[:, ~record.dead], array[:, ~record.dead].astype(np.float32))
    with pytest.raises(InputError, match="no channel 4 to exclude; the file has 100 to 111"):
        read_das([path], exclude=[4])


def test_constant_channels_are_dead(tmp_path, caplog):
    array = noise()
    array[:, 2:4] = 7e-9
    record = read_das([array_file(tmp_path, array, unit="1/s")])
    assert record.dead.nonzero()[0].tolist() == [2, 3]
    assert "left out, since they never change: channels 2-3" in caplog.text
    with pytest.raises(InputError, match="no channel holds a signal"):
        read_das([array_file(tmp_path, np.zeros((40, 12)), unit="1/s")])


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"gauge_length": 8.0}, "gauge length 8.0, but 10.0 in a.h5"),
        ({"channel_spacing": 2.0}, "channel spacing 2.0, but 1.02"),
        ({"first_channel": 5}, "first channel 5, but 0"),
        ({"sampling_rate": 2.5}, "2.5 samples/s, but 5 in a.h5"),
        ({"row": 30}, "overlaps a.h5 in time for 2 s, with other numbers; give each recording once"),
    ],
)
def test_files_of_two_recordings_are_refused(tmp_path, changes, says):
    rows = 20 if "sampling_rate" in changes else 40
    other = noise(rows, seed=1)
    paths = [das_file(tmp_path / "a.h5", noise()), das_file(tmp_path / "b.h5", other, **({"row": 40} | changes))]
    with pytest.raises(InputError, match=says):
        read_das(paths)


def test_other_numbers_of_channels_are_refused(tmp_path):
    paths = [das_file(tmp_path / "a.h5", noise()), das_file(tmp_path / "b.h5", noise(channels=11), 40)]
    with pytest.raises(InputError, match=r"channels 11, but 12 in a\.h5; give files of one recording"):
        read_das(paths)


def test_phase_is_differentiated_across_files(tmp_path):
    time = np.arange(120)[:, None] / 5.0
    phase = np.sin(0.5 * time + np.arange(6))
    starts = ("2025-08-11T06:00:00Z", "2025-08-11T06:00:12Z")
    halves = [array_file(tmp_path, phase[k * 60 :][:60], f"{k}.npy", unit="rad", start=starts[k]) for k in (0, 1)]
    strain_rate = read_das(halves).strain_rate
    expected = 0.5 * np.cos(0.5 * time + np.arange(6)) * strain_per_radian(10.0)
    assert np.abs(strain_rate - expected)[2:-2].max() < 1e-4 * np.abs(expected).max()


def test_velocity_is_differenced_over_the_gauge(tmp_path):
    strain_rate = noise(30, 1)
    velocity = strain_rate * np.arange(20) * 2.0
    record = read_das([array_file(tmp_path, velocity, unit="m/s", channel_spacing=2.0, gauge_length=11.0)])
    assert record.gauge_length == 12.0
    assert record.channel.tolist() == list(range(3, 17))
    assert record.distance.tolist() == [2.0 * channel for channel in range(3, 17)]
    assert np.allclose(record.strain_rate, strain_rate)
    assert "difference of velocity over 12 m" in record.provenance["notes"][0]
    with pytest.raises(InputError, match="fewer channels than one gauge length"):
        read_das([array_file(tmp_path, velocity, unit="m/s", channel_spacing=0.4)])


def test_side_file_says_what_the_array_lacks(tmp_path):
    rate = 1e9 * noise()
    np.savez(tmp_path / "a.npz", rate.T.astype(np.float32))
    side = "start = 2025-08-11T06:00:00Z\nsampling_rate = 5\nchannel_spacing = 2\ngauge_length = 10\n"
    (tmp_path / "a.toml").write_text(side + 'unit = "nm/m/s"\nfirst_channel = 50\naxes = ["channel", "time"]\n')
    record = read_das([tmp_path / "a.npz"])
    assert record.start == START
    assert record.channel[[0, -1]].tolist() == [50, 61]
    assert record.distance[0] == 100.0
    assert np.allclose(record.strain_rate, noise(), rtol=1e-6, atol=0)


def test_quantity_declares_what_the_file_does_not_say(tmp_path):
    path = array_file(tmp_path, noise())
    with pytest.raises(InputError, match="the file states no unit; give quantity"):
        read_das([path])
    assert np.array_equal(read_das([path], quantity="strain_rate").strain_rate, noise().astype(np.float32))
    assert np.allclose(read_das([path], quantity="strain_rate", scale=1e-3).strain_rate, 1e-3 * noise())


@pytest.mark.parametrize(
    ("side", "says"),
    [
        (None, "an array alone has no times; write a.toml beside it"),
        ("{", "a.json: not JSON"),
        (json.dumps(SIDE | {"gauge": 10}), "a.json: gauge: extra inputs are not permitted; known keys: start"),
        (json.dumps(SIDE | {"sampling_rate": 0}), "a.json: sampling_rate: input should be greater than 0"),
        (json.dumps(SIDE | {"start": "2025-08-11T06:00:00"}), "a.json: start: input should have timezone info"),
        (json.dumps({"start": SIDE["start"]}), "a.json: sampling_rate: field required"),
        (json.dumps(SIDE | {"unit": "volt"}), "unknown unit 'volt' in the side file"),
        (json.dumps(SIDE | {"axes": ["time", "space"]}), "axes is"),
    ],
)
def test_bad_side_files_are_one_clear_line(tmp_path, side, says):
    np.save(tmp_path / "a.npy", noise())
    if side:
        (tmp_path / "a.json").write_text(side)
    with pytest.raises(InputError) as caught:
        read_das([tmp_path / "a.npy"])
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("array", "says"),
    [
        (np.zeros(5), r"an array of float64 \(5,\)"),
        (np.zeros((5, 5), complex), "an array of complex128"),
        (np.full((5, 5), "a"), "give real numbers"),
        (np.zeros((0, 5)), "no samples"),
        (np.array([{"a": 1}]), "not a readable numpy file"),
    ],
)
def test_bad_arrays_are_one_clear_line(tmp_path, array, says):
    with pytest.raises(InputError, match=says):
        read_das([array_file(tmp_path, array, unit="1/s")])


def test_npz_holds_one_array(tmp_path):
    array_file(tmp_path, noise(), unit="1/s")
    np.savez(tmp_path / "a.npz", one=noise(), two=noise())
    with pytest.raises(InputError, match="arrays one, two; store exactly one"):
        read_das([tmp_path / "a.npz"])


class Trap:
    """Marks that a pickle was loaded."""

    sprung = False

    def __reduce__(self):
        return (setattr, (Trap, "sprung", True))


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "an empty file, 0 bytes"),
        (b"time,channel\n1,2\n", "text, whatever its name says"),
        (b"TDSm" + bytes(40), "TDMS that breaks off"),
        (b"\0\1\2", "no known DAS format"),
        (pickle.dumps(["dascore.core Patch", Trap()]), "a pickle can run code"),
    ],
)
def test_files_of_no_known_format(tmp_path, content, says):
    (tmp_path / "a.dat").write_bytes(content)
    with pytest.raises(InputError, match=says):
        read_das([tmp_path / "a.dat"])
    assert not Trap.sprung


@pytest.mark.parametrize("share", [0.3, 0.7, 0.98])
def test_cut_files_are_one_clear_line(tmp_path, share):
    content = das_file(tmp_path / "a.h5", noise(400)).read_bytes()
    (tmp_path / "a.h5").write_bytes(content[: int(share * len(content))])
    with pytest.raises(InputError) as caught:
        read_das([tmp_path / "a.h5"])
    assert "\n" not in str(caught.value)
    assert str(tmp_path / "a.h5") in str(caught.value)


def test_hdf5_that_is_cut_or_holds_no_das_is_named(tmp_path):
    content = das_file(tmp_path / "a.h5", noise(400)).read_bytes()
    (tmp_path / "a.h5").write_bytes(content[:5000])
    with pytest.raises(InputError, match=f"HDF5 that breaks off after 5000 of {len(content)} bytes; copy"):
        read_das([tmp_path / "a.h5"])
    with h5py.File(tmp_path / "b.h5", "w") as file:
        file["picture"] = np.zeros(3)
    with pytest.raises(InputError, match=r"HDF5 of no known DAS format \(it holds picture\)"):
        read_das([tmp_path / "b.h5"])


def test_damage_is_named_only_where_it_shows(tmp_path):
    path = das_file(tmp_path / "a.h5", noise())
    with h5py.File(path, "r+") as file:
        file["Acquisition"].attrs["GaugeLength"] = np.bytes_("ten")
    with pytest.raises(InputError, match="GaugeLength is 'ten', no number; export the recording again"):
        read_das([path])
    for words in ("Unable to open file (file is already open for write)", "unable to lock file, errno = 11"):
        assert "still being written; wait until the recorder has closed it" in why_unreadable(OSError(words))
    assert why_unreadable(ImportError("segyio")).startswith("a package that reads it is missing (segyio); install it")


def changed(path, name, value):
    """Replace a dataset of Raw[0], or its unit."""
    with h5py.File(path, "r+") as file:
        raw = file["Acquisition/Raw[0]"]
        if name == "RawDataUnit":
            raw.attrs[name] = value
            return path
        attributes = dict(raw[name].attrs)
        array = value(raw[name][:])
        del raw[name]
        raw.create_dataset(name, data=array).attrs.update(attributes)
    return path


def test_a_unit_that_is_not_understood_is_told_where_site_toml_states_the_quantity(tmp_path):
    path = changed(das_file(tmp_path / "a.h5", noise()), "RawDataUnit", np.bytes_("9**9**9 1/s"))
    path = changed(path, "RawData", lambda v: v * 1e-9)
    (line,) = read_das([path], quantity="strain_rate").cautions
    assert line == "a.h5: unit: the file's unit is not understood; its numbers are taken for strain_rate in SI units"
    assert not read_das([path], quantity="strain_rate", scale=1.0).cautions


@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        ("RawData", np.transpose, r"its data are \[12, 40\], but time and channel \[40, 12\]: the axes are exchanged"),
        ("RawDataUnit", np.bytes_("bananas"), "the file states 'bananas', which tells no unit; give quantity"),
        ("RawDataUnit", np.bytes_("9**9**9 1/s"), r"states '9\*\*9\*\*9 1/s', which tells no unit"),
        ("RawData", lambda v: v.astype(complex), "an array of complex128; give real numbers"),
        ("RawData", lambda v: v.astype("S9"), r"an array of \|S9; give real"),
        ("RawDataTime", lambda t: t[::-1], "its times run backwards at sample 1"),
        (
            "RawDataTime",
            lambda t: np.r_[t[:20], t[19:-1]],
            r"times repeat at sample 20 \(2025-08-11T06:00:03.800Z\)",
        ),
        ("RawDataTime", lambda t: np.r_[t[:20], t[10:30]], "its times run backwards at sample 20"),
        (
            "RawData",
            lambda v: 1e12 * v,
            "strain rates of 2e[+]04 1/s, but the ground never strains faster than 0.1 1/s",
        ),
        ("RawData", lambda v: 1e-9 * v, "but no interrogator resolves less than 1e-13 1/s; check the file's unit"),
    ],
)
def test_files_that_contradict_themselves_or_nature(tmp_path, name, value, says):
    with pytest.raises(InputError, match=says) as caught:
        read_das([changed(das_file(tmp_path / "a.h5", noise()), name, value)])
    assert "\n" not in str(caught.value)


def test_a_gap_within_a_file(tmp_path):
    path = changed(das_file(tmp_path / "a.h5", noise()), "RawDataTime", lambda t: t + 60_000_000 * (t > t[19]))
    record = read_das([path])
    assert np.allclose(record.strain_rate[record.measured], noise(), rtol=1e-6, atol=0)
    assert record.cautions[0] == (
        "a.h5: end: PartEndTime says 2025-08-11T06:00:07.800Z; 2025-08-11T06:01:07.800Z is taken"
    )
    assert record.cautions[1].startswith("the record has a gap of 1 min 0 s, from 2025-08-11T06:00:04Z to 06:01:04Z")


def test_integers_without_a_scale_are_counts(tmp_path):
    path = array_file(tmp_path, np.rint(1e9 * noise()).astype(np.int16))
    with pytest.raises(InputError, match="integers are counts, not strain_rate in SI units; give scale"):
        read_das([path], quantity="strain_rate")
    assert np.allclose(read_das([path], quantity="strain_rate", scale=1e-9).strain_rate, noise(), atol=1e-9)


def test_clipped_records_are_reported(tmp_path):
    clip = np.clip(noise(), -1e-8, 1e-8)
    (line,) = read_das([array_file(tmp_path, clip, unit="1/s")]).cautions
    assert line.startswith(
        f"{(clip == 1e-8).sum()} samples of 12 channels stand at the same largest number, 1e-08: either the record is "
        "clipped"
    )
    assert "or the number fills what was not measured" in line


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (
            {"gauge_length": 1e-4},
            "gauge length 0.0001 m as given, but none is below 0.01 or above 1000 m",
        ),
        ({"gauge_length": 1e4}, "gauge length 10000 m as given"),
        ({"channel_spacing": 1e-4}, "channel spacing 0.0001 m as given, but none is below 0.001 or above 200 m"),
        ({"channel_spacing": 1e3}, "channel spacing 1000 m as given"),
    ],
)
def test_lengths_that_no_interrogator_has(tmp_path, given, says):
    with pytest.raises(InputError, match=says):
        read_das([das_file(tmp_path / "a.h5", noise())], **given)
    with pytest.raises(InputError, match=says.replace("given", "stated", 1)):
        read_das([das_file(tmp_path / "a.h5", noise(), **given)])


def test_no_files(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_das([tmp_path / "none.h5"])
    with pytest.raises(InputError, match="no DAS files"):
        read_das([])


def test_channel_ranges():
    assert channel_ranges(np.array([1])) == "channel 1"
    assert channel_ranges(np.array([1, 2, 3, 7, 9, 10])) == "channels 1-3, 7, 9-10"


def test_energies_beside_the_samples_are_left_out(tmp_path):
    path = das_file(tmp_path / "a.h5", noise())
    with h5py.File(path, "a") as file:
        bands = file.create_group("Acquisition/Processed/Fbe[0]")
        bands.attrs.update(StartLocusIndex=0, NumberOfLoci=12, Dimensions=np.array([b"time", b"locus"]))
        file.copy(file["Acquisition/Raw[0]/RawDataTime"], bands, "FbeDataTime")
        bands.create_dataset("FbeData[1]", data=np.ones((40, 12)))
        bands["FbeData[1]"].attrs.update(StartFrequency=0.0, EndFrequency=1.0)
    assert len(dascore().read(path)) == 2
    assert np.allclose(read_das([path]).strain_rate, noise(), rtol=1e-6, atol=0)


@pytest.mark.parametrize(
    ("name", "kind", "quantity", "gauge_length", "sampling_rate", "channels"),
    [
        ("decimated_optodas.hdf5", "OptoDAS 8", "strain_rate", 10.213, 500.0, (650, 700)),
        ("iDAS005_hdf5_example.626.h5", "PRODML 2.1", "idas_counts", 10.0, 1000.0, (-118, 1033)),
        ("iDAS005_tdms_example.626.tdms", "TDMS 4713", "idas_counts", 10.0, 1000.0, (0, 1151)),
        ("prodml_2.0.h5", "PRODML 2.0", "idas_counts", 10.0, 200.0, (-260, 251)),
        ("sample_tdms_file_v4713.tdms", "TDMS 4713", "idas_counts", 10.0, 500.0, (0, 2431)),
        ("silixa_h5_1.hdf5", "Silixa_H5 1", "idas_counts", 10.0, 500.0, (0, 3839)),
        ("terra15_v5_test_file.hdf5", "TERRA15 5", "velocity", 3.267, 3217.8, (1, 41)),
    ],
)
def test_real_files_open(shared_data, name, kind, quantity, gauge_length, sampling_rate, channels):
    record = read_das([shared_data / "das" / name])
    assert (record.provenance["format"], record.provenance["quantity"]) == (kind, quantity)
    assert record.gauge_length == pytest.approx(gauge_length, rel=1e-4)
    assert record.sampling_rate == pytest.approx(sampling_rate, rel=1e-5)
    assert (record.channel[0], record.channel[-1]) == channels
    assert np.isfinite(record.strain_rate).all()
    # Ambient strain rate on real fiber is 1e-9 to 1e-5 1/s; a slip of units would leave that range.
    assert 1e-9 < np.sqrt(np.mean(record.strain_rate**2)) < 1e-5


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("ap_sensing_1.hdf5", "states 'SCALED_DIFFERENTIAL_PHASE_32', which tells no unit; give quantity"),
        ("febus_2.h5", "a spectrum, not a time series; export StrainRate instead"),
        ("LICENSE", "text, whatever its name says"),
    ],
)
def test_real_files_that_say_why_not(shared_data, name, says):
    with pytest.raises(InputError, match=says):
        read_das([shared_data / "das" / name])


def test_phase_of_ap_sensing_opens_when_declared(shared_data):
    record = read_das([shared_data / "das" / "ap_sensing_1.hdf5"], quantity="phase_rate", scale=1e-3, channels=(40, 60))
    assert record.gauge_length == pytest.approx(4.9006, rel=1e-4)
    assert record.strain_rate.shape == (150, 21)


def test_two_formats_of_one_recording_agree(shared_data):
    tdms, prodml = (
        read_das([shared_data / "das" / name])
        for name in ("iDAS005_tdms_example.626.tdms", "iDAS005_hdf5_example.626.h5")
    )
    assert np.array_equal(tdms.strain_rate, prodml.strain_rate)
    assert tdms.start == prodml.start
    assert np.abs(tdms.distance - prodml.distance).max() < tdms.channel_spacing


def test_practice_survey_reads(shared_data, caplog):
    with caplog.at_level(logging.WARNING):
        record = read_das(
            [shared_data / "practice/survey-01/das/das_0001.h5"], gauge_length=10.0, quantity="strain_rate"
        )
    assert isinstance(record, DASRecord)
    assert record.strain_rate.shape == (955, 241)
    assert np.isfinite(record.strain_rate).all()
    assert not caplog.records


def test_what_unfolds_beyond_memory_is_not_read(tmp_path, monkeypatch):
    """Chunks that were never written take no room in a file; uneven times make it be read as a whole."""
    time = START + np.cumsum(np.arange(40)) * np.timedelta64(10, "ms")
    coords = {"time": time, "distance": np.arange(12.0)}
    patch = dascore().Patch(data=noise(), coords=coords, dims=("time", "distance"))
    patch.io.write(tmp_path / "a.h5", "dasdae")
    monkeypatch.setattr("solver.survey.memory.available", lambda: 4e3)
    with pytest.raises(InputError, match=r"a\.h5: reading it as a whole needs about .* of memory"):
        read_das([tmp_path / "a.h5"])
    with h5py.File(tmp_path / "b.h5", "w") as file:
        file.create_dataset("numbers", (1 << 20, 1 << 10), "f4", chunks=(1 << 10, 1 << 10))
    with pytest.raises(InputError, match=r"its 4\.3 GB of numbers were never written; leave this file out"):
        require_room_for_file(tmp_path / "b.h5")
    path = das_file(tmp_path / "c.h5", noise())
    with h5py.File(path, "r+") as file:
        attributes = dict(file["Acquisition/Raw[0]/RawData"].attrs)
        del file["Acquisition/Raw[0]/RawData"]
        empty = file["Acquisition/Raw[0]"].create_dataset("RawData", shape=(40, 12), dtype="f4", chunks=(20, 12))
        empty.attrs.update(attributes)
    with pytest.raises(InputError, match="numbers were never written; leave this file out"):
        read_das([path])
