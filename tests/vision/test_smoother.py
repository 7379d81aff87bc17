import numpy as np
import pytest

from vision.smoother import BATCH, Motion, predict, smooth, transition


def drive(seed=0, frames=120, noise=0.2, missed=0.0, acceleration=0.0, correlation=0.0):
    """A vehicle at 10 m/s, its true places, and what is seen of it."""
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.choice([0.04, 0.08], frames))
    true = np.stack([10 * time + acceleration * time**2 / 2, 1.75 + 0.0 * time], axis=1)
    spread = noise**2 * np.array([[1.0, correlation], [correlation, 1.0]])
    seen = true + rng.multivariate_normal(np.zeros(2), spread, frames)
    gone = rng.random(frames) < missed
    gone[[0, -1]] = False
    seen[gone] = np.nan
    return Motion(time, seen, np.tile(spread, (frames, 1, 1))), true


def test_sigmas_are_honest_over_many_vehicles():
    tracks, true = zip(*(drive(seed, missed=0.2, acceleration=1.0) for seed in range(BATCH + 20)), strict=True)
    found = smooth(tracks)
    error = np.concatenate([f.position - t for f, t in zip(found, true, strict=True)])
    sigma = np.concatenate([np.sqrt(np.diagonal(f.covariance, axis1=1, axis2=2)) for f in found])
    assert np.sqrt((error**2).mean()) < 0.1, "half the noise"
    # The motion is steadier than the model allows for, so the errors stay somewhat below the sigmas.
    assert np.sqrt(((error / sigma) ** 2).mean(axis=0)) == pytest.approx([0.93, 0.93], abs=0.12)


def test_a_vehicle_that_moves_as_the_model_says_errs_as_it_says():
    rng, scores = np.random.default_rng(1), []
    for _ in range(60):
        state, step, places = np.array([0.0, 10.0, 0.0, 0.0, 0.5, 0.0]), np.array([0.08]), []
        for _ in range(60):
            mean, driven = predict(state[None], np.zeros((1, 6, 6)), step)
            state = rng.multivariate_normal(mean[0], driven[0])
            places.append(state[[0, 3]])
        true = np.array(places)
        seen = Motion(0.08 * np.arange(60), true + rng.normal(0, 0.3, (60, 2)), np.tile(0.09 * np.eye(2), (60, 1, 1)))
        (found,) = smooth([seen])
        error = found.position - true
        scores.append(np.einsum("ni,nij,nj->n", error, np.linalg.inv(found.covariance), error).mean() / 2)
    assert np.mean(scores) == pytest.approx(1.0, abs=0.12)


def test_it_is_the_least_squares_answer():
    """Filter and smoother give what solving for all states at once gives."""
    track, _ = drive(frames=12, missed=0.2, correlation=0.6)
    (found,) = smooth([track])
    count = 6 * 12
    prior = np.diag([1e-9, 1 / 30**2, 1 / 1.5**2] * 2)  # the first place is that of the first fix
    information, right = np.zeros((count, count)), np.zeros(count)
    information[:6, :6] += prior
    for k in range(12):
        rows = slice(6 * k, 6 * k + 6)
        if k:
            step = np.diff(track.time)[k - 1 : k]
            move = transition(step)[0]
            weight = np.linalg.inv(predict(np.zeros((1, 6)), np.zeros((1, 6, 6)), step)[1][0])
            both = np.hstack([-move, np.eye(6)])
            part = slice(6 * k - 6, 6 * k + 6)
            information[part, part] += both.T @ weight @ both
        if np.isfinite(track.position[k]).all():
            pick = np.eye(6)[[0, 3]]
            weight = np.linalg.inv(track.covariance[k])
            information[rows, rows] += pick.T @ weight @ pick
            right[rows] += pick.T @ weight @ track.position[k]
    mean = np.linalg.solve(information, right).reshape(12, 6)[:, [0, 3]]
    np.testing.assert_allclose(found.position, mean, atol=1e-4)
    spread = np.linalg.inv(information).reshape(12, 6, 12, 6)[np.arange(12), :, np.arange(12)]
    np.testing.assert_allclose(found.covariance, spread[:, [[0], [3]], [0, 3]], rtol=1e-3, atol=1e-7)


def test_gaps_are_bridged_with_a_larger_sigma():
    track, true = drive(frames=100, noise=0.1, acceleration=1.5)
    track.position[40:60] = np.nan
    (found,) = smooth([track])
    sigma = np.sqrt(found.covariance[:, 0, 0])
    assert sigma[50] > 1.5 * sigma[30] and np.abs(found.position - true)[50].max() < 3 * sigma[50]


def test_a_wrong_fix_pulls_little():
    track, true = drive(noise=0.1)
    track.position[60] += [0.0, 4.0]
    (found,) = smooth([track])
    assert np.abs(found.position - true)[55:65].max() < 0.35


def test_batches_and_lengths_do_not_matter():
    tracks = [drive(seed, frames=10 + seed)[0] for seed in range(BATCH + 5)]
    together = smooth(tracks)
    for row in (0, 7, BATCH + 4):
        (alone,) = smooth([tracks[row]])
        np.testing.assert_allclose(together[row].position, alone.position, atol=1e-9)
        np.testing.assert_allclose(together[row].covariance, alone.covariance, atol=1e-9)


def test_no_tracks():
    assert smooth([]) == []
