"""The Python door: one survey, one run, and verbs that take and return them; from files and from memory."""

import inspect
import json
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import torch
from matplotlib.figure import Figure

import roadfiber as rf
from solver.catalogue import plugins
from solver.catalogue.catalogue import built_in
from solver.survey.das import in_memory
from solver.survey.das.das_files import read_blocks
from vision.dropped import COLUMNS
from vision.tracked import Speed


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A survey of four passes: gauges are 15 % longer than told."""
    made = tmp_path_factory.mktemp("door")
    small = {"view": (0.0, 30.0), "channels": 111, "passes": 2, "seed": 11, "laid": "winding"}
    rf.simulate(made / "survey", "street-paper", effects={"gauge_length": 0.15, "point_load": 1.0}, **small)
    return made


@pytest.fixture(scope="module")
def survey(folder: Path) -> rf.Survey:
    return rf.read(folder / "survey" / "site.toml")


@pytest.fixture(scope="module")
def run(survey: rf.Survey) -> rf.Run:
    return rf.locate(survey, effects=[], corridor="fit")


def test_the_lines_of_the_readme_run_as_written(tmp_path: Path, monkeypatch) -> None:
    """On a small survey with a hidden effect, which they name among a few, add and see the error fall."""
    some = {name: one for name, one in built_in().items() if one.base_part or name in ("gauge_length", "camber")}
    monkeypatch.setattr(plugins, "built_in", lambda: some)
    text = (Path(rf.__file__).parents[1] / "README.md").read_text(encoding="utf-8")
    (lines,) = [block for block in re.findall(r"```python\n(.*?)```", text, re.DOTALL) if "rf.read" in block]
    small = {"view": (0.0, 30.0), "channels": 111, "passes": 3, "seed": 5, "laid": "winding"}
    rf.simulate(tmp_path / "survey", effects={"gauge_length": 0.12}, **small)
    monkeypatch.chdir(tmp_path / "survey")
    names: dict = {}
    exec(lines, names)
    run, better = names["run"], names["better"]
    assert names["diagnosis"].verdict == "missing-effect" and names["diagnosis"].effect == "gauge_length"
    assert better.effects == [*run.effects, "gauge_length"]
    assert better.result.chi2_per_dof < run.result.chi2_per_dof - 0.1
    feature = json.loads(Path("route.geojson").read_text(encoding="utf-8"))["features"][0]
    assert feature["geometry"]["type"] == "LineString" and len(feature["geometry"]["coordinates"][0]) == 3


def test_every_result_has_a_table_a_picture_and_a_page(survey: rf.Survey, run: rf.Run, folder: Path) -> None:
    """What is saved comes back as it was."""
    assert list(run.route)[:5] == ["channel", "distance", "x", "y", "z"]
    assert {"sigma_x", "sigma_y", "sigma_z", "latitude", "longitude", "constrained"} <= set(run.route)
    run.save(folder / "run")
    again = rf.open(folder / "run")
    pd.testing.assert_frame_equal(again.route, run.route)
    assert (again.headline, again.trust, again.effects) == (run.headline, run.trust, [])
    comparison = rf.compare(again)
    assert {"words", "chi2", "z"} <= set(comparison.regions)
    better = rf.add(again, "gauge_length", corridor="fit")
    assert better.effects == ["gauge_length"] and len(better.rungs) == 2
    ladder = rf.ladder(run, better)
    assert ladder.table["effects"].tolist() == [(), ("gauge_length",)]
    assert rf.ladder(better).facts["rungs"][0]["run"].endswith("run")
    better.save(folder / "run2")
    assert [one.effects for one in rf.open(folder / "run2").rungs] == [(), ("gauge_length",)]
    for one in (survey, run, comparison, ladder):
        assert isinstance(one.plot(), Figure)
        assert repr(one).startswith(f"<{type(one).__name__} ") and len(repr(one)) < 1500, "short, at the prompt"
    for one in (run, comparison, ladder):
        assert one._repr_html_().startswith("<iframe srcdoc=") and "&lt;!doctype html" in one._repr_html_()
    assert "<svg" in survey._repr_html_()


def test_the_corridor_of_a_run_holds_what_its_model_lacks(tmp_path: Path) -> None:
    """An AC coupling that the model lacks bends the route: the fit's own corridor is too narrow, the run's is not."""
    small = {"view": (0.0, 40.0), "channels": 121, "passes": 4, "seed": 11, "laid": "winding"}
    rf.simulate(tmp_path / "survey", "street", effects={"highpass": 0.07}, **small)
    with pytest.raises(rf.InputError, match="corridor wide: not known; give full or fit"):
        rf.locate(tmp_path / "survey", corridor="wide")
    run = rf.locate(tmp_path / "survey")
    truth = json.loads((tmp_path / "survey" / "truth.json").read_text(encoding="utf-8"))
    route, known = np.array(truth["route_xyz"]), run.route[run.route["constrained"]]
    off = np.abs(known["y"] - route[known["channel"], 1])
    assert (off <= 1.96 * known["sigma_y_fit"]).mean() < 0.85 and (off <= 1.96 * known["sigma_y"]).mean() > 0.95
    corridor = run.facts["corridor"]
    assert corridor["full"] and corridor["half_width"] > 1.1 * corridor["half_width_fit"]
    assert corridor["explanations"][0]["effects"] == ["highpass"] and "widened most by AC coupling" in run.corridor
    run.save(tmp_path / "run")
    again = rf.open(tmp_path / "run")
    assert again.corridor == run.corridor and "widened most by AC coupling" in again._repr_html_()


def test_a_diagnosis_is_a_table_a_picture_and_a_page(run: rf.Run, tmp_path: Path, monkeypatch) -> None:
    """What finds the effect is tested elsewhere."""
    from roadfiber import diagnosing
    from solver.criticism.candidate import Candidate
    from solver.criticism.corridor import Corridor
    from solver.criticism.explanations import Weighed
    from solver.criticism.finding import Diagnosis as Finding

    values = {"effect": "gauge_length", "stage": "interrogator", "verdict": "named", "unit": "1"}
    made: dict = dict.fromkeys(inspect.signature(Candidate).parameters, 0.1) | values
    made |= {"confounded_with": (), "generic": False, "refitted": True, "numbers": 1, "shape": {}, "told": None}
    weighed = (Weighed("effect", ("gauge_length",), "interrogator", 0.97), Weighed("nothing", (), "", 0.03))
    channel = run.result.channel[2:]
    wider = np.tile(np.diag([0.0, 0.25, 0.0]), (len(channel), 1, 1))
    added = Corridor(channel, wider, np.zeros((len(channel), 2, 3)), "", 0)
    finding = Finding(
        verdict="missing-effect",
        words="it is",
        candidates=(Candidate(**made),),
        audit=None,  # type: ignore[arg-type]
        stress=0.0,
        explanations=weighed,
        corridor=added,
    )

    def diagnosed(*given: object, tell: Callable[[str, tuple[Candidate, ...]], None], **more: object) -> Finding:
        tell("score test", finding.candidates)
        return finding

    monkeypatch.setattr(diagnosing, "diagnose_problem", diagnosed)
    told: list[str] = []
    found = rf.diagnose(run, tell=told.append)
    assert [words.splitlines()[0] for words in told] == ["score test: nothing shows so far"], "none is present"
    assert "  gauge_length           chi2 falls by        0" in told[0]
    assert (found.verdict, found.effect) == ("missing-effect", "gauge_length")
    assert found.table["stage"].tolist() == ["interrogator"] and isinstance(found.plot(), Figure)
    lines = found.lines()
    assert lines[0] == "missing-effect: it is"
    assert "how probable: gauge_length 97 %, Nothing that would show 3 %" in lines
    assert any(line.startswith("95 % corridor: ") and "with what the model may lack" in line for line in lines)
    table = found.probabilities
    assert table["probability"].tolist() == [0.97, 0.03] and table["kind"].tolist() == ["effect", "nothing"]
    np.testing.assert_allclose(found.route["sigma_y"] ** 2 - run.route["sigma_y_fit"] ** 2, 0.25)
    assert found.route["y"].tolist() == run.route["y"].tolist()


def test_a_survey_in_memory_is_the_one_in_its_files(survey: rf.Survey, run: rf.Run, folder: Path) -> None:
    """A patch, a DataArray-like and an array give the record that the files give, and so the route."""
    import dascore as dc

    files = sorted((folder / "survey").glob("das/*"))
    patch = dc.spool([dc.read(path)[0] for path in files]).chunk(time=None)[0]
    tables = {"tracks": survey.tracks, "anchors": pd.read_csv(folder / "survey" / "anchors.csv")}
    given = tables | {"frame": survey.frame}
    patched = rf.Survey(das=patch, **given)
    np.testing.assert_array_equal(patched.record.strain_rate, survey.record.strain_rate)
    blocks = sorted((block for path in files for block in read_blocks(path)), key=lambda block: block.time[0])
    block = blocks[0]
    array = rf.Survey(
        das=np.concatenate([one.data for one in blocks]),
        time=np.concatenate([one.time for one in blocks]).astype("datetime64[ns]"),
        distance=block.distance,
        first_channel=block.first_channel,
        gauge_length=block.gauge_length,
        quantity=block.unit.quantity,
        scale=block.unit.factor,
        **tables,
        frame=(*survey.frame.origin, survey.frame.x_azimuth),
    )
    np.testing.assert_allclose(array.record.strain_rate, survey.record.strain_rate)
    located = rf.locate(array, effects=[], corridor="fit")
    np.testing.assert_allclose(located.route[["x", "y", "z"]], run.route[["x", "y", "z"]], atol=1e-6)
    assert [one["role"] for one in located.facts["inputs"]] == ["das", "trajectories", "anchors"]
    located.save(folder / "memory")
    assert rf.open(folder / "memory").name == "survey"


class DataArray:
    """As much of xarray's as is used, where xarray is not installed."""

    def __init__(self, values, dims, coords, attrs):
        self.values, self.dims, self.attrs = values, dims, attrs
        self.coords = {name: SimpleNamespace(values=value) for name, value in coords.items()}

    def transpose(self, *dims):
        values = self.values if dims == self.dims else self.values.T
        return DataArray(values, dims, {name: one.values for name, one in self.coords.items()}, self.attrs)


