from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from made_tables import tracks

from vision.jitter import LIMIT
from vision.quality.measures import apart, fragments, measure, shared_edges
from vision.quality.route_effect import route_effect
from vision.quality.setting import Setting
from vision.quality.verdict import RULES, grade, judge, typical_effect


def measured(name="a", truth=None, **options):
    setting = Setting(name, Path(name), tracks(**options), "m")
    return measure(setting, shared_edges([setting]), 10.0, truth)


def test_counts_and_fragments():
    found = measured(missed=0.02, flicker=0.1, seed=3)
    table = found.setting.tracks
    assert found.tracks == 7 and found.by_class == {"car": 7} and found.by_detected_class["van"] == 7
    assert found.frames_per_track == pytest.approx((6 * 200 + 400) / 7)
    assert found.missed == pytest.approx(table["missed"].mean()) and 0.01 < found.missed < 0.03
    runs = [
        len(run)
        for _, track in table.groupby("track_id")
        for run in "".join("-" if gone else "x" for gone in track["interpolated"]).split("-")
        if run
    ]
    assert found.fragment == max(runs) and found.breaks == len(runs) - 7
    assert found.switching == 7 and found.switches > 100


def test_fragments_of_every_other_frame():
    longest, breaks = fragments(pd.DataFrame({"track_id": [1] * 5 + [2] * 3, "frame": [0, 2, 4, 8, 10, 2, 4, 6]}))
    assert longest.tolist() == [3, 3] and breaks == 1


def test_jitter_floor_is_that_of_the_parked_and_only_of_it():
    found = measured(noise=0.1)
    assert found.parked == 1 and found.floor == pytest.approx(0.1 * np.sqrt(2 * 14 / 15), rel=0.1)
    assert found.after["fixes"].sum() == 6 * (200 - 14), "the parked one is not in the bins"


def test_effect_of_white_noise_is_that_of_the_formula():
    found = measured(noise=0.1, vehicles=12)
    middle = found.effect.iloc[3:7]
    # 10 m/s, so a vehicle strains a channel for 17.5 m / 10 m/s = 1.75 s: 43.75 independent fixes at 25 per second.
    assert middle["independent"].iloc[0] == pytest.approx(43.75, rel=0.2)
    assert (middle["passes"] == 12).all()
    np.testing.assert_allclose(middle["noise_y"], 0.1, rtol=0.15)
    np.testing.assert_allclose(middle["route_y"], middle["noise_y"] / np.sqrt(12 * middle["independent"]))
    np.testing.assert_allclose(middle["stated_x"], 0.15 / np.sqrt(12))


@pytest.mark.parametrize("rho", [0.0, 0.4, 0.7])
def test_correlated_errors_average_less(rho):
    rng = np.random.default_rng(0)
    error = np.zeros((4000, 2))
    for k in range(1, 4000):
        error[k] = rho * error[k - 1] + rng.normal(0, np.sqrt(1 - rho**2), 2)
    frame = np.arange(4000)
    table = pd.DataFrame(0.1 * error, columns=["x", "y"]).assign(
        track_id="1", frame=frame, time=frame / 25, interpolated=False
    )
    table["x"] += 0.4 * frame
    effect = route_effect(table, np.array([0.0, 1600.0]))
    assert effect["independent"][0] == pytest.approx(43.75 * (1 - rho) / (1 + rho), rel=0.15)
    assert effect["noise_y"][0] == pytest.approx(0.1, rel=0.05), "also what the rolling mean follows"
    assert np.isnan(effect["stated_y"][0]), "the table states no sigma"


def test_bins_without_passes_have_no_effect():
    effect = route_effect(tracks(), np.array([-50.0, -10.0, 80.0]))
    assert effect["passes"].tolist() == [0, 7] and effect.iloc[0][["route_y", "stated_y"]].isna().all()


@pytest.mark.parametrize(("noise", "expected"), [(0.05, "good"), (0.22, "fair"), (0.5, "poor")])
def test_the_35_cm_rule(noise, expected):
    assert grade(measured(noise=noise)) == expected


