"""Users' effects that break a promise are told which, where, and how to mend it."""

from dataclasses import replace

import pytest
import torch

from solver.catalogue.verify import plausible, verify
from solver.effect import Effect, Parameter, effect
from solver.ground.ground import Ground
from vision.contract import InputError

SHARE = Parameter("share", "1", 0.1)


def made(stage: str, change, *parameters: Parameter) -> Effect:
    return effect("mine", stage, parameters or (SHARE,), physics="Mine.", source="Mine.")(change)


def gain(function):
    """An effect of the cable: strain times `function` of its values."""
    return made("cable", lambda cable, p, survey: replace(cable, gain=cable.gain * function(p)))


def in_place(load, p, survey):
    load.share.mul_(1 + p["share"])
    return load


def two_stages(load, p, survey):
    driven = load.trajectory
    return replace(load, trajectory=replace(driven, velocity=driven.velocity * (1 + p["share"])))


WRONG = {
    "not absent at": (gain(lambda p: 1.5 + p["share"]), "share = 0: it changes the strain rate by 0.5"),
    "derivative at null is not finite": (gain(lambda p: 1 + p["share"].abs().sqrt()), "share: .* square"),
    "not finite at": (gain(lambda p: torch.sin(p["share"]) / p["share"]), "avoid 0/0"),
    "zero though its effect is not": (gain(lambda p: 1 + p["share"] ** 2), "declare share_squared"),
    "cut derivatives": (gain(lambda p: 1 + p["share"].detach()), "share: its derivative at null is zero"),
    "abs has none": (gain(lambda p: 1 + p["share"].abs()), "share: its derivative at null is zero"),
    "not that of a small step": (gain(lambda p: 1 + p["share"] - 0.5 * p["share"].detach()), "cut derivatives"),
    "has a kink": (gain(lambda p: 1 + torch.maximum(p["share"], 0 * p["share"])), "not that of a small step"),
    "changes nothing": (gain(lambda p: 1 + 0 * p["share"]), "use values\\['share'\\]"),
    "looks up 'size'": (gain(lambda p: 1 + p["size"]), "declared are share"),
    "no numpy": (gain(lambda p: torch.from_numpy(1 + p["share"].numpy())), "computes with torch alone"),
    "it returned NoneType": (made("load", lambda load, p, survey: None), "end it with `return replace\\(load"),
    "it returned Ground": (made("cable", lambda cable, p, survey: Ground()), "return the cable stage"),
    "in place": (made("load", in_place), "share in place"),
    "two stages": (made("load", two_stages), "trajectory.velocity; declare it for the stage trajectory"),
    "has shape": (
        made("load", lambda load, p, survey: replace(load, share=load.share.squeeze() * (1 + p["share"]))),
        "load.share has shape .* not \\[row, 1 or channel, wheel\\]",
    ),
    "fails with TypeError": (made("cable", lambda cable, p: cable), "takes \\(cable, values, survey\\)"),
    "plausible size 0": (made("cable", lambda c, p, s: c, replace(SHARE, plausible=0.0)), "above 0"),
    "within the bounds": (made("cable", lambda c, p, s: c, replace(SHARE, lower=-0.01, upper=0.01)), "widen them"),
    "grid leaves": (
        made("cable", lambda c, p, s: c, SHARE, Parameter("place", "m", 1.0, lower=0, upper=5, grid=(1.0, 9.0))),
        "place: the grid leaves the bounds 0 to 5",
    ),
    "give it a grid": (
        made(
            "cable",
            lambda cable, p, survey: replace(cable, gain=1 + p["share"] * torch.sin(survey.distance + p["phase"])),
            SHARE,
            Parameter("phase", "1", 1.0),
        ),
        "mine, phase: changes nothing",
    ),
}  # fmt: skip


@pytest.mark.parametrize("promise", WRONG)
def test_a_broken_promise_is_named(promise):
    broken, words = WRONG[promise]
    with pytest.raises(InputError, match=words) as caught:
        verify(broken)
    told = str(caught.value)
    assert told.startswith("effect mine") and promise in told and "\n" not in told


def test_what_keeps_its_promises_passes():
    verify(gain(lambda p: torch.exp(p["share"])))
    verify(made("load", lambda load, p, survey: load.pushing(along=p["share"]), replace(SHARE, scope="pass")))


def test_a_plausible_value_stays_within_bounds():
    assert plausible(Parameter("a", "1", 0.2)) == 0.2
    assert plausible(Parameter("a", "1", 0.2, null=1.0, upper=1.1)) == 0.8


def test_the_trial_records_every_vehicle_class():
    """An effect on one class only is noticed."""
    for number in range(5):

        def change(load, p, survey, number=number):
            return replace(load, share=load.share * (1 + p["share"] * (load.class_index == number)[:, None, None]))

        verify(made("load", change))
