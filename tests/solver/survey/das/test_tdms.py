import struct

import pytest

from solver.survey.das.tdms import read_tdms_properties


def text(value):
    return struct.pack("<I", len(value.encode())) + value.encode()


def first_object(*properties):
    lead_in = b"TDSm" + struct.pack("<iiQQ", 46, 4713, 0, 0)
    return (
        lead_in
        + struct.pack("<I", 3)
        + text("/")
        + struct.pack("<II", 0xFFFFFFFF, len(properties))
        + b"".join(properties)
    )


def test_properties_of_every_kind(tmp_path):
    content = first_object(
        text("GaugeLength") + struct.pack("<Id", 10, 10.0),
        text("GPSTimeStamp") + struct.pack("<IQq", 0x44, 0, 3_600_000_000),
        text("Tags") + struct.pack("<I", 0x20) + text("Straße"),
        text("Normalization") + struct.pack("<I?", 0x21, True),
        text("P") + struct.pack("<Ii", 3, -5),
    )
    (tmp_path / "a.tdms").write_bytes(content)
    properties = read_tdms_properties(tmp_path / "a.tdms")
    assert properties.pop("GPSTimeStamp") == struct.pack("<Qq", 0, 3_600_000_000)
    assert properties == {"GaugeLength": 10.0, "Tags": "Straße", "Normalization": True, "P": -5}


def test_cut_files_fail(tmp_path):
    (tmp_path / "a.tdms").write_bytes(first_object(text("GaugeLength") + struct.pack("<Id", 10, 10.0))[:-3])
    with pytest.raises(struct.error):
        read_tdms_properties(tmp_path / "a.tdms")


def test_real_files(shared_data):
    for path in sorted(shared_data.glob("das/*.tdms")):
        properties = read_tdms_properties(path)
        assert (properties["GaugeLength"], properties["Unit Calibration (nm)"]) == (10.0, 116.0)