@pytest.fixture
def xarray(monkeypatch):
    module = sys.modules.get("xarray") or SimpleNamespace(DataArray=DataArray)
    monkeypatch.setitem(sys.modules, "xarray", module)
    return module


TIMES = np.datetime64("2025-08-11T06:00:00", "ns") + np.arange(4) * np.timedelta64(200, "ms")


def test_a_data_array_says_its_channels_gauge_and_unit(xarray) -> None:
    coords = {"time": TIMES, "channel": np.array([7, 8, 9])}
    attrs = {"gauge_length": 10, "units": "nm/m/s"}
    block = in_memory.block_of(xarray.DataArray(np.ones((3, 4)), dims=("channel", "time"), coords=coords, attrs=attrs))
    assert block.data.shape == (4, 3) and block.first_channel == 7 and block.gauge_length == 10.0
    assert block.distance is None and block.unit is not None and block.unit.factor == pytest.approx(1e-9)


@pytest.mark.parametrize(
    ("das", "more", "message"),
    [
        (np.zeros((4, 3)), {}, "an array alone has no times; give time="),
        (np.zeros((4, 3)), {"time": np.arange(4.0)}, "time is float64; give datetime64 in UTC"),
        (np.zeros((4, 3)), {"time": TIMES[:3]}, r"time has shape \(3,\), the array \(4, 3\)"),
        (np.zeros((4, 3)), {"time": TIMES, "distance": [0.0]}, r"distance has shape \(1,\)"),
        (np.zeros(4), {"time": TIMES}, r"an array of float64 \(4,\); give real numbers"),
        (np.zeros((0, 3)), {"time": TIMES[:0]}, "no samples"),
        (object(), {}, "an array of object"),
    ],
)
def test_what_is_not_a_record_is_reported_in_a_line(das, more, message) -> None:
    with pytest.raises(rf.InputError, match=message):
        in_memory.block_of(das, **more)


