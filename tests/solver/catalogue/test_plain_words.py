"""Every effect says in plain words what it is, with its size in a unit that people know."""

import math

import pytest

from solver.catalogue.catalogue import FAULTS, built_in
from solver.catalogue.listing import listed
from solver.catalogue.plain_words import rounded, told
from solver.effect import Parameter, Setting, effect

HERE = Setting(gauge_length=10.0, channel_spacing=1.021, x=48.0, along=120.0)
EFFECTS = built_in()


@pytest.mark.parametrize("name", EFFECTS)
def test_every_effect_has_a_title_and_a_sentence_of_its_own(name: str) -> None:
    one = EFFECTS[name]
    p = one.amplitudes[0]
    shape = {q.name: q.grid[0] for q in one.shapes}
    for value in {min(p.null + p.plausible, p.upper), max(p.null - p.plausible, p.lower)} - {p.null}:
        said = told(one, HERE, estimate=value, sigma=0.05 * p.plausible, detectable=0.2 * p.plausible, shape=shape)
        assert said.title == one.title != name and "_" not in said.title + said.sentence
        assert said.sentence[0] == said.sentence[0].upper() and said.sentence.endswith(".")
        assert not {"{", "}"} & set(said.sentence) and "None" not in said.sentence
        assert said.sigma > 0 and 0 < said.detectable < math.inf
    titles = [other.title for other in (*EFFECTS.values(), *FAULTS.values())]
    assert titles.count(one.title) == 1


@pytest.mark.parametrize(
    ("name", "value", "sentence"),
    [
        ("gauge_length", -0.15, "The interrogator averages strain over 8.500 m, not over 10 m."),
        ("channel_stretch", 0.01, "Channels lie 1.031 m apart along the cable, not 1.021 m."),
        ("clock_offset", -0.3, "The DAS clock is 0.300 s behind the vehicles' clock."),
        ("pulse_width", 49.0, "The light pulse blurs strain over 7.00 m of fiber."),
        ("stiffness_contrast", math.log(0.5), "Beyond x = 58 m the ground is 50.0 % softer."),
        ("moving_load", 1e-4, "The ground is so soft that shear waves run at only 100 m/s."),
    ],
)
def test_sizes_are_those_that_people_know(name: str, value: float, sentence: str) -> None:
    sigma = 1e-3 * abs(value)
    said = told(EFFECTS[name], HERE, estimate=value, sigma=sigma, detectable=0.1, shape={"place": 10.0})
    assert said.sentence == sentence


def test_sigma_and_least_size_are_in_the_same_unit() -> None:
    """A squared width of 49 +- 1.4 m^2 is 7 +- 0.1 m; 4 m^2 would have shown, which is 2 m."""
    said = told(EFFECTS["pulse_width"], HERE, estimate=49.0, sigma=1.4, detectable=4.0)
    assert (said.size, said.detectable, said.unit) == (7.0, 2.0, "m")
    assert said.sigma == pytest.approx(0.1, rel=1e-3)


def test_what_no_record_could_show_is_infinite() -> None:
    """A ratio whose logarithm is 2,000, of which a score alone may speak, is beyond any number."""
    said = told(
        EFFECTS["stiffness_contrast"], HERE, estimate=0.5, sigma=900.0, detectable=2000.0, shape={"place": 10.0}
    )
    assert said.size == pytest.approx(64.9, abs=0.1) and said.sigma == said.detectable == math.inf
    assert said.sentence == "Beyond x = 58 m the ground is 64.9 % stiffer."


def test_a_number_of_another_kind_is_reported_as_it_is() -> None:
    said = told(EFFECTS["wheel_layout"], HERE, estimate=0.1, sigma=0.01, detectable=0.05, unit="1")
    assert (said.size, said.unit, said.sentence) == (0.1, "", EFFECTS["wheel_layout"].physics)


def test_a_users_own_effect_falls_back_to_its_name_and_physics() -> None:
    @effect("axle_lift", "load", [Parameter("share", "1", 0.1)], physics="The rear axle carries less.", source="-")
    def mine(load, p, survey):
        return load

    said = told(mine, HERE, estimate=0.2, sigma=0.01, detectable=0.05)
    assert (said.title, said.sentence, said.size) == ("axle_lift", "The rear axle carries less.", 0.2)


def test_faults_are_reported_too_and_the_list_has_titles() -> None:
    fault = FAULTS["unseen_vehicle"]
    said = told(fault, HERE, estimate=1.2, sigma=0.1, detectable=0.2)
    assert "it weighs 120 % of a typical one" in said.sentence
    assert {row["title"] for row in listed(EFFECTS)} >= {"Gauge length", fault.title}


def test_numbers_have_the_digits_that_are_known() -> None:
    assert [rounded(v, s) for v, s in ((0.0, 0.2), (-3.14159, 0.2), (1e-5, math.nan), (math.inf, 1.0))] == [
        "0.00",
        "-3.14",
        "1e-05",
        "-",
    ]
