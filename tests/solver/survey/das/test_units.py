from pathlib import Path

import numpy as np
import pytest

from solver.survey.das.units import (
    QUANTITIES,
    Unit,
    across_gauge,
    parse_unit,
    resolve,
    strain_per_radian,
    strain_rate_per_count,
    time_derivative,
    to_strain_rate,
)
from vision.contract import InputError

FILE = Path("a.h5")


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("1/s", Unit("strain_rate")),
        ("(nm/m)/s", Unit("strain_rate", 1e-9)),
        ("nε/s", Unit("strain_rate", 1e-9)),
        ("microstrain/s", Unit("strain_rate", 1e-6)),
        ("strain", Unit("strain")),
        ("nanostrain", Unit("strain", 1e-9)),
        ("rad", Unit("phase")),
        ("mrad/s", Unit("phase_rate", 1e-3)),
        ("rad/m", Unit("phase", 1.0, per_length=True)),
        ("rad/m/s", Unit("phase_rate", 1.0, per_length=True)),
        ("mm/s", Unit("velocity", 1e-3)),
        ("(nm/m)/s * Hz/m", Unit("idas_counts", 116.0)),
        ("counts", None),
        ("furlong", None),
        ("volt", None),
        ("rad*s", None),
        ("no such unit", None),
        ("9**9**9 1/s", None),  # in whole numbers it has 400 million digits
        ("9" * 100_000 + "/s", None),
        ("1e400/s", None),
        (" ", None),
        ("", None),
    ],
)
def test_units(text, unit):
    parsed = parse_unit(text)
    if unit is None:
        assert parsed is None
    else:
        assert parsed is not None
        assert (parsed.quantity, parsed.per_length) == (unit.quantity, unit.per_length)
        assert parsed.factor == pytest.approx(unit.factor)


def test_published_constants():
    # Lindsey et al. 2020: 11.6 nanostrain per radian at 10 m, with n = 1.445 and zeta = 0.735.
    assert strain_per_radian(10.0) * (1.468 * 0.78) / (1.445 * 0.735) == pytest.approx(11.6e-9, rel=2e-3)
    # Silixa: 116 nm per radian-like unit of 8192 counts, per sample, over the gauge length.
    assert strain_rate_per_count(1000.0, 10.0) * 8192 == pytest.approx(116e-9 * 1000 / 10)


@pytest.mark.parametrize(
    ("unit", "quantity", "scale", "result"),
    [
        (Unit("strain", 1e-9), None, None, Unit("strain", 1e-9)),
        (Unit("strain", 1e-9), "strain", None, Unit("strain", 1e-9)),
        (Unit("strain", 1e-9), None, 2.0, Unit("strain", 2.0)),
        (Unit("strain", 1e-9), "phase", 2.0, Unit("phase", 2.0)),
        (Unit("phase", 1.0, per_length=True), "phase", 2.0, Unit("phase", 2.0, per_length=True)),
        (None, "phase_rate", None, Unit("phase_rate", 1.0)),
        (None, "idas_counts", None, Unit("idas_counts", 116.0)),
    ],
)
def test_what_file_and_user_say_together(unit, quantity, scale, result):
    assert resolve(unit, "", quantity, scale, FILE) == result


@pytest.mark.parametrize(
    ("unit", "quantity", "scale", "says"),
    [
        (None, None, None, "states 'XYZ', which tells no unit; give quantity"),
        (None, None, 1e-9, "give quantity"),
        (Unit("velocity"), "strain_rate", None, "holds velocity, not strain_rate"),
        (None, "temperature", None, "unknown quantity 'temperature'; give one of strain_rate"),
    ],
)
def test_what_nobody_says_is_refused(unit, quantity, scale, says):
    with pytest.raises(InputError, match=says):
        resolve(unit, "XYZ", quantity, scale, FILE)


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_every_quantity_comes_out_as_strain_rate(quantity):
    rate, gauge, spacing, sampling_rate = 3e-7, 10.0, 1.0, 50.0
    time = np.arange(200)[:, None] / sampling_rate
    distance = np.arange(30.0)[None]
    stored = {
        "strain_rate": rate + 0 * time * distance,
        "strain": rate * time + 0 * distance,
        "phase": rate * time / strain_per_radian(gauge) + 0 * distance,
        "phase_rate": rate / strain_per_radian(gauge) + 0 * time * distance,
        "velocity": rate * distance + 0 * time,
        "idas_counts": rate / strain_rate_per_count(sampling_rate, gauge) + 0 * time * distance,
    }[quantity]
    if quantity == "velocity":
        result, n = across_gauge(stored, spacing, gauge)
        assert n == 5
        assert result.shape == (200, 20)
    else:
        factor = 116.0 if quantity == "idas_counts" else 1.0
        result = to_strain_rate(stored, Unit(quantity, factor), sampling_rate, gauge)
    assert np.allclose(result, rate, rtol=1e-6)


def test_phase_per_meter_does_not_depend_on_the_gauge():
    unit = Unit("phase_rate", 1.0, per_length=True)
    one, other = (to_strain_rate(np.ones((3, 1)), unit, 5.0, gauge) for gauge in (5.0, 20.0))
    assert np.allclose(one, strain_per_radian(1.0))
    assert np.allclose(one, other)


def test_derivative_of_a_wave_at_a_fifth_of_the_sampling_rate():
    time = np.arange(200) / 5.0
    derivative = time_derivative(np.sin(2 * np.pi * time)[:, None], 5.0)[20:-20, 0]
    expected = 2 * np.pi * np.cos(2 * np.pi * time)[20:-20]
    assert np.abs(derivative / expected - 0.983).max() < 2e-3
    assert np.isnan(time_derivative(np.ones((1, 2)), 5.0)).all()