@pytest.mark.parametrize(("time", "is_of"), [(TIMES - TIMES[0], "timedelta64"), (np.arange(4) * 0.2, "float64")])
def test_a_patch_without_dates_is_reported(time, is_of) -> None:
    """It was read as one of 1970."""
    import dascore as dc

    patch = dc.Patch(np.ones((4, 3)), coords={"time": time, "distance": np.arange(3.0)}, dims=("time", "distance"))
    with pytest.raises(rf.InputError, match=rf"time is {is_of}.*; give datetime64 in UTC"):
        in_memory.block_of(patch)


def test_an_effect_of_one_s_own_is_an_object(run: rf.Run, folder: Path) -> None:
    """It is verified, added, told on opening where it is missing, and found again where it is given."""

    @rf.effect("grip", "cable", [rf.Parameter("share", "1", 0.1, scope="fiber")], physics="Grip varies.", source="-")
    def grip(cable, p, survey):
        return replace(cable, gain=cable.gain * (1 + p["share"]))

    grown = rf.add(run, grip, force=True, corridor="fit")
    assert grown.effects == ["grip"]
    grown.save(folder / "own")
    assert rf.open(folder / "own").effects == ["grip"]
    with pytest.raises(rf.InputError, match="made with the effect grip, which is not installed"):
        rf.add(rf.open(folder / "own"), "camber")
    opened = rf.open(folder / "own", effects=[grip])
    assert torch.isfinite(torch.tensor(rf.compare(opened).finding.level))
    with pytest.raises(rf.InputError, match="is in the model already"):
        rf.add(opened, grip)


