"""A diagnosis in plain words."""

from dataclasses import asdict, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from solver.catalogue.catalogue import built_in
from solver.catalogue.plain_words import told
from solver.criticism.audit import NoiseAudit
from solver.criticism.candidate import Candidate, idle_candidate
from solver.criticism.diagnosis_files import diagnosis_facts
from solver.criticism.finding import Diagnosis
from solver.criticism.pages import diagnosis_page
from solver.criticism.plain_verdict import details, headline, hidden_change, least_words, size_words
from solver.criticism.quick_corridor import diagnosis_gate
from solver.criticism.route_change import borne_out, from_run, route_of
from solver.effect import Setting
from solver.fit.map_fit import MapFit
from solver.run.geojson import Z95
from solver.run.strict_json import strict
from solver.run.trust import Gate, Trust

HERE = Setting(gauge_length=10.0, channel_spacing=1.0, x=50.0, along=100.0)
QUIET = NoiseAudit(1000, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.1, 0.0, 1.0, ())


def candidate(name: str, **more: object) -> Candidate:
    effect = built_in()[name]
    values = {"estimate": 0.15, "sigma": 0.002, "detectable_size": 0.01, "refitted": True} | more
    one = replace(idle_candidate(effect), numbers=1, delta_chi2=900.0, retained_share=0.4, **values)
    figures = {"estimate": one.estimate, "sigma": one.sigma, "detectable": one.detectable_size}
    return replace(one, told=told(effect, HERE, shape={"place": 0.0}, **figures))


def diagnosis(verdict: str, *candidates: Candidate) -> Diagnosis:
    return Diagnosis(verdict, "in the commands' terms", candidates, QUIET, 0.0)


def test_a_missing_effect_is_reported_with_its_size_what_it_does_and_what_would_have_shown() -> None:
    first = candidate("gauge_length", route_change=0.414, confounded_with=("pulse_width", "shear_lag"))
    found = diagnosis("missing-effect", first, candidate("pulse_width"), candidate("shear_lag"))
    assert headline(found) == "Gauge length. The interrogator averages strain over 11.50 m, not over 10 m."
    assert details(found) == [
        "Ignored, it moves the route by up to 0.41 m.",
        "This survey would have shown it from 0.10 m on.",
        "The survey cannot tell it from pulse width or soft jacket: each of these may be there in its place.",
    ]
    wild = replace(first, told=replace(first.told, size=23750.0, sigma=6800.0))
    assert size_words(wild) == "23800 ± 6800 m"
    assert size_words(first) == "11.500 ± 0.020 m" and least_words(first) == "0.10 m"


@pytest.mark.parametrize(
    ("verdict", "words"),
    [
        ("adequate", "Nothing is missing"),
        ("unknown-effect", "Something acts that the catalogue does not know, at the cable stage."),
        ("inconclusive", "This survey cannot say"),
    ],
)
def test_other_verdicts_are_sentences_too(verdict: str, words: str) -> None:
    found = diagnosis(verdict, candidate("slack_spool"))
    assert headline(found).startswith(words)
    assert diagnosis_facts(found)["headline"] == headline(found) and "fits" not in diagnosis_facts(found)


def test_what_is_too_small_to_show_may_still_move_the_route() -> None:
    """The score test moves the route by 0.3 m with 0.15; 0.01 would have shown: 0.02 m."""
    one = candidate("gauge_length", route_change=0.3, refitted=False)
    assert hidden_change(one) == pytest.approx(0.02)
    assert hidden_change(replace(one, refitted=True)) is None


def test_the_route_moves_from_where_the_run_has_it(survey) -> None:
    """A fit that ends where the run did moves nothing; a run that lies 0.3 m aside, 0.3 m."""
    fit = MapFit(survey.problem)
    end = fit.start()
    ends, there = {"gauge_length": (fit, end)}, route_of(fit, end, survey.result.channel)
    found = replace(diagnosis("missing-effect", candidate("gauge_length", route_change=9.0)), fits=ends)
    for aside in (0.0, 0.3):
        result = replace(survey.result, route=there + np.array([0.0, aside, 0.0]))
        moved = from_run(SimpleNamespace(result=result), found).candidates[0].route_change
        assert moved == pytest.approx(aside, abs=1e-6)


