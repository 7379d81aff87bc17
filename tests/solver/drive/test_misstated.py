"""A drive tells what its files state wrongly, and fits it."""

import json
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import roadfiber as rf
from roadfiber.command import app
from solver.drive import channel_fit
from solver.drive.misstated import Estimate, Misstated, misstated, sized
from solver.start.alignment import NotFollowingError
from tests.solver.drive.conftest import SHORT
from tests.solver.drive.test_located_drive import along_error

HIDDEN = {"clock_drift": -0.005, "gauge_length": 0.25}


@pytest.fixture(scope="module")
def hidden(tmp_path_factory):
    """A drive whose gauges are longer than stated, and whose GPS gains time; with its truth."""
    site = rf.simulate(tmp_path_factory.mktemp("drives") / "hidden", "drive", effects=HIDDEN, **SHORT).site
    return rf.read(site), json.loads((site.parent / "truth.json").read_text())


@pytest.fixture(scope="module")
def wrong(hidden):
    return rf.locate(hidden[0])


@pytest.fixture(scope="module")
def better(hidden):
    return rf.locate(hidden[0], effects=list(HIDDEN))


def rms(run, truth):
    heard = run.arrays["heard"] & ~np.array(truth["in_loop"])
    return float(np.sqrt((along_error(run, truth)[heard] ** 2).mean()))


def test_what_is_stated_rightly_is_not_doubted(run):
    table = run.misstated.set_index("effect")
    assert set(table.index) == {"gauge_length", "channel_stretch", "clock_drift"}
    assert (table["probability"] < 0.5).all() and not table["fitted"].any()
    assert (table["value"].abs() < 3 * table["sigma"]).all()
    gate = next(one for one in run.facts["trust"]["gates"] if one["name"] == "stated")
    assert gate["verdict"] == "passed"
    assert all("would show" in words for words in table["words"])


def test_what_is_stated_wrongly_is_named_with_its_size(wrong):
    table = wrong.misstated.set_index("effect")
    assert table.index[table["probability"] > 0.95].tolist() == list(HIDDEN)
    for name, amount in HIDDEN.items():
        assert abs(table.loc[name, "value"] - amount) < 3 * table.loc[name, "sigma"] < abs(amount)
    gate = next(one for one in wrong.facts["trust"]["gates"] if one["name"] == "stated")
    assert gate["verdict"] == "failed" and "--effects clock_drift,gauge_length" in gate["mend"][0]


def test_fitted_it_brings_the_route_back(hidden, wrong, better):
    _, truth = hidden
    assert rms(better, truth) < 1.5 < 2 * rms(better, truth) < rms(wrong, truth)
    table = better.misstated.set_index("effect")
    assert table["fitted"].to_dict() == {"channel_stretch": False, "gauge_length": True, "clock_drift": True}
    for name, amount in HIDDEN.items():
        assert abs(table.loc[name, "value"] - amount) < 3 * table.loc[name, "sigma"]
    assert better.facts["settings"]["gauge_length"] == pytest.approx(SHORT.get("gauge_length", 10.0) / 1.25)


def test_diagnose_tells_it(wrong, tmp_path, capsys):
    wrong.save(tmp_path / "run")
    app(["diagnose", str(tmp_path / "run")], standalone_mode=False)
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("Clock drift, above 99.9 % probable to be wrong: ")
    assert lines[1].startswith("Gauge length, above 99.9 % probable to be wrong: The interrogator averages strain over")
    assert "next: locate again with `--effects clock_drift,gauge_length`, which fits that" in lines
    app(["diagnose", str(tmp_path / "run"), "--json"], standalone_mode=False)
    assert json.loads(capsys.readouterr().out) == wrong.facts["misstated"]
    assert "Are the files right?" in (tmp_path / "run" / "report.html").read_text()


def test_a_drive_takes_no_other_effects(drive):
    with pytest.raises(rf.InputError, match="takes the effects gauge_length, channel_stretch, clock_drift, not clock"):
        rf.locate(drive, effects=["clock_offset"])