def test_what_is_not_wanted_is_refused(run: rf.Run) -> None:
    with pytest.raises(rf.InputError, match="no effect to add"):
        rf.add(run)
    with pytest.raises(rf.InputError, match="effect nosuch: not known"):
        rf.add(run, "nosuch")
    with pytest.raises(rf.InputError, match="no run to draw"):
        rf.ladder()
    with pytest.raises(AttributeError, match="no attribute 'nosuch'"):
        rf.nosuch  # noqa: B018


def test_ctrl_c_is_not_swallowed(survey: rf.Survey, monkeypatch) -> None:
    from solver.run import locate as module

    def interrupted(*given, **more):
        raise KeyboardInterrupt

    monkeypatch.setattr(module, "fit_route", interrupted)
    with pytest.raises(KeyboardInterrupt):
        rf.locate(survey, effects=[])


def test_a_video_is_tracked_first_and_its_tracks_are_kept(
    survey: rf.Survey, run: rf.Run, tmp_path, monkeypatch
) -> None:
    from roadfiber import locating

    far = pd.DataFrame([dict.fromkeys(COLUMNS, 1) | {"track_id": "", "cause": "above the horizon"}])
    table = survey.tracks.assign(interpolated=False)
    seen = rf.Tracked(table, far, Speed(9, 9, 1.0, 1.0, 1.0), SimpleNamespace(width=9, height=9))
    monkeypatch.setattr(locating, "followed", lambda whole: seen)
    filmed = rf.Survey.of(**vars(survey) | {"tracks": None})
    located = rf.locate(filmed, effects=[], corridor="fit")
    told = f"{len(table)} of {len(table) + 1} detected fixes placed on the road; 1 above the horizon"
    assert told in located.warnings and told in located.facts["notes"]
    np.testing.assert_allclose(located.route["y"], run.route["y"], atol=1e-6)
    located.save(tmp_path / "run")
    kept = pd.read_csv(tmp_path / "run" / "trajectories.csv")
    assert len(kept) == len(survey.tracks)
    assert pd.read_csv(tmp_path / "run" / "trajectories.csv.dropped")["cause"].tolist() == ["above the horizon"]
    assert isinstance(seen.plot(), Figure) and "vehicles: " in seen._repr_html_()
    assert "not tracked yet" in filmed._repr_html_()


def test_importing_the_door_loads_nothing_heavy_and_neither_does_what_only_hands_out_work() -> None:
    heavy = {"torch", "scipy", "matplotlib", "onnxruntime", "dascore"}
    script = (
        "import sys, roadfiber; print({} & set(sys.modules)); import roadfiber.batching; print({} & set(sys.modules))"
    )
    script = script.format(heavy | {"numpy", "pandas"}, heavy)
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\nset()\n"


@pytest.mark.parametrize("name", rf.__all__)
def test_every_public_name_is_documented_with_an_example(name: str) -> None:
    value = getattr(rf, name)
    assert inspect.getdoc(value)
    own = getattr(value, "__module__", "").startswith("roadfiber")
    if own and inspect.isfunction(value):
        assert ">>> rf." in inspect.getdoc(value) or "= rf." in inspect.getdoc(value)
    assert name in dir(rf)


def test_the_package_is_typed() -> None:
    root = Path(rf.__file__).parents[1]
    assert all((root / name / "py.typed").is_file() for name in ("roadfiber", "solver", "vision", "calib"))


@pytest.mark.parametrize("number", [0, slice(None)])
def test_fitted_numbers_at_which_no_fit_ends_are_refused_where_the_model_is_evaluated(
    run: rf.Run, number: object
) -> None:
    vector = run.result.vector.copy()
    vector[number] = 1e6
    with pytest.raises(rf.InputError, match="fitted numbers are farther from what was expected"):
        rf.clock_offset(replace(run, result=replace(run.result, vector=vector)))
