"""The report: one file, offline, saying what the run says."""

import base64
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from solver.catalogue.catalogue import built_in
from solver.fit.result import Corner, Parameter
from solver.run.facts import facts_of
from solver.run.report import misfit as misfit_module
from solver.run.report import report_words as words
from solver.run.report.fit_tables import gauge_words, parameter_tables
from solver.run.report.misfit import misfit_of, nearest_channel
from solver.run.report.misfit_figure import failure_figure, pictures_of, wave_figure, wave_pictures
from solver.run.report.pass_panes import waves
from solver.run.report.report_page import legend, render
from solver.run.report.report_words import told
from solver.run.report.route_figure import along_x, route_figure, same_scale
from solver.run.run import Run
from vision.contract.drawing import coarse, color_map, color_scale
from vision.contract.figures import svg
from vision.contract.statements import Statements, statement

VOID = {"meta", "img", "input", "br", "path", "use", "link"}


class Reader(HTMLParser):
    """Checks that elements are closed in order; collects text, sources and ids."""

    def __init__(self):
        super().__init__()
        self.open, self.text, self.attributes, self.tags = [], [], [], []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += attrs
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += attrs

    def handle_endtag(self, tag):
        if tag not in VOID:
            assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


def made_run(survey, **changes) -> Run:
    s, result = survey, replace(survey.result, **changes)
    facts = facts_of(result, s.arguments["survey"], s.anchors, s.problem, {"fit": 1.5}, None, ["wheels"])
    time = survey.record.time[result.samples]
    return told(Run(result, s.site.frame, s.record.start, time, s.passes, s.anchors, facts, problem=s.problem))


@pytest.fixture(scope="module")
def page(survey) -> str:
    return render(made_run(survey))


def read(page: str) -> Reader:
    reader = Reader()
    reader.feed(page)
    reader.close()
    assert reader.open == []
    return reader


def test_page_is_whole_html_and_says_the_name_as_written(page):
    reader = read(page)
    text = " ".join(reader.text)
    assert "Elm <Street> & 2nd" in text
    assert "Street" not in reader.tags
    assert "The fiber runs" in text
    assert text.count("pit <1> $^$") > 1  # in the picture too, where it is no formula
    assert "${" not in text


def test_page_needs_no_other_file_and_no_network(page):
    assert not re.search(r"https?://|//cdn|@import|url\((?!['\"]?#)", page)
    sources = [value for name, value in read(page).attributes if name in ("src", "href", "xlink:href")]
    assert sources
    assert all(value.startswith(("data:image/png;base64,", "#")) for value in sources)
    assert len(page) < 5e6


def test_page_shows_each_pass_and_one_selected(page):
    assert len(re.findall(r'class="pane pane-\d+"', page)) == 2
    assert page.count(" checked>") == 1
    assert "bus ←" in page
    assert "car →" in page


def test_pointer_data_are_the_route(survey, page):
    data = json.loads(re.search(r'<script type="application/json" id="route">(.*?)</script>', page).group(1))
    np.testing.assert_allclose(np.stack([data["x"], data["y"], data["z"]], 1), survey.result.route, atol=6e-4)
    panels = json.loads(re.search(r"data-panels='(.*?)'", page).group(1))
    assert [panel["name"] for panel in panels] == ["plan", "lateral", "depth"]
    assert {panel["across"] for panel in panels} == {"x"}


def test_page_of_a_method_without_uncertainty(survey):
    nothing = {"covariance": np.full_like(survey.result.covariance, np.nan)}
    nothing["data_share"] = np.full_like(survey.result.data_share, np.nan)
    text = " ".join(read(render(made_run(survey, **nothing))).text)
    assert "not stated" in text
    assert not re.search(r"\bnan\b", text)


def test_the_channel_beside_a_vehicle_is_the_nearest_wherever_the_frame_begins(survey):
    run = made_run(survey)
    for far in (0.0, 1e5):  # m from the origin, as of a drive
        result = replace(run.result, route=run.result.route + far)
        for one in (replace(one, position=one.position + far) for one in run.passes):
            apart = np.linalg.norm(one.position[:, None] - result.route[None, :, :2], axis=2)
            expected = result.channel[apart.argmin(1)].astype(float)
            beyond = (expected <= result.fitted_channel[0]) | (expected >= result.fitted_channel[-1])
            np.testing.assert_array_equal(nearest_channel(result, one), np.where(beyond, np.nan, expected))


