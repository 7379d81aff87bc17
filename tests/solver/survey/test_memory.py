"""Work that does not fit into memory is refused before it begins, with what would fit."""

import re
from dataclasses import replace

import numpy as np
import pytest

from solver.catalogue.trial_survey import trial_survey
from solver.fit.room import BY_CELL_AND_PASS, BY_SAMPLE, fit_memory, require_room_to_fit
from solver.fit.stretches import part
from solver.signal_path.traffic import Traffic
from solver.survey import memory
from solver.survey.das import read_das
from vision.contract import InputError


@pytest.fixture
def room(monkeypatch):
    """Let the machine have so many bytes."""

    def has(size: float) -> None:
        for user in ("solver.survey.memory", "solver.fit.room"):
            monkeypatch.setattr(f"{user}.available", lambda: size)

    return has


def arrays(folder, rows=100, columns=20):
    x = (1e-8 * np.random.default_rng(0).standard_normal((rows, columns))).astype(np.float32)
    np.save(folder / "a.npy", x)
    side = (
        "start = 2025-08-11T06:00:00Z\nsampling_rate = 10.0\nunit = '1/s'\nchannel_spacing = 1.0\ngauge_length = 10.0\n"
    )
    (folder / "a.toml").write_text(side)
    return folder / "a.npy"


def test_a_record_that_does_not_fit_is_refused_before_it_is_read(tmp_path, room, monkeypatch):
    path = arrays(tmp_path)
    room(20e3)
    monkeypatch.setattr("solver.survey.das.reading.slabs", lambda *given: pytest.fail("was read"))
    words = r"a\.npy: a record of 100 samples of 20 channels needs about 3\.2e-05 GB of memory, and 2e-05 GB are "
    with pytest.raises(InputError, match=words + r"free, enough for 62% of it; name fewer channels, channels = "):
        read_das([path])


def test_fewer_channels_fit(tmp_path, room):
    path = arrays(tmp_path)
    room(20e3)
    assert read_das([path], channels=(3, 9)).strain_rate.shape == (100, 7)
    with pytest.raises(
        InputError, match=r"a\.npy: a record of 100 samples of 17 channels needs about .* fewer channel"
    ):
        read_das([path], channels=(3, 19))


def test_a_fit_that_does_not_fit_says_what_would(room):
    problem = trial_survey()[0].problem
    channels, passes = len(problem.channel), len(problem.passes)
    needed = fit_memory(problem, channels)
    room(needed)
    require_room_to_fit(problem)
    room(0.95 * needed)
    with pytest.raises(InputError) as caught:
        require_room_to_fit(problem)
    told = re.fullmatch(
        rf"fitting {channels} channels and {passes} passes needs about .* of memory, and .* are free, enough for 95% "
        r"of it; name (\d+) channels at most, channels = \[first, last\], in \[das\] of site\.toml, or give the tracks "
        r"of (\d+) passes",
        str(caught.value),
    )
    assert fit_memory(problem, int(told[1])) <= 0.95 * needed < fit_memory(problem, int(told[1]) + 1)
    kept = int(told[2])
    assert 0 < kept < passes and fit_memory(part(problem, np.arange(kept)), channels) <= 0.95 * needed


def test_many_vehicles_one_after_the_other_take_little_more_than_two(room):
    """What is kept of each sample, and no derivative of all passes."""
    problem = trial_survey()[0].problem
    first = min(int(one.rows[0]) for one in problem.passes)
    apart = [replace(one, rows=one.rows - first + 1000 * k) for k in range(40) for one in problem.passes[:1]]
    many = replace(problem, passes=apart, traffic=Traffic.of(apart), effects=())
    few = part(many, np.arange(2))
    more = len(many.traffic.samples) - len(few.traffic.samples)
    grown = fit_memory(many, 80) - fit_memory(few, 80)
    assert 0 < grown < 80 * more * (BY_SAMPLE + 1.01 * BY_CELL_AND_PASS) < 0.1 * 80 * more * BY_CELL_AND_PASS * 40


def test_a_container_s_limit_counts(tmp_path, monkeypatch):
    files = [tmp_path / "limit", tmp_path / "use"]
    monkeypatch.setattr(memory, "CGROUPS", [tuple(map(str, files))])
    for limit, free in (("5000000", 2e6), ("max", None)):
        files[0].write_text(limit)
        files[1].write_text("3000000")
        assert memory.available() == free if free else memory.available() > 5e6


def test_a_system_that_says_nothing_refuses_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(memory, "CGROUPS", [])
    monkeypatch.setattr(memory, "MEMINFO", tmp_path / "absent")
    monkeypatch.delattr(memory.os, "sysconf")
    assert memory.available() == float("inf")
    memory.require_memory(1e30, "anything", "nothing")
