import numpy as np
import pytest
from scipy.linalg import expm

from solver.trajectory.kalman import (
    GATE,
    MANEUVER,
    Fixes,
    between,
    beyond,
    first_guess,
    likelihood,
    predicted,
    process_noise,
    smooth,
    transition,
)

MEMORY = 0.3
DRIFT = np.zeros((4, 4))
DRIFT[0, 1] = DRIFT[1, 2] = 1.0
DRIFT[2, 2], DRIFT[3, 3] = -1 / MANEUVER, -1 / MEMORY


@pytest.mark.parametrize("step", [1e-3, 0.08, 0.2, 3.0])
def test_transition_solves_the_motion(step):
    assert np.allclose(transition(np.array(step), np.array(MEMORY)), expm(DRIFT * step), atol=1e-12)


@pytest.mark.parametrize("step", [0.02, 0.2, 3.0])
def test_process_noise_integrates_the_motion(step):
    # Van Loan 1978: the integral of exp(A t) Q exp(A' t) from one matrix exponential.
    spectrum = np.diag([0.0, 0.0, 2 * 0.7**2 / MANEUVER, 2 / MEMORY])
    both = expm(np.block([[-DRIFT, spectrum], [np.zeros((4, 4)), DRIFT.T]]) * step)
    noise = process_noise(np.array(step), np.array(0.7), np.array(MEMORY))
    assert np.allclose(noise, both[4:, 4:].T @ both[:4, 4:], rtol=1e-6, atol=1e-13)


def test_two_steps_are_one():
    state, spread = np.arange(1.0, 5.0), np.diag([1.0, 2.0, 0.1, 1.0])
    args = (np.array(0.5), np.array(MEMORY))
    twice = predicted(*predicted(state, spread, np.array(0.3), *args), np.array(0.4), *args)
    once = predicted(state, spread, np.array(0.7), *args)
    assert np.allclose(twice[0], once[0])
    assert np.allclose(twice[1], once[1])


def dense_posterior(fixes, acceleration, memory, at):
    """Mean and covariance of the position of track 0, axis 0 at `at` by plain Gaussian conditioning; log-likelihood."""
    time, value, sigma = fixes.time[0], fixes.value[0, :, 0], fixes.sigma[0, :, 0]
    nodes = np.unique(np.concatenate([time, at]))
    prior = np.diag([*fixes.prior_sigma[0, 0] ** 2, acceleration**2, 1.0])
    mean, blocks = [np.array([*fixes.prior[0, 0], 0.0, 0.0])], [[prior]]
    for index in range(1, len(nodes)):
        step = np.array(nodes[index] - nodes[index - 1])
        move = transition(step, np.array(memory))
        mean.append(move @ mean[-1])
        row = [move @ block for block in blocks[-1]]
        last = move @ blocks[-1][-1] @ move.T + process_noise(step, np.array(acceleration), np.array(memory))
        blocks.append([*row, last])
    covariance = np.block(
        [
            [blocks[max(i, j)][min(i, j)] if i >= j else blocks[j][i].T for j in range(len(nodes))]
            for i in range(len(nodes))
        ]
    )
    look = np.zeros((len(time), 4 * len(nodes)))
    for row, (moment, spread) in enumerate(zip(time, sigma, strict=True)):
        column = 4 * int(np.searchsorted(nodes, moment))
        look[row, [column, column + 3]] = 1.0, spread
    middle = np.concatenate(mean)
    gap, joint = value - look @ middle, look @ covariance @ look.T
    gain = covariance @ look.T @ np.linalg.inv(joint)
    likelihood = -(gap @ np.linalg.solve(joint, gap) + np.linalg.slogdet(joint)[1]) / 2
    places = 4 * np.searchsorted(nodes, at)
    spread = covariance - gain @ look @ covariance
    return (middle + gain @ gap)[places], np.sqrt(np.diag(spread)[places]), likelihood


@pytest.fixture
def fixes():
    rng = np.random.default_rng(3)
    time = np.cumsum(rng.uniform(0.03, 0.4, 12))
    value = 10 * time + 0.1 * rng.normal(size=12)
    sigma = rng.uniform(0.05, 0.2, 12)
    padded = [np.concatenate([part, np.repeat(part[-1:], 5)])[None] for part in (time, value, sigma)]
    return Fixes(
        time=padded[0],
        value=padded[1][..., None],
        sigma=padded[2][..., None],
        valid=np.arange(17)[None] < 12,
        prior=np.array([[[value[0], 9.0]]]),
        prior_sigma=np.array([[[2.0, 3.0]]]),
    )


