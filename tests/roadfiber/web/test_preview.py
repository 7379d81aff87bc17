"""An effect at a size chosen by hand."""

import pytest

import roadfiber as rf
from roadfiber.web import tasks
from vision.contract import InputError


@pytest.fixture(scope="module")
def previews(hidden):
    return tasks.previews(hidden, ())


@pytest.fixture(scope="module")
def gauge(hidden):
    return rf.open(hidden).known["gauge_length"]


def test_where_the_effect_is_absent_the_run_is_as_it_was(previews, gauge, hidden):
    run = rf.open(hidden)
    shown = previews.at(gauge, 0.0)
    assert shown.misfit == pytest.approx(run.result.chi2_per_dof, rel=1e-6)
    assert shown.model == pytest.approx(run.result.model, rel=1e-4, abs=1e-5 * abs(run.result.model).max())
    at = [list(run.result.channel).index(one) for one in run.result.fitted_channel]
    assert shown.route == pytest.approx(run.result.route[at], abs=1e-3)


def test_the_misfit_falls_toward_the_true_size_and_further_as_all_else_follows(previews, gauge):
    none, held = previews.at(gauge, 0.0).misfit, previews.at(gauge, 0.15, follow=False).misfit
    first = previews.at(gauge, 0.15)
    assert first.misfit < held and "11.5 m" in first.sentence
    nearer = [first.misfit]
    while (shown := previews.nearer(gauge, 0.15)) is not None:
        nearer.append(shown.misfit)
    assert len(nearer) > 1 and nearer[-1] < 1.05 < none
    assert previews.nearer(gauge, 0.15) is None, "it is at rest"
    assert previews.nearer(gauge, 0.2) is None, "that was not shown"


def test_many_numbers_are_moved_together(previews, hidden):
    dial = previews.dial(rf.open(hidden).known["channel_coupling"])
    assert (dial.lower, dial.null, dial.best, dial.unit) == (0.0, 0.0, 1.0, "1")


def test_what_has_no_size_is_a_line(hidden):
    with pytest.raises(InputError, match="unseen_vehicle: a fault of the survey, with no size to choose; add it"):
        tasks.dial(print, hidden, (), "unseen_vehicle")
    with pytest.raises(InputError, match="wheel_layout: does nothing in this survey; choose another effect"):
        tasks.dial(print, hidden, (), "wheel_layout")
