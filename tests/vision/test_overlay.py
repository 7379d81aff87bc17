"""What is drawn over a picture: read back from its pixels."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from vision.overlay import COLORS, Drawn, draw, lighter

BOX = np.array([100.0, 80, 180, 140])


def vehicle(box=BOX, detected=(True, True), color=COLORS[0], words="12 car 8.9 m/s"):
    tail = np.array([[20.0, 200.0], [(box[0] + box[2]) / 2, box[3]]])
    return Drawn(box, words, color, np.array(detected), tail)


def count(image, color):
    return int((np.abs(image.astype(int) - color).max(axis=2) <= 2).sum())


@pytest.mark.parametrize("ground", [0, 128, 255])
def test_marks_stand_out_on_every_ground(ground):
    image = np.full((360, 640, 3), ground, np.uint8)
    drawn = draw(image, [vehicle()])
    assert (image == ground).all(), "the picture given stays as it is"
    assert count(drawn, COLORS[0]) > 500
    assert (drawn.max(axis=2) < 60).sum() > 400, "a dark edge"


def test_what_was_not_detected_is_dashed_and_lighter():
    image = np.zeros((360, 640, 3), np.uint8)
    seen, guessed = (draw(image, [vehicle(detected=(True, now), words="")]) for now in (True, False))
    assert count(seen, lighter(COLORS[0])) == 0 < count(seen, COLORS[0])
    assert count(guessed, COLORS[0]) == 0 < count(guessed, lighter(COLORS[0]))
    left = slice(int(BOX[1]) + 4, int(BOX[3]) - 4), slice(int(BOX[0]) - 1, int(BOX[0]) + 2)
    lit = [draw_[left].any(axis=(1, 2)).mean() for draw_ in (seen, guessed)]
    assert lit[0] == 1 and 0.3 < lit[1] < 0.9


def test_the_fix_is_ringed_with_a_cross_of_its_sigmas():
    arms = np.array([[[140.0, 140], [140, 140]], [[80, 140], [200, 140]]])  # x is sure, y is not
    bare, marked = (draw(np.zeros((360, 640, 3), np.uint8), [replace(vehicle(), fix=fix)]) for fix in (None, arms))
    white = np.argwhere((marked == 255).all(axis=2) & (bare != 255).any(axis=2))
    assert np.ptp(white[:, 1]) >= 120 > 20 > np.ptp(white[:, 0]) > 6, "height of the ring, width of the cross"


def test_words_do_not_cover_one_another(monkeypatch):
    places, write = [], cv2.rectangle
    monkeypatch.setattr(cv2, "rectangle", lambda canvas, *rest: places.append(rest[:2]) or write(canvas, *rest))
    draw(np.zeros((360, 640, 3), np.uint8), [vehicle(BOX + shift) for shift in (0, 5, 10)])
    spots = [first + last for first, last in places[::2]]
    assert len(set(spots)) == 3
    for number, (left, top, right, bottom) in enumerate(spots):
        for a, b, c, d in spots[:number]:
            assert right <= a or c <= left or bottom <= b or d <= top


@pytest.mark.parametrize("box", [[-20.0, -10, 30, 20], [600.0, 0, 700, 50], [300.0, 350, 400, 400]])
def test_words_stay_inside_the_picture(box, monkeypatch):
    places, write = [], cv2.rectangle
    monkeypatch.setattr(cv2, "rectangle", lambda canvas, *rest: places.append(rest[:2]) or write(canvas, *rest))
    draw(np.zeros((360, 640, 3), np.uint8), [vehicle(np.array(box))])
    (left, top), (right, bottom) = places[0]
    assert 0 <= left < right <= 640 and 0 <= top < bottom <= 360
