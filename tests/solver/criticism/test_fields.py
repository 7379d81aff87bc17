"""Numbers along fiber, road or tracks whose neighbors may be alike."""

import numpy as np
import pytest
import torch

from solver.catalogue.catalogue import built_in
from solver.criticism.fields import ALIKE, LASTING, alike, root
from solver.criticism.marginal import Spectrum

KNOWN = built_in()


@pytest.mark.parametrize(("name", "counts"), [("clock_offset", [1]), ("gauge_length", [1]), ("dynamic_load", [4, 4])])
def test_numbers_without_a_place_have_no_neighbors(name, counts):
    assert alike(KNOWN[name], counts, ()) is None


def test_neighbors_are_alike_over_tens_of_meters_whatever_the_spacing_of_knots():
    fine, coarse = (root(13, spacing) @ root(13, spacing).T for spacing in (5.0, 10.0))
    torch.testing.assert_close(fine[0, ::2], coarse[0, :7])
    assert float(fine[0, 1]) > 0.9 and float(fine[0, 4]) == pytest.approx((1 + 3**0.5) * np.exp(-(3**0.5)))
    assert ALIKE == 4 * 5.0


def test_each_parameter_of_a_field_is_alike_by_itself():
    field = alike(KNOWN["generic_track"], [8, 8], ())
    assert field is not None and not field[:8, 8:].any()
    torch.testing.assert_close(field[:8, :8], root(8, 10.0))


def test_neighbors_along_one_track_are_alike_for_seconds_and_tracks_are_not():
    field = alike(KNOWN["track_jitter"], [12, 12], tracks=[7, 5])
    assert field is not None
    correlation = field @ field.T
    torch.testing.assert_close(correlation[:7, :7], root(7, 1.0, LASTING) @ root(7, 1.0, LASTING).T)
    assert float(correlation[0, 1]) > 0.7 and float(correlation[0, 6]) < 0.05
    assert not correlation[:7, 7:].any() and not correlation[7:12, 12:].any()


def test_passes_may_have_one_number():
    """One process for all of them; what has no number for each pass stays as it is."""
    same = alike(KNOWN["dynamic_load"], [4, 4], (), passes=True)
    assert same is not None and same.tolist() == [[1, 0]] * 4 + [[0, 1]] * 4
    assert alike(KNOWN["clock_offset"], [1], (), passes=True) is None
    size, information = torch.ones(6, dtype=torch.float64), 400 * torch.eye(6, dtype=torch.float64)
    one = Spectrum.of(information, 400 * 0.5 * size, size, torch.ones(6, 1, dtype=torch.float64))
    assert one.smaller(1.0) > 10, "six numbers that are the same pay for one"


def test_a_gradual_field_is_more_probable_than_its_numbers_one_by_one_and_a_rough_one_hardly_less():
    """Evidence of an effect that is read off directly, with noise of one tenth of its plausible size."""
    count, variance = 24, 1.0
    information, size = 100 * torch.eye(count, dtype=torch.float64), torch.ones(count, dtype=torch.float64)
    rng = np.random.default_rng(2)
    gained = {"gradual": [], "rough": []}
    for _ in range(40):
        drawn, noise = torch.from_numpy(rng.normal(size=count)), 10 * torch.from_numpy(rng.normal(size=count))
        for kind, field in (("gradual", root(count, 5.0) @ drawn), ("rough", drawn)):
            with_it = Spectrum.of(information, 100 * field + noise, size, root(count, 5.0))
            without = Spectrum.of(information, 100 * field + noise, size)
            gained[kind].append(with_it.evidence(variance) - without.evidence(variance))
    assert np.median(gained["gradual"]) > 15
    assert min(gained["rough"]) > -np.log(2) - 1e-9, "no more than the odds of two kinds"
