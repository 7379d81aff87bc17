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
