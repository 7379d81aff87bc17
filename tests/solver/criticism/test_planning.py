"""A plan against the fit of the survey that was planned, against itself with more in it, and as a user meets it."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from typer.testing import CliRunner

import roadfiber.command
from benchmarks.plan import site_of
from solver.catalogue.catalogue import built_in
from solver.criticism.planning.additions import Known, Sigmas, anchor_options, lane_words, pass_options, way_to
from solver.criticism.planning.plan import Plan, plan_survey
from solver.criticism.planning.planned import Planned
from solver.criticism.planning.planned_drives import drives
from solver.criticism.planning.planned_site import read_planned
from solver.criticism.scorer import Scorer
from solver.fit.chain import Chain
from solver.fit.map_fit import MapFit
from solver.fit.posterior import Posterior
from solver.run.locate import locate
from solver.run.run import Run
from solver.simulator import Scenario, Survey, simulate, write_survey
from solver.survey.plan_section import PlanSection
from solver.survey.survey import Survey as Read
from tests.offline_pages import EVIL, is_whole, tells
from vision.contract import InputError

LANES = [
    {"y": 0.0, "toward": "+x", "vehicles": {"car": 1, "truck": 1}},
    {"y": -3.5, "toward": "-x", "vehicles": {"car": 1}},
]
SITE = {
    "das": {"gauge_length": 10.0},
    "plan": {"length": 30.0, "offset": 4.0, "noise": 2e-8, "sampling_rate": 5.0, "anchors": [5.0], "lanes": LANES},
}


def changed(**plan: Any) -> dict[str, Any]:
    return SITE | {"plan": SITE["plan"] | plan}


@pytest.fixture(scope="module")
def small() -> Planned:
    return Planned.of(read_planned(SITE))


def known_of(planned: Planned) -> Known:
    chain = Chain.single(MapFit(planned.problem))
    return Known.of(planned, Posterior(chain, chain.visit(planned.state)))


@pytest.mark.parametrize(
    ("site", "said"),
    [
        ({"plan": SITE["plan"]}, "plan: no das; add it"),
        ({"das": SITE["das"]}, "plan: no plan; add it"),
        (changed(snr=3), "unknown key snr in [plan]; did you mean snr_db?"),
        (changed(snr_db=3), "give one of snr_db"),
        (changed(noise=None), "give one of snr_db"),
        (changed(length=500), "length: input should be less than or equal to 200"),
        (changed(offset=60), "the fiber at offset 60 m is 60 m from the nearest lane"),
        (changed(anchors=[31]), "anchors: give x of each between 0 and length (30 m)"),
        (changed(speeds=[60, 30]), "speeds: [60.0, 30.0]; give the slowest and the fastest in km/h"),
        (changed(lanes=[{"y": 0.0, "toward": "+x"}]), "lanes have 0 vehicles; give 1 to 60"),
        (changed(lanes=[]), "lanes: list should have at least 1 item"),
    ],
)
def test_what_cannot_be_planned_is_one_line(site: Mapping[str, Any], said: str) -> None:
    with pytest.raises(InputError) as error:
        read_planned(site)
    assert said in str(error.value) and "\n" not in str(error.value)


def test_every_vehicle_drives_once_and_none_while_another_does(small: Planned) -> None:
    assert sorted(one.vehicle_class for one in small.drives) == ["car", "car", "truck"]
    rows = np.concatenate([one.rows for one in small.problem.passes])
    assert len(np.unique(rows)) == len(rows)
    for drive, one in zip(small.drives, small.problem.passes, strict=True):
        assert np.sign(one.speed) == drive.lane.direction
        assert abs(np.median(one.position[:, 1]) - drive.lane.y) < 0.1
        assert abs(one.speed) == pytest.approx(drive.speed, rel=0.03)


def test_the_noise_has_the_snr_of_the_plan() -> None:
    loud, quiet = (Planned.of(read_planned(changed(noise=None, snr_db=db))).noise for db in (0, 20))
    assert loud == pytest.approx(10 * quiet)
    section = PlanSection.model_validate(changed()["plan"])
    assert len(drives(section)) == section.vehicles == 3


def test_heavier_vehicles_less_noise_and_anchors_narrow() -> None:
    def across(**plan: Any) -> float:
        return plan_survey(changed(**plan), effects=[]).expected.across

    trucks = [lane | {"vehicles": {"truck": 2}} for lane in LANES]
    assert across(lanes=trucks) < across() < across(noise=4e-8)
    assert across(anchors=[5.0, 25.0]) < across() < across(anchors=[])


@pytest.fixture(scope="module", params=[7, 8])
def driven(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Survey, Run]:
    """A simulated survey and its fit."""
    scenario = Scenario(seed=request.param, view=(0.0, 50.0), channels=131, passes=5, noise="white", snr_db=15.0)
    survey = simulate(scenario)
    site = write_survey(survey, tmp_path_factory.mktemp("driven") / "survey")
    return survey, locate(Read.read(site))


def test_planned_sigmas_are_those_of_the_fit(driven: tuple[Survey, Run]) -> None:
    survey, run = driven
    plan = plan_survey(site_of(survey), effects=[])
    view = np.arange(survey.active[0], survey.active[1] + 1)
    fitted = run.result.sigma[np.isin(run.result.channel, view)]
    chain = Chain.single(MapFit(run.problem))
    state = chain.state_of(torch.from_numpy(run.result.vector))
    fitted = fitted / Posterior(chain, chain.visit(state)).scale ** 0.5
    planned = plan.table[["sigma_x", "sigma_y", "sigma_z"]].to_numpy()
    ratio = np.sqrt((planned**2).mean(0) / (fitted**2).mean(0))
    assert ratio == pytest.approx(1.0, abs=0.15)
    assert plan.planned.noise == pytest.approx(survey.noise_sd, rel=0.4)


def test_smallest_sizes_are_those_of_the_fit(driven: tuple[Survey, Run]) -> None:
    survey, run = driven
    asked = [built_in()[name] for name in ("gauge_length", "clock_offset", "highpass", "channel_stretch")]
    planned = {one.effect: one for one in plan_survey(site_of(survey), effects=asked).effects}
    fit = MapFit(run.problem)
    scorer = Scorer(fit, fit.state_of(torch.from_numpy(run.result.vector)))
    for effect in asked[:3]:
        score = next(iter(scorer.scores(effect)))
        size = 5 * float(np.nanmedian(score.sigma)) * scorer.variance**0.5
        shown = planned[effect.name].size / (planned[effect.name].plausible / effect.amplitudes[0].plausible)
        assert 1 / 1.7 < shown / size < 1.7, effect.name
    assert set(planned) == {one.name for one in asked}


def test_what_an_addition_is_said_to_do_it_does(small: Planned) -> None:
    known = known_of(small)
    (option,) = [one for one in pass_options(small) if "truck" in one.words and "far" in one.words]
    said = known.with_more(option.information).sigmas
    lanes = [LANES[0], LANES[1] | {"vehicles": {"car": 1, "truck": 1}}]
    done = known_of(Planned.of(read_planned(changed(lanes=lanes, speeds=[44.9, 45.1])))).sigmas
    same = known_of(Planned.of(read_planned(changed(speeds=[44.9, 45.1])))).sigmas
    assert said.across / known.sigmas.across == pytest.approx(done.across / same.across, rel=0.1)
    assert said.across < known.sigmas.across
    (anchor,) = [one for one in anchor_options(small, known) if one.words.endswith("x = 25 m")]
    said = known.with_more(anchor.information).sigmas
    done = known_of(Planned.of(read_planned(changed(anchors=[5.0, 25.0])))).sigmas
    assert (said.across, said.depth) == pytest.approx((done.across, done.depth), rel=1e-3)


def test_additions_end_where_what_is_wanted_is_reached(small: Planned) -> None:
    known, options = known_of(small), pass_options(small)
    wanted = Sigmas(0.8 * known.sigmas.across, np.inf)
    way = way_to("passes", known, options, wanted)
    assert way.reached and way.additions[-1].after.across <= wanted.across
    assert all(one.after.across > wanted.across for one in way.additions[:-1])
    never = way_to("passes", known, options, Sigmas(1e-6, np.inf))
    assert not never.reached and len(never.additions) == 12
    assert way_to("passes", known, options, Sigmas(1.0, 1.0)).additions == ()
    assert lane_words(small.site.plan.lanes, small.site.plan.lanes[0], 4.0).startswith("near lane")


@pytest.fixture(scope="module")
def plan() -> Plan:
    asked = [built_in()[name] for name in ("gauge_length", "sloping_fiber", "road_bump")]
    return plan_survey(changed(anchors=[]) | {"name": EVIL}, wanted=0.03, effects=asked)


def test_a_plan_is_read_as_table_page_and_json(plan: Plan, tmp_path: Path) -> None:
    assert len(plan.table) == 31 and plan.table["sigma_y"].max() >= plan.expected.across - 1e-6
    assert "Expected from 3 vehicles and no anchor" in plan.headline
    page = plan.page()
    assert "<script" not in page and tells(page) and is_whole(page)
    assert "Gauge length" in page and "wanted accuracy" in page
    assert plan.page() in plan._repr_html_().replace("&lt;", "<").replace("&gt;", ">").replace("&quot;", '"').replace(
        "&#x27;", "'"
    ).replace("&amp;", "&")
    plan.save(tmp_path / "out")
    facts = json.loads((tmp_path / "out" / "plan.json").read_text())
    assert facts["format"] == "roadfiber plan 1" and facts["expected"]["across"] == plan.expected.across
    assert [axes.get_label() for axes in plan.plot(600).axes] == ["plan", "sigma"]
    shows = plan.effect_table.set_index("effect")["visible"]
    assert shows["sloping_fiber"] == "no"  # on a straight, level fiber it does nothing
    assert all("depth" in line for line in plan.warnings)


def test_the_command_writes_a_plan_or_nothing(tmp_path: Path) -> None:
    lanes = '[{ y = 0.0, toward = "+x", vehicles = { car = 1, truck = 1 } }]'
    text = f"[das]\ngauge_length = 10.0\n[plan]\nlength = 20\noffset = 4.0\nsnr_db = 15\nlanes = {lanes}\n"
    (tmp_path / "site.toml").write_text(text + "sampling_rate = 5\n")
    words = ["plan", str(tmp_path), "--no-effects", "--out", str(tmp_path / "out")]
    done = CliRunner().invoke(roadfiber.command.app, words)
    assert done.exit_code == 0 and done.output.startswith("Expected from 2 vehicles")
    assert {one.name for one in (tmp_path / "out").iterdir()} == {"plan.html", "plan.json", "plan.csv"}
    (tmp_path / "site.toml").write_text(text.replace("snr_db", "snr"))
    refused = CliRunner().invoke(roadfiber.command.app, [*words[:-1], str(tmp_path / "none")])
    assert isinstance(refused.exception, InputError) and not (tmp_path / "none").exists()
