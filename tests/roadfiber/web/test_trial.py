"""A size that is moved on a page, with a worker that answers as it is told."""

import numpy as np
import pytest

from roadfiber.web.preview import Dial, Preview
from roadfiber.web.workbench_page import Page


@pytest.fixture
def page(bench):
    """A page on which a candidate is chosen and prepared."""
    page = Page(bench, "no film")
    page.trial.begin("gauge_length")
    bench.looker.asked[-1].then(Dial("gauge_length", "longer", "1", 0.0, 0.3, 0.0, 0.15))
    page.browser.catch_up()
    return page


def moved(page, size):
    """Move the slider; what was asked last."""
    page.controls.size.value = size
    return page.bench.looker.asked[-1]


def answered(page, asked, misfit):
    """Answer a request with a preview, and let the page take it."""
    result = page.run.result
    there = np.isin(result.channel, result.fitted_channel)
    model = result.model.astype(np.float32)
    asked.then(None if misfit is None else Preview(asked.given[3], model, misfit, result.route[there], "Longer."))
    page.browser.catch_up()


def tasks_of(page):
    return [(one.task, one.given[3]) for one in page.bench.looker.asked if one.task in ("preview", "nearer")]


def test_a_size_is_asked_for_at_once_while_a_step_nearer_to_the_last_is_under_way(page):
    answered(page, moved(page, 0.06), 1.3)
    nearer = page.bench.looker.asked[-1]
    assert tasks_of(page) == [("preview", 0.06), ("nearer", 0.06)]
    preview = moved(page, 0.12)
    assert tasks_of(page)[2:] == [("preview", 0.12)], "it does not wait"
    answered(page, preview, 1.2)
    assert "data-size='0.12'" in page.controls.expected.object and len(tasks_of(page)) == 3, "one nearer at a time"
    answered(page, nearer, 1.25)
    assert "1.200" in page.controls.expected.object, "what was of another size is not shown"
    assert tasks_of(page)[3:] == [("nearer", 0.12)]
    answered(page, page.bench.looker.asked[-1], 1.1)
    assert "1.100" in page.controls.expected.object
    answered(page, page.bench.looker.asked[-1], None)
    assert "1.100" in page.controls.expected.object and tasks_of(page)[4:] == [("nearer", 0.12)], "it is at rest"


def test_sizes_that_are_passed_while_one_is_computed_are_left_out(page):
    first = moved(page, 0.03)
    for size in (0.06, 0.09, 0.12):
        moved(page, size)
    assert tasks_of(page) == [("preview", 0.03)]
    answered(page, first, 1.3)
    assert "data-size='0.03'" in page.controls.expected.object, "what is there is shown"
    assert tasks_of(page)[1:] == [("preview", 0.12)]


def test_what_comes_after_another_was_chosen_is_not_shown(page):
    asked = moved(page, 0.03)
    page.trial.begin("camber")
    answered(page, asked, 1.3)
    assert page.controls.expected.object == "" and tasks_of(page) == [("preview", 0.03)]