def test_page_of_a_route_that_turns_uses_distance(survey):
    angle = np.linspace(0, np.pi / 2, len(survey.result.channel))
    turn = np.stack([40 * np.sin(angle), 4 + 40 * (1 - np.cos(angle)), np.ones_like(angle)], 1)
    assert not along_x(turn)
    page = render(made_run(survey, route=turn))
    assert "distance along the fiber, m" in page


def test_page_with_many_passes_shows_the_worst_and_says_so(survey, monkeypatch):
    monkeypatch.setattr("solver.run.report.pass_panes.MOST_PASSES", 2)
    many = replace(survey, passes=[replace(survey.passes[i % 2], track_id=f"track {i}") for i in range(5)])
    result = spoiled(survey, slice(60, 100), slice(10, 20), 5.0)
    parts = waves(made_run(replace(many, result=result)), misfit_of(result, many.passes))
    assert parts["radios"].count("<input") == parts["panes"].count("pane-") == 2
    assert "track 1" in parts["chips"]
    assert "track 3" in parts["chips"]
    assert "the 2 passes that fit worst, of 5" in parts["explained"]


# ---- words ----------------------------------------------------------------------------------------------------------


def test_headline_has_side_and_depth(survey):
    bare = replace(survey, problem=replace(survey.problem, anchors=[]))
    run = made_run(bare, route=np.tile([0.0, -2.5, 0.8], (61, 1)))
    assert words.headline(run) == "The fiber runs 2.50 m left of the survey line, about 0.80 m below the road."


def test_headline_is_careful_where_data_do_not_decide(survey):
    assert "probably" in words.headline(made_run(survey, constrained=np.zeros(61, bool)))
    assert "probably" not in words.headline(made_run(survey))


def test_headline_says_where_a_check_failed_that_it_is_the_fit_that_puts_the_fiber_there(survey):
    run = made_run(survey, chi2_per_dof=1.5)
    assert words.headline(run).startswith("The fit puts the fiber 3.62 to 4.50 m right")
    assert words.headline(run).endswith("below the road, but does not pass every check.")


def test_page_says_what_fit_json_says(survey):
    run = made_run(survey, chi2_per_dof=1.5, converged=False)
    text = " ".join(read(render(run)).text)
    assert run.facts["headline"] in text
    assert run.facts["trust"]["sentence"].split(" Next: ")[0] in text
    assert "<code>roadfiber diagnose RUN</code> says what the model lacks" in render(run)
    assert "not converged in 7 steps" in run.facts["trust"]["sentence"]
    for gate in run.facts["trust"]["gates"]:
        assert gate["words"] in text


def test_page_says_what_files_state_and_what_was_taken(survey):
    run = made_run(survey)
    rate = statement("rate", [("OutputDataRate", 5.0), ("PartEndTime", 4.0)], 5.0, unit="Hz", within=1e-3)
    stated = [Statements(name, (rate,)).to_dict() for name in ("a<b>.h5", "c.h5")]
    text = read(render(replace(run, facts=run.facts | {"statements": stated}))).text
    assert {"a<b>.h5", "5 Hz", "OutputDataRate 5 Hz, PartEndTime 4 Hz", "PartEndTime says 4 Hz; 5 Hz is taken"} <= {
        *text
    }
    assert "1 more of the files state the same but for their times." in text


def test_a_good_fit_has_only_the_cautions_that_are_true(survey):
    (loose, dead) = words.cautions(made_run(survey))
    assert "at channels 50 to 51, 109 to 110" in loose
    assert dead == "1 channel within the range gave no data."


def test_cautions_name_what_the_data_do_not_decide(survey):
    share = np.full((61, 3), 0.9)
    share[:, 2] = 0.2
    lines = words.cautions(made_run(survey, data_share=share, constrained=np.zeros(61, bool)))
    text = "\n".join(lines)
    for part in ("Sideways, the expected smoothness", "Depth: the assumed 0.9 ± 0.3 m", "all along"):
        assert part in text


@pytest.mark.parametrize(("size", "says"), [(1e-11, "less than any vehicle can"), (0.5, "more than any vehicle can")])
def test_a_strain_that_no_vehicle_makes_is_a_caution(survey, size, says):
    """A record a million times too quiet passed without a word."""
    weak = {
        name: replace(value, value=size) if name.startswith("amplitude") else value
        for name, value in survey.result.parameters.items()
    }
    lines = words.cautions(made_run(survey, parameters=weak))
    assert [says in line for line in lines].count(True) == 1