def test_a_bad_stretch_is_named():
    table = tracks(vehicles=10)
    rng = np.random.default_rng(5)
    far = table["x"] > 65
    table.loc[far, "y"] += rng.normal(0, 1.0, far.sum())
    setting = Setting("a", Path("a"), table, "m")
    verdict = judge([measure(setting, np.linspace(0, 80, 11), 10.0)])
    assert (
        verdict.grade == "weak" and "at x = 64 to 80 m" in verdict.words and verdict.because.endswith("only one given")
    )


def test_too_few_vehicles_are_not_enough():
    table = tracks(vehicles=1).assign(sigma_y=0.3)
    setting = Setting("a", Path("a"), table, "m")
    verdict = judge([measure(setting, shared_edges([setting]), 10.0)])
    assert verdict.grade == "weak" and "film longer" in verdict.words and "± 0.59 m" in verdict.words


def test_jitter_is_of_what_was_measured_not_of_what_was_smoothed():
    rough, smooth = tracks(noise=0.3), tracks(noise=0.01)
    table = smooth.assign(x_measured=rough["x"], y_measured=rough["y"])
    setting, bare = Setting("a", Path("a"), table, "m"), Setting("b", Path("b"), rough, "m")
    edges = shared_edges([bare])
    found, expected = (measure(s, edges, 10.0) for s in (setting, bare))
    pd.testing.assert_frame_equal(found.after, expected.after)
    assert found.floor == expected.floor


def test_the_least_harm_is_chosen():
    quiet, rough = measured("quiet", noise=0.05), measured("rough", noise=0.15, seed=1)
    few = measured("few", noise=0.04, vehicles=2)
    assert quiet.jitter < LIMIT and typical_effect(few) > 1.5 * typical_effect(quiet)
    assert judge([rough, few, quiet]).use == "quiet"


def test_the_truth_decides_where_it_is_known():
    truth = tracks(noise=0.0)
    good = measured("good", truth, noise=0.3)
    broken = tracks(noise=0.05)
    broken["track_id"] = broken["track_id"] + np.where(broken["frame"] % 200 < 100, "a", "b")
    setting = Setting("broken", Path("b"), broken, "m")
    bad = measure(setting, shared_edges([setting]), 10.0, truth)
    assert good.scores.idf1 > bad.scores.idf1 and judge([bad, good]).use == "good"


def test_the_rule_is_reported_and_equals_go_to_the_first():
    truth = tracks(noise=0.0)
    first, second = measured("first", truth, noise=0.05), measured("second", truth, noise=0.05)
    verdict = judge([first, second])
    assert verdict.use == "first" and verdict.rule == RULES["truth"] and "highest HOTA" in verdict.rule
    switched = replace(first, scores=replace(first.scores, mota=0.5))
    assert judge([switched, second]).use == "second", "of equal HOTA the higher MOTA"
    assert judge([replace(one, scores=None) for one in (second, first)]).rule == RULES["meters"]


def test_the_sentence_says_what_all_fixes_of_a_vehicle_share():
    table = tracks(noise=0.02, vehicles=20).assign(sigma_x=0.8)  # rears of buses: jitter says nothing of their length
    setting = Setting("a", Path("a"), table, "m")
    verdict = judge([measure(setting, shared_edges([setting]), 10.0)])
    assert verdict.grade == "weak" and "up to ± 1.57 m where all vehicles err alike" in verdict.words
    assert "whichever way they drive, which these tracks alone cannot show" in verdict.words  # no check of directions
    bare = replace(setting, tracks=table.drop(columns=["sigma_x", "sigma_y"]))
    assert "by jitter alone" in judge([measure(bare, shared_edges([bare]), 10.0)]).words


def test_two_detectors_are_compared_in_both_directions():
    up = tracks(vehicles=3)
    down = up.assign(track_id=up["track_id"] + "d", x=80 - up["x"], box_left=600 - up["box_left"])
    both = pd.concat([up, down.assign(box_right=down["box_left"] + 40)], ignore_index=True)
    nearer = both.assign(x=both["x"] - 0.5)  # to a camera at the beginning of the road
    ahead = apart(Setting("a", Path("a"), both, "m"), Setting("b", Path("b"), nearer, "m"))
    assert ahead == {"up the road": pytest.approx(0.5), "down the road": pytest.approx(-0.5)}
