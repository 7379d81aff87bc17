"""Waves that vehicles radiate: found in a residual that loops made, and modeled as the far field of a ring wave."""

import numpy as np
import pytest
import torch

from solver.catalogue.catalogue import built_in
from solver.catalogue.trial_survey import Trial, columns, trial_survey
from solver.effect import Heard
from solver.ground.waves import loudest_waves, sent_from


@pytest.fixture(scope="module")
def heard() -> Heard:
    """Nothing but silence in the trial survey."""
    fit, state = trial_survey()
    one = Trial(built_in()["rayleigh_wave"], fit, state)
    values = one.extension.local(one.numbers())
    load = one.path.loads(columns(state.vehicles.rows(one.path.traffic)), values)
    fiber = one.fiber(values)
    silence = torch.zeros_like(fit.data)
    return Heard(
        silence, load, one.path.traffic.sample_index, (fiber.ahead + fiber.behind) / 2, fiber.ahead - fiber.behind
    )


def made_waves(heard: Heard, frequency: float, speed: float, size: float) -> torch.Tensor:
    """Waves [sample, channel] of every pass, each vehicle driven straight back to where it was when it sent them."""
    rng, driven = np.random.default_rng(4), heard.load.trajectory
    phases = rng.uniform(0, 2 * np.pi, 5)
    out = rng.normal(0, 1, heard.residual.shape)
    for row, sample in enumerate(heard.sample_index.tolist()):
        place, velocity = driven.position[row, 0].numpy(), driven.velocity[row, 0].numpy()
        time, phase = float(driven.time[row]), phases[int(driven.pass_index[row])]
        for channel, point in enumerate(heard.middle[:, :2].numpy()):
            delay = 0.0
            for _ in range(30):
                ray = point - (place - velocity * delay)
                delay = np.linalg.norm(ray) / speed
            tangent = heard.slope[channel, :2].numpy() / float(heard.slope[channel].norm())
            r = np.linalg.norm(ray)
            along = ray @ tangent / r
            out[sample, channel] += (
                size * np.sqrt(10 / r) * along**2 * np.cos(2 * np.pi * frequency * (time - delay) + phase)
            )
    return torch.from_numpy(out)


@pytest.mark.parametrize(("frequency", "speed"), [(3.3, 120.0), (7.9, 180.0), (11.6, 220.0)])
def test_a_wave_is_found_above_the_sampling_rate(heard, frequency, speed):
    residual = made_waves(heard, frequency, speed, 1.0)
    shapes, compared = loudest_waves(Heard(**(vars(heard) | {"residual": residual})))
    assert len(shapes) == 3 and compared > 100
    near = [s for s in shapes if abs(s["frequency"] - frequency) < 0.04 and s["speed"] == speed]
    assert near, shapes


def test_the_moving_source_is_where_it_was():
    rng = np.random.default_rng(2)
    for _ in range(20):
        ray, velocity, speed = rng.normal(0, 40, 2), rng.normal(0, 12, 2), rng.uniform(90, 250)
        distance = np.linalg.norm(ray)
        for _ in range(200):
            distance = np.linalg.norm(ray + velocity * distance / speed)
        now = torch.tensor(np.linalg.norm(ray))
        toward = torch.tensor(ray @ velocity) / now
        found = sent_from(now, toward, torch.tensor(np.linalg.norm(velocity)), speed)
        assert float(found) == pytest.approx(distance, rel=1e-9)


def test_the_effect_seeks_its_shapes(heard):
    wave = built_in()["rayleigh_wave"]
    shapes, compared = wave.tried(lambda: heard)
    assert compared > 100 and set(shapes[0]) == {"frequency", "speed"}
    bounds = wave.parameter("frequency")
    assert all(bounds.lower <= shape["frequency"] <= bounds.upper for shape in shapes)


def test_far_ground_moves_along_the_ray_as_the_wave_passes():
    """Radial motion r^-1/2 sin(w (t - r / c)) of a source at rest, with nothing across or down."""
    wave, surroundings = built_in()["rayleigh_wave"], Trial(built_in()["rayleigh_wave"], *trial_survey()).around
    numbers = {"sine": [[1.0]], "cosine": [[0.0]], "frequency": 5.0, "speed": 150.0}
    values = {name: torch.tensor(value, dtype=torch.float64) for name, value in numbers.items()}
    ground = wave.change(Trial(wave, *trial_survey()).given(), values, surroundings)
    r = torch.linspace(30, 90, 200, dtype=torch.float64)
    offset = torch.stack([0.6 * r, -0.8 * r, torch.ones_like(r)], -1)[None, :, None, :]
    slow = torch.tensor([1e-6, 0.0], dtype=torch.float64).expand(1, 200, 1, 2)
    motion = ground.radiation(offset, slow, torch.tensor([[[0.25]]], dtype=torch.float64))[0, :, 0]
    motion, r = motion.numpy(), r.numpy()
    radial = 0.6 * motion[:, 0] - 0.8 * motion[:, 1]
    np.testing.assert_allclose(motion[:, :2], radial[:, None] * [0.6, -0.8], rtol=1e-9)
    assert not motion[:, 2].any()
    expected = np.sqrt(10 / r) * np.sin(2 * np.pi * 5.0 * (0.25 - r / 150.0))
    assert np.corrcoef(radial, expected)[0, 1] > 0.999
    steady = float((radial @ expected) / (expected @ expected))
    strain = np.gradient(steady * expected, r)
    assert np.abs(strain[:40]).max() / 1e-6 * 7.5**3 == pytest.approx(np.sqrt(10 / 33), rel=0.1)
