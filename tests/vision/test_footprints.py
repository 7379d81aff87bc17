import numpy as np
import pandas as pd
import pytest

from vision.footprints import ghosts


def drive(name, frames, x=0.0, y=0.0, speed=0.4, angle=0.0, size=(4.4, 1.8)):
    frames = np.asarray(frames)
    way = x + speed * frames
    place = {"x": way * np.cos(angle) - y * np.sin(angle), "y": way * np.sin(angle) + y * np.cos(angle)}
    return pd.DataFrame({"track_id": name, "frame": frames, **place, "length": size[0], "width": size[1]})


BUS = {"name": "bus", "frames": range(60), "size": (12.0, 2.5)}


@pytest.mark.parametrize("angle", [0.0, 0.7, np.pi])
def test_a_part_of_a_bus_is_not_a_vehicle(angle):
    part = drive("part", range(20, 30), x=4.5, y=-0.4, angle=angle)
    assert ghosts(pd.concat([drive(**BUS, angle=angle), part], ignore_index=True)) == {"part"}


@pytest.mark.parametrize("place", [{"x": 8.5}, {"y": 2.2}, {"x": -9.0, "y": 1.0}])
@pytest.mark.parametrize("angle", [0.0, 0.7])
def test_vehicles_beside_and_behind_are_vehicles(place, angle):
    other = drive("other", range(20, 30), **place, angle=angle)
    assert ghosts(pd.concat([drive(**BUS, angle=angle), other], ignore_index=True)) == set()


def test_one_that_is_only_met_is_a_vehicle():
    comes = drive("comes", range(20, 60), x=40.0, y=1.0, speed=-0.4)
    assert ghosts(pd.concat([drive(**BUS), comes], ignore_index=True)) == set()


def test_the_longer_followed_one_stays():
    first, second = drive("a", range(40)), drive("b", range(30))
    assert ghosts(pd.concat([second, first], ignore_index=True)) == {"b"}
    assert ghosts(first) == set()