def test_page_says_that_what_held_out_passes_take_up_is_not_known(survey):
    text = " ".join(read(render(made_run(survey))).text)
    assert "For passes held out that share is not known: each still fits its own strength" in text


def test_key_figures(survey):
    figures = {label: value for label, value, _ in words.key_figures(made_run(survey))}
    assert figures["Sideways, 95 %"] == "± 0.10 m"
    assert figures["Depth, 95 %"] == "± 0.08 m"
    assert figures["Located"] == "56 m"
    notes = {label: note for label, _, note in words.key_figures(made_run(survey))}
    assert notes["Misfit, chi²/dof"].startswith("noise alone leaves ")


def test_the_gauge_length_is_that_of_the_model(survey):
    assert gauge_words(made_run(survey)) == "10 m"
    problem = replace(survey.problem, effects=(built_in()["gauge_length"],))
    fitted = survey.result.parameters | {"gauge_length.relative": Parameter(0.15, 0.002, "1", True)}
    run = made_run(replace(survey, problem=problem), parameters=fitted)
    assert gauge_words(run) == "11.50 m as fitted (10 m by the files)"


# ---- numbers --------------------------------------------------------------------------------------------------------


def spoiled(survey, rows, columns, sigmas):
    measured = survey.result.model + 0.0
    measured[rows, columns] += sigmas * survey.result.noise[0]
    return replace(survey.result, measured=measured)


def test_misfit_is_where_the_residual_is(survey):
    misfit = misfit_of(spoiled(survey, slice(0, 60), slice(10, 20), 3.0), survey.passes)
    np.testing.assert_allclose(misfit.by_channel[10:20], 9.0 * 60 / 100)
    assert misfit.by_channel[:10].max() == misfit.by_channel[20:].max() == 0.0
    np.testing.assert_allclose(misfit.by_pass, [9.0 * 10 / 54, 0.0])
    np.testing.assert_array_equal(misfit.edges, np.arange(53, 109))


def test_misfit_leaves_out_what_was_not_measured_or_has_no_weight(survey):
    result = spoiled(survey, slice(0, 60), slice(10, 20), 3.0)
    result.measured[0, 10] = np.nan
    result.measured[:, 20] = np.nan
    weight = result.weight.copy()
    weight[1:60, 10] = 0.0
    result = replace(result, weight=weight)
    misfit = misfit_of(result, survey.passes)
    assert misfit.by_channel[10] == 0.0
    assert np.isnan(misfit.by_channel[20])
    assert misfit.discounted == pytest.approx(59 / (100 * 53 - 1))


def test_channels_are_binned_without_loss(survey, monkeypatch):
    monkeypatch.setattr(misfit_module.bin_edges, "__defaults__", (6,))
    misfit = misfit_of(spoiled(survey, slice(0, 60), slice(10, 20), 3.0), survey.passes)
    # Bins of ten channels. Channel 70 is dead: the ten spoiled columns are channels 63 to 73 without it.
    np.testing.assert_array_equal(misfit.edges, [53, 63, 73, 83, 93, 103, 113])
    np.testing.assert_allclose(misfit.by_pass_and_bin[0], [0, 9.0, 0.9, 0, 0, 0], atol=1e-12)
    np.testing.assert_allclose(misfit.by_pass_and_bin[1], 0.0, atol=1e-12)


def test_coarse_keeps_noise_at_one_sigma():
    noise = np.random.default_rng(0).normal(size=(900, 700))
    noise[:300, :5] = np.nan
    small = coarse(noise, 300)
    assert max(small.shape) <= 300
    assert np.nanstd(small) == pytest.approx(1.0, abs=0.02)
    assert np.isnan(small[0, 0])
    np.testing.assert_array_equal(coarse(noise[:40, :40], 300), noise[:40, :40])


def test_color_scale_is_symmetric_and_reaches_the_signal():
    scale = color_scale(np.array([-50.0, 0.1, np.nan, 20.0]))
    assert scale.vmin == -scale.vmax
    assert 40 < scale.vmax <= 50
    assert color_scale(np.array([np.nan])).vmax == 10.0


# ---- figures --------------------------------------------------------------------------------------------------------


def test_picture_leaves_a_gap_at_dead_channels(survey):
    image = pictures_of(survey.result, survey.passes[0], 300).measured
    assert image.shape == (60, 55)
    assert np.isnan(image[:, 70 - 53]).all()
    assert np.isfinite(np.delete(image, 70 - 53, axis=1)).all()


