"""Derivatives of the model by a parameter of an effect."""

from dataclasses import replace
from functools import partial

import pytest
import torch

from solver.catalogue.catalogue import built_in
from solver.catalogue.trial_survey import trial_survey
from solver.effect import Parameter
from solver.fit.map_fit import MapFit
from solver.ground.gibson import gibson_displacement_rate
from solver.signal_path.autodiff import pushing
from solver.signal_path.derivatives import derivative, slope
from solver.signal_path.local import Local, Seen
from solver.signal_path.map_changes import by_channel


@pytest.mark.parametrize("here", [0.0, 0.4, 2.0])
def test_a_law_is_never_asked_for_beyond_its_bounds(here: float) -> None:
    asked = []

    def law(value: torch.Tensor) -> torch.Tensor:
        asked.append(value)
        return torch.sin(3 * value) * torch.tensor([[1.0], [2.0]])

    at = torch.tensor([[here], [0.4]], dtype=torch.float64)
    found = slope(law, at, Parameter("share", "1", 0.2, lower=0, upper=2), law(at))
    torch.testing.assert_close(found, 3 * torch.cos(3 * at) * torch.tensor([[1.0], [2.0]]), rtol=1e-6, atol=1e-8)
    assert torch.stack(asked).min() >= 0
    assert torch.stack(asked).max() <= 2


@pytest.mark.parametrize("gradient", [0.0, 0.7])
def test_of_a_tabulated_law_as_automatic_differentiation_has_it(gradient: float) -> None:
    """At the bound, too, where the law is Boussinesq's."""
    offset = torch.tensor([[3.0, 1.0, 0.9], [-8.0, 4.0, 1.5]], dtype=torch.float64)
    velocity = torch.tensor([10.0, 1.0], dtype=torch.float64)

    def law(value: torch.Tensor) -> torch.Tensor:
        return gibson_displacement_rate(offset, velocity, 0.25, value)

    here = torch.tensor(gradient, dtype=torch.float64)
    found = slope(law, here, Parameter("gradient", "1/m", 1.0, lower=0, upper=3), law(here))
    torch.testing.assert_close(found, torch.func.jvp(law, (here,), (torch.ones_like(here),))[1], rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize("chosen", [None, torch.tensor([True, False, True, True])])
def test_what_each_channel_makes_of_its_own_value_holds_all_derivatives_only_where_no_other_matters(
    chosen: torch.Tensor | None,
) -> None:
    here = torch.tensor([0.1, 0.4, -0.3, 0.2], dtype=torch.float64)
    record = torch.arange(12.0, dtype=torch.float64).reshape(3, 4)
    measured = slice(None) if chosen is None else chosen
    alone = pushing(lambda v: ((record * v.exp())[:, measured],), here)
    mixed = pushing(lambda v: ((record * (v - v.mean()).exp())[:, measured],), here)
    each = by_channel(lambda way: alone(way)[0], here, chosen)
    assert each is not None
    torch.testing.assert_close(each, (record * here.exp())[:, measured])
    assert by_channel(lambda way: mixed(way)[0], here, chosen) is None


@pytest.mark.parametrize("name", ["viscoelastic_lag", "time_averaging", "generic_delay", "clock_offset"])
def test_of_filters_in_time_as_automatic_differentiation_has_it(name: str) -> None:
    """Where another filter in time acts already."""
    effects = built_in()["lowpass"], built_in()[name]
    fit, state = trial_survey()
    fit = MapFit(replace(fit.problem, effects=effects))
    numbers = fit.extension.numbers({"lowpass": {effects[0].amplitudes[0].name: effects[0].amplitudes[0].plausible}})
    state = fit.start_at(state.coefficients, state.poisson_ratio, numbers)
    slot = next(one for one in fit.extension.slots if one.effect.name == name and not one.parameter.is_shape)
    step = 1e-5 * slot.parameter.plausible

    def model(way: float) -> torch.Tensor:
        moved = numbers.clone()
        moved[slot.where] += way * step
        return fit.model(replace(state, numbers=moved))

    base = model(0.0)
    local = Local(
        fit.path,
        partial(fit.gauges_at, fit.path, state.coefficients),
        state.vehicles.rows(fit.path.traffic),
        state.poisson_ratio,
        fit.values(state),
    )
    found = derivative(Seen(fit.path, local.gauges, local), slot, numbers).sum(0)
    expected = (model(1.0) - model(-1.0)) / (2 * step)
    assert float(expected.abs().max()) * slot.parameter.plausible > 1e-3 * float(base.abs().max())
    torch.testing.assert_close(found, expected, rtol=0, atol=1e-5 * float(expected.abs().max()))