def test_smoother_is_gaussian_conditioning(fixes):
    acceleration, memory = np.array([[0.8]]), np.array([[MEMORY]])
    smoothed, time = smooth(fixes, acceleration, memory), fixes.time[0, :12]
    inside = np.linspace(time[0], time[-1], 40)
    outside = time[-1] + np.array([0.5, 2.0])
    part = Fixes(
        *(getattr(fixes, name)[:, :12] for name in ("time", "value", "sigma", "valid")), fixes.prior, fixes.prior_sigma
    )
    expected = dense_posterior(part, 0.8, MEMORY, np.concatenate([inside, outside]))
    mean, spread = between(smoothed, 0, time, inside, acceleration[0], memory[0])
    after = beyond(smoothed.mean[11, 0], smoothed.covariance[11, 0], outside - time[-1], acceleration[0], memory[0])
    assert np.allclose(np.concatenate([mean, after[0]])[:, 0, 0], expected[0], atol=1e-7)
    assert np.allclose(np.sqrt(np.concatenate([spread, after[1]])[:, 0, 0, 0]), expected[1], rtol=1e-5)
    assert likelihood(fixes, acceleration, memory)[0, 0] == pytest.approx(expected[2], abs=1e-6)


def test_backwards_is_forwards_reversed():
    state, spread = np.array([[5.0, 2.0, 0.3, 0.1]]), np.diag([0.1, 0.2, 0.3, 1.0])[None]
    spread[0, 0, 1] = spread[0, 1, 0] = 0.05
    mirror = np.array([1.0, -1.0, 1.0, 1.0])
    settings = (np.array([0.5]), np.array([MEMORY]))
    back = beyond(state, spread, np.array([-1.5]), *settings)
    ahead = beyond(mirror * state, mirror[:, None] * spread * mirror, np.array([1.5]), *settings)
    assert np.allclose(back[0], mirror * ahead[0])
    assert np.allclose(back[1], mirror[:, None] * ahead[1] * mirror)
    assert back[0][0, 0, 0] < 5.0


def test_first_guess_survives_wrong_fixes():
    time = np.arange(9) * 0.08
    value = (12 * time - 3)[:, None] + np.zeros(2)
    value[[0, 5]] += 40.0
    guess, spread = first_guess(time, value, np.full((9, 2), 0.06))
    assert np.allclose(guess, [[-3.0, 12.0]] * 2, atol=0.3)
    assert (spread > [0.5, 0.5]).all()


def test_a_first_guess_adds_little_to_what_the_fixes_say():
    """Of nine fixes within a fifth of a second: place and speed guessed scatter by far less than is allowed for."""
    time, rng = np.linspace(0.0, 0.2, 9), np.random.default_rng(4)
    sigma = np.full((9, 1), 0.5)
    guesses = [first_guess(time, 12 * time[:, None] + sigma * rng.normal(size=(9, 1)), sigma)[0] for _ in range(200)]
    spread = first_guess(time, 12 * time[:, None], sigma)[1][0]
    assert (spread > 6 * np.std(guesses, axis=0)[0]).all()


@pytest.mark.parametrize("off", [0.9 * GATE, 3.0 * GATE])
def test_a_fix_beyond_the_gate_counts_as_one_at_the_gate_with_a_wider_sigma(off):
    """The likelihood of one fix is Gaussian; beyond the gate, of the variance that puts it at the gate."""
    variance = 2.0**2 + 0.1**2  # of the first guess and of the fix
    innovation = off * variance**0.5
    one = Fixes(
        time=np.zeros((1, 1)),
        value=np.full((1, 1, 1), innovation),
        sigma=np.full((1, 1, 1), 0.1),
        valid=np.ones((1, 1), bool),
        prior=np.zeros((1, 1, 2)),
        prior_sigma=np.array([[[2.0, 3.0]]]),
    )
    wide = max(variance, innovation**2 / GATE**2)
    wanted = -(np.log(wide) + innovation**2 / wide) / 2
    settings = np.array([[0.8]]), np.array([[MEMORY]])
    assert likelihood(one, *settings)[0, 0] == pytest.approx(wanted)
    assert smooth(one, *settings).mean[0, 0, 0, 0] == pytest.approx(innovation * 2.0**2 / wide)
