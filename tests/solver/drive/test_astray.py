"""What a drive says of stretches on which what should agree does not."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from solver.drive.astray import anchor_gate, between_others, companions, others, places
from solver.drive.drive_words import Unheard, advice, constrained_of, slack_of
from solver.drive.path import path_of
from solver.survey.anchors import Anchor

CHANNELS = 60


def fit_of(**changed: Any) -> SimpleNamespace:
    """A fit of channels 100 to 159, 10 m apart, all of which hear the car on its one leg but for 20 to 39."""
    cell = 10.0 * np.arange(CHANNELS)
    audible = np.ones((1, CHANNELS), bool)
    audible[0, 20:40] = False
    one = {
        "legs": SimpleNamespace(count=1),
        "picks": SimpleNamespace(audible=audible, amplitude=np.tile(np.array([9.0, 11.0]), (1, CHANNELS // 2))),
        "channels": SimpleNamespace(cell=cell.copy(), loop=np.zeros(CHANNELS, bool), other=np.zeros(CHANNELS)),
        "along": SimpleNamespace(cell=cell, error=np.zeros((1, CHANNELS)), stretch=np.zeros(CHANNELS)),
        "quiet": SimpleNamespace(
            channel=np.arange(100, 160), channel_spacing=10.0, dead=np.zeros(CHANNELS, bool), gauge_length=10.0
        ),
        "cell": cell,
        "sigma": np.full(CHANNELS, 1.0),
        "beside": np.ones(CHANNELS, bool),
        "audible": audible[0],
        "aside": SimpleNamespace(sigma=np.ones(CHANNELS)),
        "clock_sigma": 0.01,
        "loops": [],
    }
    return SimpleNamespace(**one | changed)


def test_car_far_from_its_gps_is_told_with_its_place() -> None:
    fit = fit_of()
    assert places(fit).verdict == "passed"
    fit.along.error[0, 8:16] = -14.0
    gate = places(fit)
    assert gate.verdict == "failed"
    assert gate.words == "on channels 108 to 115 what is heard is up to 14 m from where the GPS has the car"
    fit.along.error[0, 10::3] = 0.0  # five channels in a row at most
    assert places(fit).verdict == "passed"


def test_estimates_that_disagree_are_told_on_channels_that_are_heard() -> None:
    fit = fit_of()
    fit.channels.cell[18:44] += 30.0
    assert places(fit).words.startswith("on channels 118 to 143 what is heard is up to 30 m")
    fit.channels.cell[40:44] -= 30.0  # only where nothing is heard, but for two channels
    assert places(fit).verdict == "passed"


def test_anchors_off_the_route_are_told_and_which_mistake_would_explain_them() -> None:
    path = path_of(np.array([[0.0, 90.0], [300.0, 120.0], [600.0, 60.0]]))
    cell, lateral = path.first + 10.0 * np.arange(CHANNELS), np.full(CHANNELS, 4.0)
    fit = fit_of(path=path, cell=cell, aside=SimpleNamespace(sigma=np.full(CHANNELS, 2.0), lateral=lateral))
    near = path.at(cell[[12, 40]], 4.0) + np.array([[1.0, 0.0], [0.0, -2.0]])
    right = [
        Anchor(name, 100 + at, *place, 1.0, 0.5, 0.2) for name, at, place in zip("ab", (12, 40), near, strict=True)
    ]
    (gate,) = anchor_gate(fit, right)
    assert (gate.verdict, gate.words) == ("passed", "2 anchors within 1.0 sigmas of the route")
    (gate,) = anchor_gate(fit, [replace(one, y=-one.y) for one in right])
    assert gate.verdict == "failed" and gate.words.startswith("anchor a 2") and ", anchor b 2" in gate.words
    assert gate.words.endswith("all on it if y had the other sign (y is to the right of x)")
    (gate,) = anchor_gate(fit, [right[0], replace(right[1], x=right[1].x + 30)])
    assert gate.words.startswith("anchor b 3") and "other sign" not in gate.words
    assert anchor_gate(fit, []) == []


def test_channels_that_hear_others_are_counted_and_named() -> None:
    fit = fit_of()
    fit.channels.other[20:40] = 0.9
    assert others(fit).verdict == "failed"
    assert others(fit).words == "20 of the 60 channels beside the car hear another vehicle in its place"
    fit.channels.other[26:] = 0.2
    assert others(fit).verdict == "passed"
    told = advice(fit, [Unheard(20, 39, 200.0, 390.0, beside=True, other=True)])
    assert told == [
        "channels 120 to 139, 0.20 to 0.39 km: another vehicle is heard in place of the car; drive again with less "
        "traffic, or tap near channel 129"
    ]


def test_slack_that_cannot_be_placed_is_told() -> None:
    fit = fit_of()
    stretch = Unheard(20, 39, 200.0, 320.0, beside=False, other=False)
    assert slack_of(fit, stretch)[0] == 0.0
    fit.cell[30:] -= 80.0
    slack, sigma = slack_of(fit, stretch)
    assert slack == 80.0
    assert sigma == np.hypot(np.sqrt(2.0), 0.02 * 130.0)
    assert advice(fit, [stretch])[0].endswith(". 80 ± 3 m of slack lie somewhere on them")


def test_slack_that_nothing_confirms_is_not_constrained() -> None:
    """Twenty channels at one place, one of which hears something: cable before the drive, not a loop at a manhole."""
    fit = fit_of(path=SimpleNamespace(first=0, length=600.0))
    fit.channels.in_loop = np.where(np.arange(CHANNELS) < 20, 0.99, 0.0)
    fit.cell[:20] = fit.cell[20]
    fit.audible[20:] = True
    assert constrained_of(fit).tolist() == [False] * 20 + [True] * 40
    fit.loops.append(SimpleNamespace(first=10, last=19))
    assert constrained_of(fit)[9:20].tolist() == [False] + [True] * 10


def test_cable_beyond_what_hears_the_car_is_not_constrained() -> None:
    """Two gauges of cable that the fit has run on may as well be coiled where the cable begins."""
    fit = fit_of(path=SimpleNamespace(first=0, length=600.0))
    fit.channels.in_loop = np.zeros(CHANNELS)
    fit.audible[:] = (np.arange(CHANNELS) // 20 == 1) & (np.arange(CHANNELS) != 29)
    assert np.flatnonzero(constrained_of(fit)).tolist() == list(range(20, 40))


def test_louder_stretch_between_channels_that_hear_another_vehicle_is_told() -> None:
    fit = fit_of()
    fit.picks.audible[:] = True
    fit.picks.audible[0, [10, 11, 12, 30, 31, 32]] = False
    fit.channels.other[[10, 11, 12, 30, 31, 32]] = 0.9
    assert companions(fit).verdict == "passed"  # as loud as the car
    fit.picks.amplitude[0, 13:30] *= 2.0
    gate = companions(fit)
    assert gate.verdict == "failed"
    assert gate.words.startswith("before and behind channels 113 to 129 another vehicle is heard")
    fit.channels.other[30:33] = 0.0  # heard before it only
    assert companions(fit).verdict == "passed"
    assert between_others(fit_of(beside=np.zeros(CHANNELS, bool))) == []
