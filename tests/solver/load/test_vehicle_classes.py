"""Classes of vehicles as their users spell them, and wheels of a class that nobody knows."""

from pathlib import Path

import numpy as np
import pytest

from solver.effect import Fitted
from solver.load.load_effects import on_many_axles
from solver.load.wheel_layout import CLASSES, LAYOUTS, POINT, class_number, layout_of, not_known
from vision.contract import read_trajectories
from vision.contract.classes import plain_name
from vision.detectors.names import COCO, VEHICLES

HEAD = "time,track_id,class,x,y,sigma_x,sigma_y\n"


@pytest.mark.parametrize(
    ("written", "known"),
    [
        *[("Car", "car"), ("CAR", "car"), ("sedan", "car"), ("PassengerCar", "car"), ("lorry", "truck")],
        *[("private_van", "van"), ("delivery_van_with_trailer", "van"), ("truck_with_semitrailer", "truck")],
        *[("Motorbike", "motorcycle"), ("motorcyclist", "motorcycle"), ("cargo_bike_driver", "bicycle")],
        *[("Pedestrian", "person"), ("person", "person"), ("Tuk-tuk", "tuk tuk")],
    ],
)
def test_a_table_may_spell_a_class_its_own_way(written: str, known: str, tmp_path: Path) -> None:
    path = tmp_path / "tracks.csv"
    path.write_text(HEAD + f"2025-08-11T06:00:00Z,1,{written},2.5,0,.1,.1\n")
    assert read_trajectories([path])["class"].tolist() == [known]


def test_what_detectors_call_vehicles_has_wheels_that_are_known() -> None:
    road = {plain_name(name) for name in COCO} & {*VEHICLES, "person", "bicycle"}
    assert road == {"car", "bus", "truck", "motorcycle", "bicycle", "person"}
    assert not_known(sorted(road | set(VEHICLES))) == []


def test_wheels_of_a_class_that_is_not_known_may_be_any() -> None:
    strange, bus, light = layout_of("tuk tuk"), LAYOUTS["bus"], 2.0
    assert abs(bus.wheelbase - strange.wheelbase) < 2.5 * strange.wheelbase_sd
    assert abs(light - strange.wheelbase) < 1.5 * strange.wheelbase_sd
    assert CLASSES[class_number("tuk tuk")] == "unknown"
    assert layout_of("vehicle") is POINT and class_number("vehicle") == 0


def test_vehicles_of_a_class_that_is_not_known_may_start_as_long_ones() -> None:
    classes = ("car", "truck", "tram", "vehicle", "van", "bus")
    half, whole = on_many_axles(Fitted(np.arange(3.0), classes, np.ones(len(classes)), np.zeros((3, 3)), None))
    assert half.numbers[0].tolist() == [0, 0.5, 0.5, 0.5, 0, 0.5]
    assert whole.numbers[0].tolist() == [0, 1, 1, 1, 0, 1]
    assert on_many_axles(Fitted(np.arange(3.0), ("car", "van"), np.ones(2), np.zeros((3, 3)), None)) == []


def test_a_class_that_is_not_known_is_said_with_those_that_are() -> None:
    said = not_known(["car", "tuk tuk", "tuk tuk", "tram"])
    assert [line.partition(" is not known")[0] for line in said] == ["class tuk tuk (2 passes)", "class tram (1 pass)"]
    assert "Known are car, van, truck, bus, motorcycle, bicycle, unknown, vehicle, person" in said[0]