@pytest.mark.parametrize("width", [1060, 350])
def test_plan_is_true_to_scale_and_holds_everything(survey, width):
    figure = route_figure(made_run(survey), width)
    plan, lateral, depth = figure.axes
    assert [axes.get_label() for axes in figure.axes] == ["plan", "lateral", "depth"]
    box = plan.get_window_extent()
    x, y = plan.get_xlim(), plan.get_ylim()
    assert box.width / (x[1] - x[0]) == pytest.approx(box.height / (y[0] - y[1]))
    assert y[1] < -3.5 < 4.5 < y[0], "y to the right of +x points down the page"
    assert depth.get_ylim()[0] > 1.1 > depth.get_ylim()[1]
    assert lateral.get_xlim() == depth.get_xlim() == x


def test_corners_are_marked_in_each_panel_and_told_in_the_legend(survey):
    result, middle = survey.result, len(survey.result.channel) // 2
    at = float(result.distance[middle]), int(result.channel[middle]), *result.route[middle].tolist()
    turn, rise = Corner("corner", 90.0, 1.0, 1.6, *at, 0.2), Corner("step", -0.9, 0.02, 2.5, *at, 0.1)
    run = made_run(survey, corners=(turn, rise))
    for panel in route_figure(run, 960).axes:
        marks = {line.get_marker(): line for line in panel.lines if line.get_marker() in "Dv^"}
        assert set(marks) == {"D", "^"}
        value = at[4] if panel.get_label() == "depth" else at[3]
        np.testing.assert_allclose(np.ravel(marks["D"].get_data()), (at[2], value), atol=1e-6)
    assert "◇</b> the fiber turns" in legend(run) and "△ less deep" in legend(run)
    assert "the fiber turns" not in legend(made_run(survey, corners=(rise,)))


def test_same_scale_widens_what_would_be_too_high():
    x, y, height = same_scale((0.0, 10.0), (0.0, 100.0), 1000.0, 50.0, 500.0)
    assert (y, height) == ((0.0, 100.0), 500.0)
    assert x == (-95.0, 105.0)


def test_svg_follows_the_theme_and_repeats_under_the_same_salt(survey):
    run = made_run(survey)
    first, second = (svg(failure_figure(run, misfit_of(run.result, run.passes), 350)) for _ in range(2))
    assert first == second
    assert first.startswith("<svg viewBox=")
    assert "var(--ink)" in first
    assert "DejaVu" not in first


def test_wave_figure_shows_the_vehicle_over_its_channels(survey):
    run = made_run(survey)
    figure = wave_figure(run, run.passes[0], 340)
    (axes,) = figure.axes
    channel, seconds = axes.lines[0].get_data()
    crossed = np.isfinite(channel)
    # 6 m/s from x = -5 m at 0 s; channel 50 is at x = 0.
    np.testing.assert_allclose(channel[crossed], 45 + 6 * seconds[crossed], atol=0.8)
    assert axes.get_xlim() == (52.5, 107.5)


def test_a_picture_lies_pixel_by_pixel_where_its_axes_are(survey):
    """Row 0 on top, channels from left to right, as the axes over it have them."""
    run = made_run(survey)
    model = pictures_of(run.result, run.passes[0], 300).model
    scale = color_scale(model)
    (drawn,) = wave_pictures(run, run.passes[0], [model], scale, 340)
    box = dict(re.findall(r'(x|y|width|height)="([^"]*)"', re.search(r"<image [^>]*>", drawn).group()))
    view = [float(number) for number in re.search(r'viewBox="([^"]*)"', drawn).group(1).split()]
    inside = wave_figure(run, run.passes[0], 340).axes[0].get_position()
    left, top = inside.x0 * view[2], (1 - inside.y1) * view[3]
    np.testing.assert_allclose([float(box["x"]), float(box["y"])], [left, top], atol=0.01)
    size = [inside.width * view[2], inside.height * view[3]]
    np.testing.assert_allclose([float(box["width"]), float(box["height"])], size, atol=0.3)
    png = base64.b64decode(re.search(r"base64,([^\"]*)", drawn).group(1))
    colors = np.asarray(Image.open(BytesIO(png)).convert("RGB"))
    np.testing.assert_allclose(colors, 255 * color_map()(scale(np.ma.masked_invalid(model)))[..., :3], atol=1)


def test_parameters_named_by_pass_are_one_row_each(survey):
    table = parameter_tables(survey.result.parameters)
    assert table.count("<tr>") == 4
    assert "<td>b/2</td>" in table
    assert "amplitude, m²" in table
    assert "2.65 <small>fixed</small>" in table
    assert "0.251 <small>± 0.012</small>" in table
