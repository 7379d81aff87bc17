import h5py
import numpy as np
import pytest

from solver.survey.das.prodml import write_prodml
from solver.survey.das.reader import read_das
from vision.contract import InputError

START = np.datetime64("2025-08-11T06:00:00.123456789")
SETTING = {
    "start": START,
    "sampling_rate": 200 / 3,
    "gauge_length": 8.5,
    "channel_spacing": 2.042,
    "first_channel": -40,
}


@pytest.fixture
def written(tmp_path):
    strain_rate = 1e-8 * np.random.default_rng(0).normal(size=(500, 7))
    write_prodml(tmp_path / "das.h5", strain_rate, **SETTING)
    return tmp_path / "das.h5", strain_rate


def test_what_is_written_reads_back(written):
    path, strain_rate = written
    record = read_das([path])
    assert np.allclose(record.strain_rate, strain_rate, rtol=1e-6, atol=0)
    assert record.start == np.datetime64("2025-08-11T06:00:00.123456")
    assert record.sampling_rate == pytest.approx(200 / 3, rel=1e-6)
    assert (record.gauge_length, record.channel.tolist()) == (8.5, list(range(-40, -33)))
    assert np.allclose(record.distance, np.arange(-40, -33) * 2.042)
    assert (record.provenance["format"], record.provenance["scale"]) == ("PRODML 2.0", 1e-9)


def test_it_carries_what_a_practice_file_carries(written, shared_data):
    def attributes(path):
        found = {}
        with h5py.File(path) as file:
            found["/"] = sorted(file.attrs)
            file.visititems(lambda name, node: found.update({name: sorted(node.attrs)}))
        return found

    assert attributes(written[0]) == attributes(shared_data / "practice/survey-01/das/das_0001.h5")


def test_the_same_data_make_the_same_file(written, tmp_path):
    path, strain_rate = written
    before = path.read_bytes()
    write_prodml(path, strain_rate, **SETTING)
    assert path.read_bytes() == before
    assert [item.name for item in tmp_path.iterdir()] == ["das.h5"]


def test_a_failure_leaves_nothing(tmp_path):
    with pytest.raises(ValueError, match="could not convert"):
        write_prodml(tmp_path / "das.h5", np.zeros((3, 3)), **(SETTING | {"gauge_length": "ten"}))
    assert not list(tmp_path.iterdir())


def test_a_file_of_one_sample_is_said_to_be_that(tmp_path):
    write_prodml(tmp_path / "das.h5", np.ones((1, 4)), **SETTING)
    with pytest.raises(InputError, match=r"das\.h5: holds a single sample, .* leave this file out"):
        read_das([tmp_path / "das.h5"])


@pytest.fixture
def five_hertz(tmp_path):
    """A file of 5 Hz and its Raw[0], open for changes."""
    strain_rate = 1e-8 * np.random.default_rng(0).normal(size=(40, 7))
    start = np.datetime64("2025-08-11T06:00:00")
    write_prodml(tmp_path / "a.h5", strain_rate, **(SETTING | {"start": start, "sampling_rate": 5.0}))
    with h5py.File(tmp_path / "a.h5", "r+") as file:
        yield tmp_path / "a.h5", file["Acquisition/Raw[0]"]


def closed(path, raw):
    raw.file.close()
    return read_das([path])


def replaced(raw, name, array):
    attributes = dict(raw[name].attrs)
    del raw[name]
    raw.create_dataset(name, data=array).attrs.update(attributes)


def test_the_offsets_of_texts_are_applied(five_hertz):
    path, raw = five_hertz
    for node in (raw["RawData"], raw["RawDataTime"]):
        for end in ("PartStartTime", "PartEndTime"):
            node.attrs[end] = np.bytes_(node.attrs[end].decode().replace("T06:", "T09:").replace("+00", "+03"))
    record = closed(path, raw)
    assert (str(record.start), record.cautions) == ("2025-08-11T06:00:00.000000000", ())


def test_texts_that_differ_from_the_times_of_samples_are_told(five_hertz):
    path, raw = five_hertz
    raw["RawDataTime"].attrs["PartStartTime"] = raw["RawData"].attrs["PartStartTime"] = np.bytes_("2025-08-11T09:00:00")
    record = closed(path, raw)
    assert str(record.start) == "2025-08-11T06:00:00.000000000"
    assert record.cautions == (
        "a.h5: start: PartStartTime says 2025-08-11T09:00:00.000Z; 2025-08-11T06:00:00.000Z is taken",
    )


@pytest.mark.parametrize("times", ["nanoseconds", "seconds since the start", "none"])
def test_three_rates_are_held_against_each_other(five_hertz, times):
    path, raw = five_hertz
    stamps = raw["RawDataTime"][:]
    changed = {"nanoseconds": stamps * 1000, "seconds since the start": (stamps - stamps[0]) / 1e6, "none": 0 * stamps}
    replaced(raw, "RawDataTime", changed[times])
    for node in (raw["RawData"], raw["RawDataTime"]):
        node.attrs["PartEndTime"] = np.bytes_("2025-08-11T06:00:10+00:00")
    record = closed(path, raw)
    assert (str(record.start), record.sampling_rate) == ("2025-08-11T06:00:00.000000000", pytest.approx(5.0))
    assert any("rate: PartStartTime to PartEndTime says 3.9 Hz; 5 Hz is taken" in line for line in record.cautions)


def test_a_rate_that_stands_alone_is_not_taken(five_hertz):
    path, raw = five_hertz
    stamps = raw["RawDataTime"][:]
    replaced(raw, "RawDataTime", stamps[0] + 2 * (stamps - stamps[0]))
    record = closed(path, raw)
    assert record.sampling_rate == pytest.approx(5.0)
    assert "a.h5: rate: RawDataTime says 2.5 Hz; 5 Hz is taken" in record.cautions


def test_the_raw_array_s_own_numbers_are_taken(five_hertz):
    path, raw = five_hertz
    whole = raw["RawData"][:]
    replaced(raw, "RawData", whole[:, 3:])
    raw.attrs.update(StartLocusIndex=-37, NumberOfLoci=4)
    record = closed(path, raw)
    assert record.channel.tolist() == [-37, -36, -35, -34]
    assert np.allclose(record.strain_rate, 1e-9 * whole[:, 3:])
    assert "a.h5: first channel: Acquisition StartLocusIndex says -40; -37 is taken" in record.cautions


def test_words_for_a_unit_do_not_bar_what_site_toml_states(five_hertz):
    path, raw = five_hertz
    raw.attrs["RawDataUnit"] = np.bytes_("optical counts")
    raw.file.close()
    record = read_das([path], quantity="strain_rate", scale=1e-9)
    assert np.isfinite(record.strain_rate).all()


def test_a_tail_without_times_was_never_written(five_hertz):
    path, raw = five_hertz
    stamps = raw["RawDataTime"][:]
    stamps[30:] = 0
    replaced(raw, "RawDataTime", stamps)
    record = closed(path, raw)
    assert record.strain_rate.shape == (30, 7)
    assert any("samples: RawData says 40; 30 is taken" in line for line in record.cautions)