def test_spacing_is_told_as_far_as_the_length_factor_is_known():
    found = {"channel_stretch": Estimate(0.03, 0.001)}
    loose, tight = (misstated(found, sigma, ())[0] for sigma in (0.02, 0.004))
    assert loose.probability < 0.5 and tight.named
    assert loose.shows > 0.1 > 0.02 > tight.shows


def test_a_size_that_would_show_is_named_and_a_smaller_one_is_not():
    for effect, sigma in (("gauge_length", 0.02), ("clock_drift", 3e-4)):
        shows = Misstated.of(effect, Estimate(0.0, sigma), 0.0).shows
        assert Misstated.of(effect, Estimate(-1.01 * shows, sigma), 0.0).named
        assert not Misstated.of(effect, Estimate(0.99 * shows, sigma), 0.0).named
        assert replace(Misstated.of(effect, Estimate(0.0, sigma), 0.0), probability=0.96).named


def test_size_of_what_is_named_is_that_of_a_fit_that_has_it() -> None:
    first = misstated({"clock_drift": Estimate(0.004, 0.0005), "gauge_length": Estimate(0.05, 0.04)}, 0.02, ())
    second = misstated({"clock_drift": Estimate(0.0047, 0.0002), "gauge_length": Estimate(0.3, 0.04)}, 0.02, ())
    found = {one.effect: one for one in sized(first, second)}
    assert found["clock_drift"].value == 0.0047 and found["clock_drift"].sigma < 0.00021
    assert found["clock_drift"].probability == first[0].probability
    assert found["gauge_length"] == first[1]


def test_what_is_named_is_sized_as_it_is_fitted(wrong, better):
    """Picks of a fit without it are made as if it were none, so that it finds too little: by a tenth and more."""
    table, fitted = (run.misstated.set_index("effect") for run in (wrong, better))
    for name in HIDDEN:
        assert abs(table.loc[name, "value"] - fitted.loc[name, "value"]) < 0.6 * table.loc[name, "sigma"]


def test_a_drive_that_is_located_is_not_refused_for_sizes(hidden, wrong, monkeypatch) -> None:
    def astray(*_: object) -> None:
        raise NotFollowingError("the record does not follow this drive", None)

    monkeypatch.setattr(channel_fit, "again", astray)
    found = rf.locate(hidden[0])
    place = found.route.columns.drop("reason")  # which tells what is misstated
    np.testing.assert_array_equal(found.route[place], wrong.route[place])
    assert list(found.misstated["probability"]) == list(wrong.misstated["probability"])
    assert (found.misstated["value"] != wrong.misstated["value"]).any()


def test_a_drift_that_is_not_named_widens_the_bands_by_where_it_would_move_them(monkeypatch) -> None:
    """Bands held a half of the route where a drift of 0.2 % did not show enough to be named."""
    moved = SimpleNamespace(cell=np.array([10.0, 25.0]), sigma=np.array([2.0, 5.0]))
    monkeypatch.setattr(channel_fit, "smoothed_again", lambda *given: moved)
    along: Any = SimpleNamespace(cell=np.array([10.0, 20.0]), sigma=np.array([2.0, 3.0]))
    done: Any = SimpleNamespace(last=SimpleNamespace(along=along))
    survey: Any = SimpleNamespace(effects=(), length_factor=(1.0, 0.01))
    rest: Any = None
    wrong = misstated({"clock_drift": Estimate(0.002, 0.0008), "gauge_length": Estimate(0.3, 0.04)}, 0.02, ())
    probability = next(one.probability for one in wrong if one.effect == "clock_drift")
    assert 0.2 < probability < 0.95
    variance = channel_fit.may_drift(survey, rest, rest, rest, done, wrong)
    assert variance.tolist() == pytest.approx([0.0, probability * (5.0**2 + 5.0**2 - 3.0**2)])
    fitted: Any = SimpleNamespace(effects=("clock_drift",), length_factor=(1.0, 0.01))
    assert not channel_fit.may_drift(fitted, rest, rest, rest, done, wrong).any()
