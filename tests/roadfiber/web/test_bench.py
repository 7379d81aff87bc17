"""What happens on the bench, with workers that answer as they are told."""

import json
from dataclasses import replace
from types import SimpleNamespace

import pytest

import roadfiber as rf
from roadfiber.web import tasks
from roadfiber.web.bench import Bench
from roadfiber.web.own_effect import NAME, TEMPLATE
from roadfiber.web.run_folders import reserved
from roadfiber.web.words import work_words
from roadfiber.web.workbench_page import Page
from solver.run.read_seen import read_seen
from vision.contract import InputError

ROW = {"effect": "gauge_length", "told": {"title": "Gauge length"}, "evidence": 9.0, "delta_chi2": 30.0}


def test_a_run_without_a_diagnosis_is_compared_and_scored(bench):
    titles, compare, score = bench.looker.asked
    assert (compare.task, score.task, compare.given) == ("compare", "score", (bench.folder, ()))
    assert bench.title("gauge_length") == "gauge length", "until the worker has loaded the catalogue"
    titles.then(tasks.titles(lambda step: None, *titles.given))
    assert bench.title("gauge_length") == "Gauge length"
    score.told(("done", 3, 40))
    assert bench.source == "scoring, 3 of 40 ..."
    score.then([ROW])
    assert bench.candidates == [ROW] and bench.source.startswith("scores alone")


def test_a_diagnosis_is_read_and_a_damaged_one_is_none(bench):
    facts = {"candidates": [ROW, {"effect": 5}]}
    (bench.folder / "diagnosis.json").write_text(json.dumps(facts))
    bench.look()
    assert bench.candidates == [ROW] and bench.source == "its diagnosis"
    (bench.folder / "diagnosis.json").write_text("{")
    bench.look()
    assert bench.candidates == []


def test_what_a_diagnosis_changes_of_a_run_is_on_the_page(bench):
    page = Page(bench, "no film")
    bench.diagnose()
    written = bench.folder / "fit.json"
    facts = json.loads(written.read_text())
    facts["trust"]["gates"][0] |= {"name": "diagnosis", "verdict": "failed", "words": "the model lacks slip"}
    written.write_text(json.dumps(facts | {"trust": facts["trust"] | {"sentence": "the model lacks slip"}}))
    bench.adder.asked[0].then({"candidates": [ROW], "headline": "Slip."})
    page.tick()
    assert "the model lacks slip" in page.controls.heading.object and page.listed == [ROW]
    assert "<caption>trajectories.csv</caption>" in page.controls.heading.object
    assert bench.run.facts["trust"]["grade"] == "weak"
    assert {one.line.glyph.line_dash[0] > 0 for one in (page.map, page.depth)} == {True}, "not to be relied on: dashed"
    compared = SimpleNamespace(regions=[])
    bench.looker.asked[1].then(compared)
    assert bench.comparison is compared, "of the run as it was, whose model and record are the same"


def test_one_fit_at_a_time_and_a_failure_leaves_all_as_it_was(bench):
    bench.add("gauge_length", "Gauge length")
    (asked,) = bench.adder.asked
    assert asked.task == "add" and asked.given[3].name == "run-2" and bench.busy
    bench.add("camber", "Camber")
    assert len(bench.adder.asked) == 1 and "is under way" in bench.messages[-1]
    assert not (bench.first.parent / "run-3").exists(), "what was not begun keeps no folder"
    asked.failed("stopped")
    assert not bench.busy and bench.at == 0
    assert bench.messages[-1] == "adding gauge length: canceled; nothing was written, and all rungs are as they were"
    assert work_words(bench.job, 1.0) == "<small>Canceled: adding gauge length</small>", "not: done"
    assert not (bench.first.parent / "run-2").exists(), "a worker that is killed removes nothing"


def test_rungs_are_gone_up_and_down_and_their_folders_stay(bench):
    first = bench.run
    bench.add("gauge_length", "Gauge length")
    folder, plugins, *given = bench.adder.asked[0].given
    tasks.add(lambda step: None, folder, plugins, *given)
    bench.adder.asked[0].then(given[1])
    assert bench.at == 1 and bench.run.effects[-1] == "gauge_length" and bench.before is first
    rungs = json.loads((bench.folder / "ladder.json").read_text())["rungs"]
    assert f"misfit {rungs[0]['chi2_per_dof']:.3f} -> {rungs[1]['chi2_per_dof']:.3f}" in bench.messages[-1]
    assert rungs[1]["chi2_per_dof"] < 1.05 < rungs[0]["chi2_per_dof"]
    bench.undo()
    assert bench.run is first and (bench.first.parent / "run-2" / "fit.json").is_file()
    bench.undo()
    assert bench.run is first, "there is nothing below"
    bench.redo()
    assert bench.at == 1


