"""Of a record only the channels near the road and the time around vehicles are read; messages know the whole."""

import numpy as np
import pandas as pd
import pytest

from solver.survey.anchors import Anchor
from solver.survey.das.description import describe
from solver.survey.das.opened import Raw
from solver.survey.das.prodml import write_prodml
from solver.survey.selection import near_road, times_around, wanted
from solver.survey.survey import Survey
from solver.trajectory.passes import smooth_passes
from vision.contract import InputError, LocalFrame

START = np.datetime64("2025-08-11T06:00:00", "ns")


def tracks(*begins, x=(0.0, 100.0), seconds=10):
    """A vehicle along the road from each of some times, s after `START`."""
    parts = []
    for number, begin in enumerate(begins):
        time = START + np.round((begin + np.linspace(0, seconds, 21)) * 1e9).astype("timedelta64[ns]")
        parts.append(
            pd.DataFrame(
                {
                    "time": pd.to_datetime(time, utc=True),
                    "track_id": str(number),
                    "class": "car",
                    "x": np.linspace(*x, 21),
                    "y": 0.0,
                    "sigma_x": 0.1,
                    "sigma_y": 0.1,
                }
            )
        )
    return pd.concat(parts, ignore_index=True)


def anchor(channel, x, y=3.0):
    return Anchor(f"at {channel}", channel, x, y, 1.0, 0.1, 0.1)


def test_channels_are_those_that_fiber_can_reach_from_anchors_beside_the_road():
    held, table = (0, 5000), tracks(0)
    # 100 m of road and 3 m to the side, times 1.3, and 150 m: to either side of an anchor at one end.
    assert near_road(held, 1.0, table, [anchor(1000, 0.0)]) == (719, 1281)
    assert near_road(held, 5.0, table, [anchor(1000, 0.0)]) == (943, 1057)
    assert near_road(held, 1.0, table, [anchor(1000, 0.0), anchor(1090, 90.0)]) == (719, 1358)
    # One in another street says nothing, and without any all channels may be beside the road.
    assert near_road(held, 1.0, table, [anchor(1000, 0.0), anchor(3000, 50.0, y=900.0)]) == (719, 1281)
    assert near_road(held, 1.0, table, [anchor(3000, 50.0, y=900.0)]) == held
    assert near_road(held, 1.0, table, []) == held
    assert near_road((900, 1100), 1.0, table, [anchor(1000, 0.0)]) == (900, 1100)


def test_times_are_those_around_vehicles():
    begins = [0.0, 30.0, 1000.0, 1320.0]
    spans = [[float((end - START) / np.timedelta64(1, "s")) for end in span] for span in times_around(tracks(*begins))]
    # A pause of less than two minutes is read too.
    assert spans == [[-90.0, 130.0], [910.0, 1100.0], [1230.0, 1420.0]]


def test_clocks_that_disagree_are_told_with_the_whole_record(tmp_path):
    rate = 1e-8 * np.random.default_rng(0).normal(size=(2000, 12))
    write_prodml(tmp_path / "a.h5", rate, start=START, sampling_rate=5.0, gauge_length=4.0, channel_spacing=1.0)
    source, table = Raw(describe([tmp_path / "a.h5"])), tracks(7200.0)
    part = wanted(source, table, [])
    record = source.record(**part)
    assert len(record.time) == 301
    words = r"\(2025-08-11T08:00:00Z to 2025-08-11T08:00:10Z\) and DAS \(2025-08-11T06:00:00Z to 2025-08-11T06:06:39Z\)"
    with pytest.raises(InputError, match=words):
        smooth_passes(table, record)


def test_tracks_that_come_later_are_read_for(tmp_path):
    """As where a video is tracked first: nothing is read until it is."""
    rate = 1e-8 * np.random.default_rng(0).normal(size=(5000, 12))
    write_prodml(tmp_path / "a.h5", rate, start=START, sampling_rate=5.0, gauge_length=4.0, channel_spacing=1.0)
    (tmp_path / "tracks.csv").write_text(tracks(300.0).to_csv(index=False))
    (tmp_path / "site.toml").write_text(
        "[frame]\norigin = [32.1, 34.8]\nx_azimuth = 78.0\n[das]\nfiles = ['a.h5']\n"
        "[trajectories]\nfiles = ['tracks.csv']\n"
    )
    read = Survey.read(tmp_path)
    assert isinstance(read.frame, LocalFrame)
    assert (read.record.start, len(read.record.time)) == (START + np.timedelta64(210, "s"), 951)
    untracked = Survey.of(**{k: v for k, v in vars(read).items() if k not in ("record", "_part")} | {"tracks": None})
    assert "record" not in vars(untracked)
    later = untracked.with_tracks(tracks(600.0))
    assert (later.record.start, len(later.record.time)) == (START + np.timedelta64(510, "s"), 951)
    assert [one.role for one in later.sources] == ["das", "trajectories"]
    # Who looks before there are tracks sees all.
    assert len(untracked.record.time) == 5000
    assert read.with_tracks(tracks(300.0)).record is read.record
