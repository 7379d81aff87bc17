"""A run of 10,000 channels on the page: nothing narrow is hidden, and what cannot be done is said."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from bokeh.plotting import figure

from roadfiber.web.strain_maps import CELLS
from roadfiber.web.workbench_page import Page

CHANNELS = 10_000


def long_run(run):
    """The run with its fiber drawn out: model and measurement the same everywhere, but at one channel and moment."""
    result = run.result
    channel = np.arange(CHANNELS)
    route = np.column_stack([1.021 * channel, np.full(CHANNELS, 4.0), np.ones(CHANNELS)])
    zeros = np.zeros((len(result.samples), CHANNELS))
    measured = zeros.copy()
    row = int(np.flatnonzero(np.isin(result.samples, run.passes[0].rows))[9])
    measured[row, 6543] = 9.0
    drawn_out = replace(
        result, channel=channel, distance=1.021 * channel, route=route, fitted_channel=channel, noise=np.ones(CHANNELS),
        covariance=np.broadcast_to(0.01 * np.eye(3), (CHANNELS, 3, 3)), tails=np.zeros((CHANNELS, 3, 3)),
        constrained=np.ones(CHANNELS, bool),
        data_share=np.ones((CHANNELS, 3)), measured=measured, model=zeros, weight=zeros + 1,
    )  # fmt: skip
    return replace(run, result=drawn_out, added=None, problem=SimpleNamespace(distance=drawn_out.distance))


@pytest.fixture
def page(bench):
    bench.runs = [long_run(bench.run)]
    bench.look()
    return Page(bench, "no film")


def test_a_residual_of_one_channel_is_on_the_map(page):
    page.controls.passes.value = 0
    image = page.maps.images[2].data["image"][0]
    assert max(image.shape) <= CELLS and np.nanmax(image) == 9.0
    assert page.controls.channel.value == 6543, "the channel that fits worst is chosen"


def test_what_cannot_be_added_is_said_and_nothing_is_asked_for_it(page, bench):
    assert [one.task for one in bench.looker.asked[3:]] == ["compare"]
    assert (
        "200 m at most; <code>roadfiber diagnose</code> and <code>compare</code> look at stretch after stretch"
        in page.controls.about.object
    )
    assert page.controls.effects.label.endswith("not asked, the fiber is too long")
    assert all(page.controls.button[name].disabled for name in ("add", "diagnose", "check"))


def test_a_model_that_fails_nowhere_says_so(page, bench):
    assert "Looking" in page.controls.where.object
    comparison = SimpleNamespace(regions=[])
    bench.comparison = comparison
    for one in (page.stack, page.by_channel, page.by_property):
        one.make = lambda: SimpleNamespace(show=lambda *given: None, plot=figure())
    page.show_comparison()
    assert "nowhere that this survey shows" in page.controls.where.object and not page.controls.regions.visible
