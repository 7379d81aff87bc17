"""The recursions of the hidden Markov model, against the sum over all of its sequences of states."""

from itertools import product

import numpy as np
import pytest

from solver.drive.recursions import Model, recursions

CHANNELS, WIDTH, ENDS, JOINS, LEAVES = 4, 3, 0.3, 0.2, 0.4


def test_posterior_is_that_of_all_sequences() -> None:
    rng = np.random.default_rng(5)
    even, odd = rng.uniform(0.05, 1.0, (2, CHANNELS, WIDTH))
    other, begins = rng.uniform(0.05, 1.0, CHANNELS), rng.uniform(0.1, 0.3, CHANNELS)
    low = np.array([0, 1, 1, 2])
    on, edge = rng.uniform(0.1, 1.0, (2, CHANNELS, 3))
    states = list(product(range(WIDTH), range(3)))

    def joint(sequence: tuple[tuple[int, int], ...]) -> float:
        value = 1.0
        for channel, (place, kind) in enumerate(sequence):
            value *= (even[channel, place], odd[channel, place], other[channel])[kind]
            begin = begins[channel]
            to = np.array([(1 - begin) * (1 - JOINS), begin, (1 - begin) * JOINS])
            if channel == 0:
                value *= to[kind] / WIDTH
                continue
            before, was = sequence[channel - 1]
            step = low[channel] + place - low[channel - 1] - before
            if was == 1 and kind == 1:
                value *= (1 - ENDS) * (step == 0)
                continue
            if not 0 <= step < 3:
                return 0.0
            if was == 1:
                value *= ENDS * (1 - JOINS if kind == 0 else JOINS)
            elif was == 2:
                value *= ((1 - begin) * LEAVES, begin, (1 - begin) * (1 - LEAVES))[kind]
            else:
                value *= to[kind]
            value *= (edge if 1 in (was, kind) else on)[channel, step]
        return value

    every = list(product(states, repeat=CHANNELS))
    weight = np.array([joint(one) for one in every])
    posterior = np.zeros((CHANNELS, WIDTH, 3))
    for sequence, value in zip(every, weight, strict=True):
        for channel, (place, kind) in enumerate(sequence):
            posterior[channel, place, kind] += value / weight.sum()
    run, model = recursions(), Model(even, odd, other, low, on, edge, begins, ENDS, JOINS, LEAVES)
    alpha = np.zeros((CHANNELS, WIDTH, 3))
    assert run.forward(model, alpha) == pytest.approx(np.log(weight.sum()))
    run.backward(model, alpha)
    np.testing.assert_allclose(alpha, posterior, atol=1e-12)


def test_followed_vehicle_is_summed_over_where_it_may_be() -> None:
    rng = np.random.default_rng(6)
    even, wide = rng.uniform(0.05, 1.0, (CHANNELS, WIDTH)), rng.uniform(0.1, 1.0, (CHANNELS, 3))
    low, other = np.array([0, 0, 1, 2]), np.zeros(CHANNELS)
    recursions().followed(even, low, wide, 0.1, other)
    there = np.full(WIDTH, 0.0)
    for channel in range(CHANNELS):
        moved = np.zeros(WIDTH)
        if channel:
            shift = low[channel] - low[channel - 1]
            for before, after in product(range(WIDTH), range(WIDTH)):
                if 0 <= shift + after - before < 3:
                    moved[after] += there[before] * wide[channel, shift + after - before]
        there = (0.9 * moved + 0.1 / WIDTH) * even[channel]
        assert other[channel] == pytest.approx(there.sum())
        there /= there.sum()


def test_decoded_path_has_the_largest_product_of_its_cells_own_probabilities() -> None:
    rng = np.random.default_rng(7)
    there, low, path = rng.uniform(0.05, 1.0, (CHANNELS, WIDTH)), np.array([0, 1, 1, 2]), np.zeros(CHANNELS, np.int64)
    recursions().decoded(there, low, 2, path)

    def probability(places: tuple[int, ...]) -> float:
        steps = np.diff(low + np.array(places))
        return float(there[np.arange(CHANNELS), places].prod()) * bool(((steps >= 0) & (steps < 2)).all())

    assert path.tolist() == (low + np.array(max(product(range(WIDTH), repeat=CHANNELS), key=probability))).tolist()
