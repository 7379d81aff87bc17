import numpy as np

from vision.boxes import area, overlap, suppress


def test_overlap_against_counting_pixels():
    rng = np.random.default_rng(0)
    low = rng.integers(0, 20, (6, 2))
    boxes = np.concatenate([low, low + rng.integers(1, 15, (6, 2))], axis=1).astype(float)
    y, x = np.mgrid[:40, :40] + 0.5
    masks = [(x > b[0]) & (x < b[2]) & (y > b[1]) & (y < b[3]) for b in boxes]
    counted = [[(m & n).sum() / (m | n).sum() for n in masks] for m in masks]
    np.testing.assert_allclose(overlap(boxes, boxes), counted, atol=1e-12)
    np.testing.assert_allclose(area(boxes), [m.sum() for m in masks])


def test_nothing_overlaps_an_empty_box():
    assert overlap(np.array([[3.0, 3, 3, 3]]), np.array([[0.0, 0, 9, 9]])).item() == 0


def test_suppression_is_greedy_and_stable():
    boxes = np.array([[0, 0, 10, 10], [0, 0, 10, 9], [0, 6, 10, 16], [40, 0, 50, 10.0]])
    assert suppress(boxes, np.array([0.9, 0.9, 0.8, 0.95])).tolist() == [3, 0, 2]
    assert suppress(np.zeros((0, 4)), np.zeros(0)).tolist() == []