def test_markup_in_a_users_name_is_text_on_the_page() -> None:
    evil = "<img src=x onerror=alert(1)>"
    one = candidate("gauge_length")
    evil_told = replace(one.told, title=evil, sentence=evil, unit=evil)
    page = diagnosis_page(diagnosis("missing-effect", replace(one, told=evil_told, confounded_with=(evil,))), evil)
    assert "<img src=x" not in page and "&lt;img" in page


def test_what_shows_and_does_not_matter_is_not_called_nothing() -> None:
    """ "Nothing is missing" stood over an effect with a probability of 100 %."""
    small = candidate("slack_spool", verdict="negligible", probability=0.9)
    unseen = replace(small, probability=0.01)
    assert headline(diagnosis("adequate", unseen)) == "Nothing is missing that this survey could show."
    assert headline(diagnosis("adequate", small)).startswith("Coil of slack shows, too small to matter: ")


@pytest.mark.parametrize(
    ("verdict", "move", "checked", "words"),
    [
        ("adequate", None, "passed", "the diagnosis finds nothing missing"),
        ("missing-effect", 0.4, "failed", "the model lacks gauge length, which moves the route by up to 0.40 m"),
        ("missing-effect", 0.1, "passed", "the model lacks gauge length, which moves the route by up to 0.10 m"),
        ("unknown-effect", None, "failed", "something acts at the interrogator stage that the catalogue does not know"),
        ("inconclusive", None, "open", "the diagnosis cannot tell what the model may lack"),
    ],
)
def test_what_a_diagnosis_finds_is_a_check_of_its_run(verdict: str, move: float, checked: str, words: str) -> None:
    gate = diagnosis_gate(diagnosis(verdict, candidate("gauge_length", route_change=move)), half_width=0.2)
    assert gate.verdict == checked and gate.words.startswith(words)


def test_a_bend_that_a_route_does_not_follow_is_told_everywhere() -> None:
    """The headline and the check said that nothing is missing, over words of a bend."""
    bend = "the fiber bends more sharply near channel 90 than the route follows"
    found = replace(diagnosis("adequate", candidate("gauge_length")), bend=bend)
    gate = diagnosis_gate(found, half_width=0.2)
    assert gate.verdict == "failed" and gate.words == bend and "roadfiber turn" in gate.mend[0]
    assert headline(found).startswith("The fiber bends more sharply near channel 90")


def judged_run(gates: list[Gate], half: float = 0.1) -> Any:
    """A run with checks and a corridor."""
    covariance = np.tile(np.diag([0.01, (half / Z95) ** 2, 0.01]), (3, 1, 1))
    route = np.column_stack([np.arange(3.0), np.full(3, 4.0), np.ones(3)])
    result = SimpleNamespace(route=route, covariance=covariance, constrained=np.ones(3, bool))
    return SimpleNamespace(result=result, facts={"trust": strict(asdict(Trust.of(gates)))})


def test_no_model_is_adequate_whose_run_leaves_more_than_noise() -> None:
    fine = diagnosis("adequate", candidate("gauge_length", verdict="excluded"))
    assert borne_out(judged_run([Gate("misfit", "passed", "m")]), fine) is fine
    told = borne_out(judged_run([Gate("misfit", "failed", "misfit 1.3 where noise alone leaves 1")]), fine)
    assert told.verdict == "inconclusive" and "misfit 1.3" in told.words


def test_what_moves_the_route_out_of_its_corridor_is_not_too_small_to_matter() -> None:
    small = candidate("slack_spool", verdict="negligible", route_change=0.4, probability=0.9)
    run = judged_run([Gate("misfit", "passed", "m")])
    assert borne_out(run, diagnosis("adequate", small)).verdict == "inconclusive"
    assert borne_out(run, diagnosis("adequate", replace(small, route_change=0.05))).verdict == "adequate"
