"""Regions that fail, as outlines on the maps."""

import numpy as np

import roadfiber as rf
from roadfiber.web.outlines import outline, pass_of, window
from roadfiber.web.strain_maps import maps_of, worst_channel


def test_every_region_is_outlined_in_the_pass_that_shows_it(hidden):
    run = rf.open(hidden)
    regions = rf.compare(run).finding.regions
    assert regions
    for region in regions:
        number = pass_of(region, run, np.arange(len(run.passes), dtype=float))
        assert number is not None
        maps = maps_of(run, number)
        x, y = outline(region, run, maps)
        left, right, first, last = maps.extent
        assert left <= x.min() < x.max() <= right and (x[0], y[0]) == (x[-1], y[-1])
        channels, seconds = window((x, y), maps)
        assert left <= channels[0] < channels[1] <= right and first <= seconds[0] < seconds[1] <= last


def test_a_model_of_its_own_changes_what_is_left(hidden):
    run = rf.open(hidden)
    plain, none = maps_of(run, 0), maps_of(run, 0, np.zeros_like(run.result.model))
    there = np.isfinite(plain.measured)
    assert np.array_equal(none.residual[there], plain.measured[there])
    channel, measured, model = plain.trace(worst_channel(plain))
    assert channel in plain.channel and len(measured) == len(model) == len(plain.seconds)
