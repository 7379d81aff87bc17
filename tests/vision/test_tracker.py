import numpy as np
import pytest

from tests.vision.test_camera import look
from vision.camera import Calibration
from vision.tracker import Tracker


def box(x, y, w=40.0, h=30.0):
    return [x - w / 2, y - h / 2, x + w / 2, y + h / 2]


def follow(frames, **options):
    """Track numbers of frames given as (time, boxes, scores)."""
    tracker = Tracker(**options)
    return [tracker.update(t, np.array(b, float).reshape(-1, 4), np.array(s, float)).tolist() for t, b, s in frames]


def test_two_that_cross_keep_their_numbers():
    frames = [(t, [box(100 + 120 * t, 100), box(400 - 120 * t, 108)], [0.9, 0.9]) for t in np.arange(0, 2.5, 0.04)]
    assert follow(frames) == [[1, 2]] * len(frames)


def test_numbers_belong_to_detections_in_any_order():
    frames = [(t, [box(100 + 50 * t, 100), box(300, 200), box(500, 50)], [0.9, 0.8, 0.7]) for t in np.arange(0, 1, 0.1)]
    turned = [(t, b[::-1] if k % 2 else b, s[::-1] if k % 2 else s) for k, (t, b, s) in enumerate(frames)]
    assert follow(turned) == [[3, 2, 1] if k % 2 else [1, 2, 3] for k in range(len(frames))]


@pytest.mark.parametrize(("gap", "same"), [(0.9, True), (1.3, False)])
def test_coasting(gap, same):
    seen = [t for t in np.arange(0, 4, 0.04) if not 1.0 < t < 1.0 + gap]
    numbers = follow([(t, [box(50 + 150 * t, 100)], [0.9]) for t in seen])
    assert (numbers[-1] == [1]) is same


def test_real_time_steps():
    # 40 px a step and more: boxes of successive frames share nothing, and the steps are uneven.
    times = np.cumsum(np.tile([0.079, 0.119, 0.079, 0.119, 0.781], 6))
    numbers = follow([(t, [box(500 * t, 100)], [0.9]) for t in times])
    assert numbers == [[1]] * len(times)


def test_weak_detections_continue_tracks_but_start_none():
    frames = [(0.04 * k, [box(100 + 4 * k, 100), box(400, 200)], [0.9 if k < 5 else 0.25, 0.3]) for k in range(40)]
    assert follow(frames) == [[1, 0]] * 40


def test_a_box_around_two_vehicles_takes_no_track_of_theirs():
    left, right, both = box(100, 100), box(142, 100), box(120, 100, 84, 32)
    apart, together = ([left, right], [0.9, 0.5]), ([both, left, right], [0.45, 0.35, 0.3])
    frames = [(0.2 * k, *(together if 10 <= k < 14 else apart)) for k in range(20)]
    numbers = follow(frames)
    assert [found[-2:] for found in numbers] == [[1, 2]] * 20


def test_a_box_of_another_size_is_another_vehicle():
    frames = [(0.0, [box(100, 100)], [0.9]), (0.04, [box(100, 100)], [0.9]), (0.08, [box(100, 100, 100, 80)], [0.9])]
    assert follow(frames)[-1] == [2]


@pytest.mark.parametrize(("fixes", "missed", "same"), [(1, 2, True), (1, 3, False), (4, 8, True), (4, 9, False)])
def test_what_is_seldom_seen_is_forgotten_sooner(fixes, missed, same):
    """A box around two vehicles that a detector draws now and then would be a track of fixes that are filled in."""
    seen = [True] * fixes + [False] * missed + [True]
    frames = [(0.033 * k, [box(100, 100)] if here else [], [0.9] if here else []) for k, here in enumerate(seen)]
    assert (follow(frames)[-1] == [1]) is same


def test_empty_frames():
    frames = [(0.0, [], []), (0.1, [box(100, 100)], [0.9]), (0.2, [], []), (0.3, [box(100, 100)], [0.9])]
    assert follow(frames) == [[], [1], [], [1]]


def test_time_must_increase():
    tracker = Tracker()
    tracker.update(1.0, np.zeros((0, 4)), np.zeros(0))
    with pytest.raises(ValueError, match="time must increase"):
        tracker.update(1.0, np.zeros((0, 4)), np.zeros(0))


def traffic(seed, vehicles=12, missed=0.15):
    """Frames of two lanes a direction with jitter and misses, and who each detection is."""
    rng = np.random.default_rng(seed)
    start, speed = rng.uniform(0, 25, vehicles), rng.uniform(80, 200, vehicles) * rng.choice([-1, 1], vehicles)
    lane = 60.0 + 90 * (np.arange(vehicles) % 4)
    frames, owners = [], []
    for t in np.cumsum(rng.choice([0.04, 0.08], 700)):
        x = np.where(speed > 0, speed * (t - start), 1200 + speed * (t - start))
        there = (x > 0) & (x < 1200) & (t > start) & (rng.random(vehicles) > missed)
        order = rng.permutation(np.flatnonzero(there))
        boxes = np.array([box(x[k], lane[k]) for k in order]).reshape(-1, 4)
        frames.append((t, boxes + rng.normal(0, 1.5, boxes.shape), rng.uniform(0.3, 0.95, len(order))))
        owners.append(order)
    return frames, owners


@pytest.mark.parametrize("seed", range(3))
def test_traffic_is_followed(seed):
    frames, owners = traffic(seed)
    numbers = follow(frames)
    pairs = {
        (int(o), n)
        for owner, number in zip(owners, numbers, strict=True)
        for o, n in zip(owner, number, strict=True)
        if n
    }
    tracks_of = [len({n for o, n in pairs if o == vehicle}) for vehicle in range(12)]
    vehicles_of = {n: len({o for o, m in pairs if m == n}) for _, n in pairs}
    assert max(vehicles_of.values()) <= 2 and np.mean(list(vehicles_of.values())) < 1.2, "switches"
    assert np.mean(tracks_of) < 1.3, "fragments"


def test_the_same_answer_every_time():
    frames, _ = traffic(7)
    assert follow(frames) == follow(frames)


def test_on_the_road_nothing_jumps():
    """A box that overlaps in the picture but is meters away on the road is another vehicle."""
    homography, matrix = look((-10, 6, -9), (25, 0, 0), 420, (640, 360))
    view = Calibration(image_size=(640, 360), homography=homography)

    def seen(x):
        corners = np.array([[x + a, b, c, 1] for a in (-2.2, 2.2) for b in (-0.9, 0.9) for c in (-1.5, 0)])
        pixels = corners @ matrix.T
        pixels = pixels[:, :2] / pixels[:, 2:]
        return np.concatenate([pixels.min(0), pixels.max(0)])

    steady = [(0.04 * k, [seen(60 + 0.4 * k)], [0.9]) for k in range(3)]
    jump = [*steady, (0.16, [seen(60 + 0.4 * 4 + 12)], [0.9])]
    assert follow(jump)[-1] == [1], "in the picture it may be the same"
    assert follow(jump, calibration=view)[-1] == [2]
    assert follow([*steady, (0.16, [seen(60 + 0.4 * 4 + 0.5)], [0.9])], calibration=view)[-1] == [1]


def test_above_the_horizon_only_the_picture_counts():
    homography, _ = look((-10, 6, -9), (25, 0, 0), 420, (640, 360))
    view = Calibration(image_size=(640, 360), homography=homography)
    frames = [(0.04 * k, [box(100 + 4 * k, 12, 20, 10)], [0.9]) for k in range(20)]
    assert follow(frames, calibration=view) == [[1]] * 20