def test_the_fiber_turns_where_the_map_was_clicked(bench, monkeypatch):
    page = Page(bench, "no film")
    channel = int(bench.run.result.fitted_channel[7])
    x, y, _ = bench.run.result.route[list(bench.run.result.channel).index(channel)]
    page.pointed(x + 0.2, y + 3.0)
    assert page.controls.channel.value == channel
    page.controls.button["turn"].clicks += 1
    (asked,) = bench.adder.asked
    folder, plugins, *given = asked.given
    assert asked.task == "turn" and given == [channel, bench.first.parent / "run-2"] and bench.busy
    with pytest.raises(InputError, match=r"channel 7: channels \d+ to \d+ are fitted"):
        tasks.turn(lambda step: None, folder, plugins, 7, given[1])
    monkeypatch.setattr(rf, "turn", lambda run, channel: replace(run, facts=run.facts | {"name": f"{channel}"}))
    assert (
        read_seen(tasks.turn(lambda step: None, folder, plugins, channel, reserved(bench.first))).name == f"{channel}"
    )


def test_a_rung_is_scored_once_and_again_with_other_effects(bench):
    def looked():
        before = len(bench.looker.asked)
        bench.look()
        return [one.task for one in bench.looker.asked[before:]]

    assert looked() == ["compare", "score"], "not before there is an answer"
    bench.looker.asked[-1].then([ROW])
    bench.candidates = []
    assert looked() == ["compare"] and bench.candidates == [ROW] and bench.source.startswith("scores alone")
    bench.own(NAME, TEMPLATE)
    bench.adder.asked[0].then([ROW | {"effect": "downforce"}])
    assert looked() == ["compare", "score"]
    bench.looker.asked[-1].then([ROW])
    bench.own(NAME, TEMPLATE.replace("downforce", "lift"))
    bench.adder.asked[1].then([ROW | {"effect": "lift"}])
    assert looked() == ["compare", "score"], "the same file, with another text"


def test_what_is_not_kept_leaves_no_folder(bench, tmp_path):
    out = tmp_path / "run-2"
    out.mkdir()
    with pytest.raises(InputError, match="no_such"):
        tasks.add(lambda step: None, bench.folder, (), "no_such", out, False)
    assert not out.exists()


def test_an_effect_of_one_s_own_is_kept_beside_the_run_tried_and_scored(bench):
    bench.own(NAME, TEMPLATE)
    path = bench.first.parent / NAME
    (asked,) = bench.adder.asked
    assert asked.task == "own" and path.read_text() == TEMPLATE
    rows = tasks.own(lambda step: None, *asked.given)
    assert [row["effect"] for row in rows] == ["downforce"] and bench.plugins == ()
    asked.then(rows)
    assert bench.plugins == (path,) and bench.candidates == rows
    assert bench.checked == bench.messages[-1]
    bench.own(NAME, TEMPLATE.replace("downforce", "lift"))
    assert "lift" in path.read_text(), "what was written here may be written again"
    bench.adder.asked[-1].failed("line 3: invalid syntax")
    assert bench.checked == f"{NAME}: line 3: invalid syntax", "told beside the box, not at the top of the page alone"


@pytest.mark.parametrize("name", ["../x.py", "x.txt", "a b.py", ".py", "x/y.py"])
def test_only_a_file_beside_the_run_is_written(bench, name):
    bench.own(name, TEMPLATE)
    assert "no file name" in bench.messages[-1] and not bench.adder.asked


def test_a_file_of_somebody_else_is_not_overwritten(bench):
    (bench.first.parent / NAME).write_text("mine = 1\n")
    bench.own(NAME, TEMPLATE)
    assert "is there already, and not from here" in bench.messages[-1]
    assert (bench.first.parent / NAME).read_text() == "mine = 1\n"


def test_a_run_in_memory_is_saved_first(bench):
    with pytest.raises(InputError, match="save it first"):
        Bench(SimpleNamespace(folder=None))


def test_closing_ends_both_workers(bench):
    bench.close()
    assert bench.looker.stopped and bench.adder.stopped


def test_a_bench_that_sleeps_asks_nothing_until_it_is_woken_once(bench):
    asleep = type(bench)(bench.run, asleep=True)
    assert asleep.looker.asked == []
    asleep.wake()
    asleep.wake()
    assert [one.task for one in asleep.looker.asked] == [one.task for one in bench.looker.asked]
