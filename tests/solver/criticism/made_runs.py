"""Runs whose residual is noise plus one known cause; no fit, so nothing is absorbed."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from solver.fit.result import FitResult
from solver.noise.law import NoiseLaw
from solver.run.run import Run
from solver.trajectory.vehicle_pass import Pass
from vision.contract import LocalFrame

RATE, SPACING, FIRST, CHANNELS = 10.0, 1.0, 100, 90
NOISE = 2e-9
CLASSES = ("car", "van", "car", "truck", "van", "car")


def along(one: Pass, row_time: np.ndarray, shift: float = 0.0) -> np.ndarray:
    """x of a vehicle at times since its own start, `shift` seconds ago."""
    return one.position[0, 0] + one.velocity[0, 0] * (row_time - shift)


def wave(one: Pass, row_time: np.ndarray, x: np.ndarray, late: float = 0.0, width: float = 7.0) -> np.ndarray:
    """Strain rate [row, channel] of a pass, antisymmetric about the vehicle, up to 40 noise sigmas for a car."""
    ahead = (x - along(one, row_time, late)[:, None]) * np.sign(one.velocity[0, 0])
    size = {"car": 40.0, "van": 60.0, "truck": 90.0}[one.vehicle_class]
    return -size * NOISE * (ahead / width) * np.exp(0.5 - 0.5 * (ahead / width) ** 2)


def made_passes(count: int) -> list[Pass]:
    """Vehicles one after the other, to and fro in two lanes, at 9 to 15 m/s."""
    passes, first = [], 20
    for number in range(count):
        speed = (9.0 + 1.5 * (number % 5)) * (1 if number % 2 == 0 else -1)
        rows = int(150 / abs(speed) * RATE)
        t = np.arange(rows) / RATE
        x = (-30.0 if speed > 0 else 120.0) + speed * t
        y = np.full(rows, 0.0 if speed > 0 else -3.5)
        passes.append(
            Pass(
                str(number + 1),
                CLASSES[number % len(CLASSES)],
                np.arange(first, first + rows),
                np.stack([x, y], 1),
                np.tile([speed, 0.0], (rows, 1)),
                np.full((rows, 2), 0.05),
                np.ones(rows, bool),
            )
        )
        first += rows + 15
    return passes


def made_noise(rng: np.random.Generator, samples: int, channels: int, memory: float, common: float) -> np.ndarray:
    """Noise of unit variance [sample, channel]: first-order autoregressive, and a share in common."""
    white = rng.normal(size=(samples, channels))
    own = white.copy()
    for row in range(1, samples):
        own[row] = memory * own[row - 1] + np.sqrt(1 - memory**2) * white[row]
    return np.sqrt(1 - common) * own + np.sqrt(common) * rng.normal(size=(samples, 1))


@dataclass
class Maker:
    """Settings of a run; `change` maps (model [sample, channel], maker, passes) to what was measured but for noise."""

    seed: int = 0
    passes: int = 4
    memory: float = 0.4
    common: float = 0.05
    change: Callable[[np.ndarray, list[Pass]], np.ndarray] = field(default=lambda model, passes: model)
    faded: tuple[int, ...] = ()
    gap: slice | None = None

    def run(self) -> Run:
        """Make the run."""
        passes = made_passes(self.passes)
        samples = np.arange(passes[-1].rows[-1] + 15)
        index = np.setdiff1d(np.arange(CHANNELS), self.faded)
        x = np.arange(CHANNELS) * SPACING
        model = np.zeros((len(samples), CHANNELS))
        for one in passes:
            model[one.rows] += wave(one, np.arange(len(one.rows)) / RATE, x)
        rng = np.random.default_rng(self.seed)
        noise = NOISE * made_noise(rng, len(samples), CHANNELS, self.memory, self.common)
        measured = self.change(model.copy(), passes) + noise
        if self.gap is not None:
            measured[self.gap] = np.nan
        law = NoiseLaw(
            (1 - self.common) * self.memory ** np.arange(21.0),
            self.common * (np.arange(21) == 0),
            np.ones(1),
        )
        route = np.stack([x, np.full(CHANNELS, 4.0), np.ones(CHANNELS)], 1)
        weight = np.isfinite(measured).astype(float)
        result = FitResult(
            method="spline",
            channel=FIRST + np.arange(CHANNELS),
            distance=(FIRST + np.arange(CHANNELS)) * SPACING,
            route=route,
            covariance=np.tile(np.diag([0.01, 0.0025, 0.0016]), (CHANNELS, 1, 1)),
            tails=np.zeros((CHANNELS, 3, 3)),
            constrained=np.ones(CHANNELS, bool),
            data_share=np.ones((CHANNELS, 3)),
            parameters={},
            vector=np.zeros(3),
            samples=samples,
            fitted_channel=FIRST + index,
            measured=measured[:, index],
            model=model[:, index],
            noise=np.full(len(index), NOISE),
            weight=weight[:, index],
            law=law,
            chi2=1.0,
            chi2_per_dof=1.0,
            cost=1.0,
            ambiguous_side=False,
            iterations=1,
            seconds=0.1,
            converged=True,
        )
        settings = {"gauge_length": 10.0, "channel_spacing": SPACING, "sampling_rate": RATE}
        facts = {
            "name": "Elm <Street>",
            "effects": ["wheel_layout"],
            "chi2_per_dof": 1.0,
            "noise_floor": None,
            "trust": {"sentence": "No check failed: converged.", "grade": "good", "gates": []},
            "settings": settings,
            "versions": {"roadfiber": "0.1.0"},
            "created": "2026-01-01T00:00:00Z",
        }
        start = np.datetime64("2025-08-11T06:00:00", "ns")
        frame = LocalFrame((32.113, 34.804), 78.0)
        return Run(result, frame, start, samples / RATE, passes, [], facts, problem=None)


def gain(channels: slice, factor: float) -> Callable:
    """Some channels sense more or less."""

    def change(model, passes):
        model[:, channels] *= factor
        return model

    return change


def late(number: int, seconds: float) -> Callable:
    """One pass comes late."""

    def change(model, passes):
        one = passes[number]
        x = np.arange(CHANNELS) * SPACING
        model[one.rows] = wave(one, np.arange(len(one.rows)) / RATE, x, seconds)
        return model

    return change


def moved(channels: slice, meters: float) -> Callable:
    """Some channels lie elsewhere than thought: they sense what lower ones should."""

    def change(model, passes):
        x = np.arange(CHANNELS) * SPACING
        for one in passes:
            shifted = wave(one, np.arange(len(one.rows)) / RATE, x - meters)
            model[one.rows, channels] = shifted[:, channels]
        return model

    return change


def wider(width: float) -> Callable:
    """The response is wider or narrower than modeled, for every vehicle."""

    def change(model, passes):
        x = np.arange(CHANNELS) * SPACING
        for one in passes:
            model[one.rows] = wave(one, np.arange(len(one.rows)) / RATE, x, width=width)
        return model

    return change


def ghost(first: int, speed: float) -> Callable:
    """A vehicle that is in no trajectory, from sample `first` on."""

    def change(model, passes):
        t = np.arange(len(model) - first) / RATE
        ahead = np.arange(CHANNELS) * SPACING - (speed * t)[:, None]
        model[first:] += -12 * NOISE * (ahead / 7.0) * np.exp(0.5 - 0.5 * (ahead / 7.0) ** 2)
        return model

    return change
