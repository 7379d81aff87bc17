"""A diagnosis in plain words."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from solver.catalogue.catalogue import built_in
from solver.catalogue.plain_words import told
from solver.criticism.audit import NoiseAudit
from solver.criticism.candidate import Candidate, idle_candidate
from solver.criticism.corridor import Corridor
from solver.criticism.diagnosis_files import diagnosis_facts
from solver.criticism.finding import Diagnosis
from solver.criticism.pages import diagnosis_page, widest_title
from solver.criticism.plain_verdict import details, headline, hidden_change, least_words, size_words
from solver.criticism.route_change import from_run, route_of
from solver.effect import Setting
from solver.fit.map_fit import MapFit

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
    assert size_words(first) == "11.50 ± 0.02 m" and least_words(first) == "0.10 m"


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


@pytest.mark.parametrize(
    ("widest", "title"),
    [("gauge_length", "gauge length"), ("disagreement", "how far vehicles disagree about the route")],
)
def test_what_widens_a_corridor_most_is_told_in_plain_words(widest: str, title: str) -> None:
    corridor = Corridor(np.zeros(0, int), np.zeros((0, 3, 3)), np.zeros((0, 2, 3)), widest, 0.8)
    found = replace(diagnosis("adequate", candidate("gauge_length")), corridor=corridor)
    assert widest_title(found) == title
    assert not widest_title(replace(found, corridor=replace(corridor, widest="")))
