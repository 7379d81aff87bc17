"""Residuals of known cause: found for what they are, where they are, and as large; noise is nothing."""

import json
import re
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from made_runs import CHANNELS, RATE, Maker, gain, ghost, late, made_passes, moved, wider
from scipy.stats import chi2 as chi2_law
from typer.testing import CliRunner

from roadfiber.criticism_commands import app
from solver.criticism import comparison
from solver.criticism.comparison import split as split_module
from solver.criticism.comparison.cells import cells_of, noise_of, on_fiber
from solver.criticism.comparison.compare import compare
from solver.criticism.comparison.comparison_files import facts_of, write_comparison
from solver.criticism.comparison.comparison_page import render
from solver.criticism.comparison.comparison_words import clock, region_words, size_words
from solver.criticism.comparison.local_misfit import gate_of, unexplained
from solver.criticism.comparison.power import periodogram, power_of
from solver.criticism.comparison.region_search import regions_of
from solver.criticism.comparison.split import SOURCES, fair_shares, normal_equations, split_of
from solver.criticism.comparison.stack import stack_of
from solver.criticism.comparison.windows import ladder, power_statistic, threshold, widest
from solver.run.run import run_of


@pytest.fixture(scope="module")
def noise_run():
    return Maker().run()


@pytest.fixture(scope="module")
def gain_run():
    return Maker(change=gain(slice(18, 32), 0.7)).run()


def found(run):
    return regions_of(run, cells_of(run))


# ---- regions ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(6))
def test_noise_makes_no_region(seed):
    assert found(Maker(seed=seed, memory=0.2 * (seed % 4), common=0.06 * (seed % 3)).run()) == []


@pytest.mark.parametrize("passes", [1, 4])
def test_a_gain_of_some_channels_is_found_as_such_with_its_size(passes):
    run = Maker(seed=3, passes=passes, change=gain(slice(18, 32), 0.7)).run()
    (region,) = found(run)
    assert region.kind == "gain"
    assert region.every_pass
    assert region.channels == (118, 131)
    assert region.x == (18.0, 31.0)
    assert abs(region.amount + 0.3) < 3 * region.sigma
    assert region.sigma < 0.005
    assert region_words(region, run).endswith(": gain 30 % low")


def test_the_words_of_a_gain(gain_run):
    (region,) = found(gain_run)
    assert region_words(region, gain_run) == "channels 118-131, all passes: gain 30 % low"
    assert re.fullmatch(r"-30\.\d+ ± 0\.\d+ %", size_words(region))


@pytest.mark.parametrize("seconds", [0.1, -0.02])
def test_a_late_pass_is_found_as_such_with_its_delay(seconds):
    run = Maker(seed=4, change=late(2, seconds)).run()
    (region,) = found(run)
    assert (region.kind, region.passes, region.every_pass) == ("late", ("3",), False)
    assert abs(region.amount - seconds) < 3 * region.sigma
    assert region.meters == pytest.approx(12.0 * region.amount)  # at 12 m/s
    first, last = (run.time[run.passes[2].rows[i]] for i in (0, -1))
    assert first <= region.time[0] < region.time[1] <= last
    text = region_words(region, run)
    assert "pass 3, 06:00:" in text
    assert ("late" if seconds > 0 else "early") in text


def test_channels_that_lie_elsewhere_are_found_as_such():
    (region,) = found(Maker(seed=5, change=moved(slice(40, 50), 0.8)).run())
    assert (region.kind, region.channels, region.every_pass) == ("place", (140, 149), True)
    assert abs(region.amount - 0.8) < 3 * region.sigma


def test_an_offset_is_found_as_such():
    def change(model, passes):
        model[:, 60:75] += 1.5e-9
        return model

    (region,) = found(Maker(seed=6, memory=0.0, common=0.0, change=change).run())
    assert region.kind == "offset"
    assert abs(region.channels[0] - 160) <= 2
    assert abs(region.channels[1] - 174) <= 2
    assert region.amount == pytest.approx(0.75, abs=0.1)


def test_a_wrong_shape_is_found_around_all_vehicles():
    run = Maker(seed=7, change=wider(7.5)).run()
    region = found(run)[0]
    assert (region.kind, region.every_pass) == ("shape", True)
    assert region.ahead[0] < -5 < 5 < region.ahead[1]
    assert "of the vehicle, residual" in region_words(region, run)


def test_a_vehicle_in_no_trajectory_is_seen_with_its_speed():
    run = Maker(seed=8, change=ghost(110, 25.0)).run()
    ghosts = [region for region in found(run) if region.kind == "unseen"]
    assert len(ghosts) == 1
    assert ghosts[0].passes == ()
    assert ghosts[0].speed == pytest.approx(25.0, rel=0.1)
    assert ghosts[0].time[0] >= 10.0
    assert "no vehicle near" in region_words(ghosts[0], run)
    assert "something that the trajectories lack, moving up the channels" in region_words(ghosts[0], run)


def test_two_causes_are_told_apart():
    def change(model, passes):
        return gain(slice(60, 70), 1.2)(late(1, 0.05)(model, passes), passes)

    kinds = {region.kind: region for region in found(Maker(seed=9, change=change).run())}
    assert set(kinds) == {"gain", "late"}
    assert kinds["late"].passes == ("2",)
    assert kinds["gain"].channels == (160, 169)


def test_at_most_ten_regions_largest_first():
    rng = np.random.default_rng(1)

    def change(model, passes):
        return model * np.repeat(1 + rng.normal(0, 0.2, CHANNELS // 3), 3)

    regions = found(Maker(seed=10, change=change).run())
    assert len(regions) == 10
    assert all(a.chi2 >= b.chi2 for a, b in pairwise(regions))


def test_gaps_and_faded_channels_are_not_regions():
    assert found(Maker(seed=11, faded=(10, 11, 50), gap=slice(100, 140)).run()) == []


def test_a_run_without_quiet_samples_takes_the_fits_noise_floor():
    residual = np.ones((10, 3))
    level, spread = noise_of(residual, np.ones_like(residual, bool), np.zeros_like(residual, bool), 1.3)
    assert level.tolist() == [1.3, 1.3, 1.3]
    assert spread == 1.0


def test_channels_that_all_passes_contradict_are_not_constrained_and_one_pass_is_about_itself(gain_run, noise_run):
    lost = unexplained(gain_run, found(gain_run))
    assert gain_run.result.channel[lost][[0, -1]].tolist() == [113, 136], "a gauge of ten channels, half to either side"
    gate = gate_of(gain_run, lost)
    assert gate.failed and gate.where == "at channels 113 to 136"
    assert not unexplained(noise_run, found(noise_run)).any()
    assert gate_of(noise_run, np.zeros(3, bool)).verdict == "passed"
    own = Maker(seed=3, change=late(2, 0.3)).run()
    assert found(own) and not unexplained(own, found(own)).any()


def test_what_fails_along_most_of_the_fiber_is_not_of_a_place():
    run = Maker(seed=3, change=gain(slice(2, CHANNELS - 2), 0.7)).run()
    assert found(run) and not unexplained(run, found(run)).any()


# ---- scans -----------------------------------------------------------------------------------------------------------


def test_power_statistic_is_that_of_chi2():
    number = np.array([20.0, 100.0, 1000.0])
    for probability, sigmas in ((1e-2, 2.326), (1e-5, 4.265)):
        z = power_statistic(chi2_law.isf(probability, number), number)
        np.testing.assert_allclose(z, sigmas, atol=0.06)


def test_windows_of_all_lengths_are_tried_and_bonferroni_holds():
    for size in (1, 2, 45, 90, 91):
        assert ladder(size)[0] == 1
        assert ladder(size)[-1] == size
    rng = np.random.default_rng(2)
    limit, exceeded = threshold(2 * sum(60 - n + 1 for n in ladder(60)), 0.05), 0
    for _ in range(200):
        score = np.concatenate([[[0.0]], rng.normal(size=(1, 60)).cumsum(1)], 1)
        exceeded += widest((score, np.arange(61.0)[None]), power=False).z > limit
    assert exceeded <= 10


# ---- split, stack, power ---------------------------------------------------------------------------------------------


def test_of_noise_nothing_is_explained(noise_run):
    split = split_of(noise_run, cells_of(noise_run))
    assert split.share(*SOURCES) < 0.002
    assert split.noise == pytest.approx(split.chi2, rel=0.02)


@pytest.mark.parametrize(
    ("change", "source"),
    [
        (gain(slice(18, 32), 0.7), "channel gain"),
        (moved(slice(40, 50), 0.8), "channel shift"),
        (late(2, 0.05), "pass shift"),
        (wider(7.5), "kernel"),
    ],
)
def test_the_misfit_is_given_to_its_source(change, source):
    run = Maker(seed=12, change=change).run()
    split = split_of(run, cells_of(run))
    above = split.chi2 - split.noise
    assert split.explained[source] > 0.7 * above
    assert sum(split.explained.values()) + split.noise + split.unexplained == pytest.approx(split.chi2)


def test_the_split_of_a_long_run_in_pieces_is_that_of_the_whole(gain_run, monkeypatch):
    cells = cells_of(gain_run)
    whole = normal_equations(gain_run, cells)
    monkeypatch.setattr(split_module, "CELLS", 170 * CHANNELS)
    for part, other in zip(normal_equations(gain_run, cells)[:2], whole[:2], strict=True):
        np.testing.assert_allclose(part, other, atol=1e-9 * np.abs(other).max())


def test_fair_shares_add_up():
    worth = {frozenset(s): float(len(s) ** 2) for s in ((), (0,), (1,), (2,), (0, 1), (0, 2), (1, 2), (0, 1, 2))}
    assert fair_shares(worth, 3).tolist() == [3.0, 3.0, 3.0]


def test_stack_has_the_models_shape_and_the_residuals_symmetry(gain_run):
    stack = stack_of(gain_run, cells_of(gain_run))
    assert np.nanmax(np.abs(stack.model[0])) == pytest.approx(1.0)
    assert stack.ahead[40] == 0.0
    # Toward the vehicle's front the response is as its shape says, whichever way it goes.
    assert stack.ahead[np.nanargmax(stack.model[0])] == pytest.approx(-7.0, abs=1.0)
    np.testing.assert_allclose(stack.symmetric + stack.antisymmetric, stack.residual, atol=1e-12)
    group = 1 + int(np.flatnonzero((stack.channels[1:, 0] <= 125) & (stack.channels[1:, 1] >= 125))[0])
    assert np.abs(stack.antisymmetric[group]).max() > 0.1
    assert np.nanstd(stack.symmetric[group]) < 0.02


def test_a_delay_is_symmetric():
    run = Maker(seed=13, passes=1, change=late(0, 0.05)).run()
    stack = stack_of(run, cells_of(run))
    assert np.nanstd(stack.symmetric[0]) > 3 * np.nanstd(stack.antisymmetric[0])


def test_power_by_channel_and_pass(gain_run):
    power = power_of(gain_run, cells_of(gain_run))
    inside = np.arange(18, 32)
    assert power.channel.chi2[inside].min() > 4
    assert np.delete(power.channel.chi2, inside).mean() == pytest.approx(1.0, abs=0.06)
    assert len(power.one_pass.labels) == len(gain_run.passes)
    assert power.vehicle_class.labels == ["car", "truck", "van"]
    assert len(power.lane.labels) == 2
    assert power.gap.chi2[-1] == pytest.approx(1.0, abs=0.03)
    assert power.gap.chi2[1] > 2


def test_spectrum_of_noise_is_one(noise_run):
    spectrum = power_of(noise_run, cells_of(noise_run)).spectrum
    assert spectrum.power.mean() == pytest.approx(1.0, abs=0.04)
    assert spectrum.by_frequency[3:].min() > 0.8
    assert spectrum.by_frequency.max() < 1.25
    assert spectrum.frequency[-1] == pytest.approx(RATE / 2)


def test_spectrum_shows_what_moves_with_the_vehicles_at_positive_wavenumbers():
    def change(model, passes):
        x = np.arange(CHANNELS)
        for one in passes:
            t = np.arange(len(one.rows)) / RATE
            model[one.rows] += 4e-9 * np.cos(2 * np.pi * (0.1 * (x - one.velocity[0, 0] * t[:, None])))
        return model

    spectrum = power_of(run := Maker(seed=14, change=change).run(), cells_of(run)).spectrum
    row, column = np.unravel_index(spectrum.power.argmax(), spectrum.power.shape)
    assert spectrum.wavenumber[column] == pytest.approx(0.1, abs=0.02)
    assert 0.8 <= spectrum.frequency[row] <= 1.5


def test_periodogram_of_a_short_pass():
    power, weight = periodogram(np.ones((5, 4)), np.ones((5, 4), bool), 16, 8)
    assert power.shape == (16, 8)
    assert weight > 0


def test_place_along_a_fiber_that_bends():
    angle = np.linspace(0, np.pi / 2, 200)
    route = 50 * np.stack([np.sin(angle), 1 - np.cos(angle)], 1)
    middle = np.array([0.0, 50.0])
    seen = on_fiber(middle + 0.9 * (route[[20, 150]] - middle), route, 50 * angle)
    np.testing.assert_allclose(seen.along, 50 * angle[[20, 150]], atol=0.3)


# ---- page and files --------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def written(gain_run, tmp_path_factory):
    folder = tmp_path_factory.mktemp("compared") / "new"
    write_comparison(folder, compare(gain_run), gain_run)
    return folder


def no_constant(text):
    raise AssertionError(f"{text} is not JSON")


def test_files_are_page_numbers_and_pictures(written):
    pictures = {f"compare_{name}.png" for name in ("maps", "split", "stack", "channels", "power", "spectrum")}
    assert {path.name for path in written.iterdir()} == pictures | {"compare.html", "compare.json"}
    assert all((written / name).read_bytes().startswith(b"\x89PNG") for name in pictures)


def test_numbers_are_strict_json_with_units(written, gain_run):
    facts = json.loads((written / "compare.json").read_text(encoding="utf-8"), parse_constant=no_constant)
    (region,) = facts["regions"]
    assert region["words"] == "channels 118-131, all passes: gain 30 % low"
    assert (region["unit"], region["channels"], region["time"]) == ("1", [118, 131], None)
    assert facts["split"]["shares"]["channels"] > 0.55
    assert facts["units"]["regions"]["x"] == "m"
    assert len(facts["stack"]["residual"][0]) == len(facts["stack"]["ahead"])
    assert len(facts["power"]["channel"]) == len(gain_run.result.fitted_channel)


def test_page_needs_no_other_file_and_holds_every_pass(written, gain_run):
    page = (written / "compare.html").read_text(encoding="utf-8")
    assert not re.search(r"https?://|//cdn|@import|url\((?!['\"]?#)|<script src|\$\{", page)
    assert "Elm &lt;Street&gt;" in page
    assert "mathdefault" not in page  # numbers at axes are text
    assert "Channels 118-131, all passes: gain 30 % low" in page
    data = json.loads(re.search(r'<script type="application/json" id="maps">(.*?)</script>', page).group(1))
    assert len(data["passes"]) == len(gain_run.passes)
    assert len(data["colors"]) == 256
    box = data["passes"][0]["boxes"][0]
    assert box["channels"] == [118, 131]
    assert 0 <= box["time"][0] < box["time"][1] <= data["passes"][0]["seconds"]
    assert len(page) < 5e6


def test_page_of_noise_says_so(noise_run):
    page = render(compare(noise_run), noise_run)
    assert "Model and measurement agree to within the noise." in page
    assert "Nothing stands out" in page


def test_a_comparison_says_of_a_run_what_its_checks_say(noise_run):
    """Noise alone, and anchors off the route: no place stands out, and the route is not to be relied on."""
    sentence = "Do not rely on this route as it stands: anchor west 0.65 m off the route (9.0 sigmas)."
    facts = noise_run.facts | {"trust": {"sentence": sentence, "grade": "weak", "gates": []}}
    run = replace(noise_run, facts=facts)
    finding = compare(run)
    page = render(finding, run)
    assert sentence in page and 'class="grade weak"' in page
    assert "agree to within the noise" not in page and "does not pass every check" in page
    assert facts_of(finding, run)["trust"] == sentence


def test_page_of_a_run_with_gaps_faded_channels_and_one_pass():
    run = Maker(seed=15, passes=1, faded=(0, 10, 11), gap=slice(60, 75)).run()
    page = render(compare(run), run)
    assert not re.search(r"\bnan\b", page)


def test_command_writes_beside_the_run_and_prints_words_or_json(survey, tmp_path, monkeypatch):
    monkeypatch.setattr("solver.run.report.report_page.render", lambda run: "")
    monkeypatch.setattr(comparison.comparison_files, "figures_of", lambda *arguments: {})
    monkeypatch.setattr(comparison.comparison_files, "render", lambda *arguments: "")
    run_of(survey.result, **survey.arguments).save(tmp_path / "run")
    result = CliRunner().invoke(app, ["compare", str(tmp_path / "run"), "--json"])
    assert result.exit_code == 0, result.output
    assert json.loads(result.output)["name"] == "Elm <Street> & 2nd"
    assert (tmp_path / "run" / "compare.html").exists()
    result = CliRunner().invoke(app, ["compare", str(tmp_path / "run"), "--out", str(tmp_path / "out")])
    trust = json.loads((tmp_path / "run" / "fit.json").read_text(encoding="utf-8"))["trust"]["sentence"]
    assert trust.replace("RUN", str(tmp_path / "run")) in result.output.splitlines()
    assert result.output.splitlines()[-1] == f"page: {tmp_path / 'out' / 'compare.html'}"


def test_clock_counts_from_the_start(noise_run):
    assert clock(noise_run, 61.2) == "06:01:01"
    assert len(made_passes(3)) == 3
