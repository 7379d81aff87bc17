"""How often calibrations of random cameras with distortion are within their own stated sigma.

Run `python benchmarks/calibration.py [CAMERAS]`: prints the rates beside those that Gaussian errors would have.
`python benchmarks/calibration.py few [CAMERAS]` does so for 4 to 8 points.
`python benchmarks/calibration.py places [CAMERAS]` for places in error, of which the file does not say how far.
"""

import sys
from dataclasses import dataclass, field, replace

import numpy as np

from calib.control_points import MAP_SIGMA, PLACE_SIGMA, ControlPoints, control_points
from calib.ground import GroundFit, fit_ground
from vision.contract import InputError, progress
from vision.lens import Lens
from vision.scene.camera import Camera

SIZE = (1280, 720)
CLICK = 1.0  # px
PLACES = 10  # where each calibration is judged
ELLIPSE_95 = 5.991  # chi^2 of two degrees of freedom


@dataclass
class Rates:
    """Counts over all cameras."""

    cameras: int = 0
    chosen: int = 0
    refused: int = 0
    distances: list[float] = field(default_factory=list)
    by_coordinate: list[float] = field(default_factory=list)
    left_out: list[float] = field(default_factory=list)
    deviations: dict[str, list[float]] = field(default_factory=dict)

    @property
    def positions(self) -> int:
        return len(self.distances)

    @property
    def one_sigma(self) -> float:
        return float(np.mean(np.array(self.distances) < 1))

    @property
    def ninety_five(self) -> float:
        return float(np.mean(np.array(self.distances) < ELLIPSE_95))

    @property
    def two_sigma(self) -> float:
        return float(np.mean(np.array(self.by_coordinate) < 2))

    @property
    def left_out_two_sigma(self) -> float:
        return float(np.mean(np.array(self.left_out) < 2)) if self.left_out else np.nan

    @property
    def chance(self) -> float:
        """Half of the 95 % interval of `ninety_five`: places of one camera err together, so cameras are what counts."""
        by_camera = (np.array(self.distances).reshape(-1, PLACES) < ELLIPSE_95).mean(axis=1)
        return float(1.96 * by_camera.std(ddof=1) / np.sqrt(len(by_camera)))


def random_camera(rng: np.random.Generator) -> tuple[Camera, Lens]:
    """A street camera on a pole or house: 4 to 15 m high, 40 to 95 degrees wide, with barrel or pincushion."""
    focal = SIZE[0] / 2 / np.tan(np.deg2rad(rng.uniform(40, 95)) / 2)
    k1 = rng.uniform(-0.3, 0.1)
    lens = Lens(
        focal=(focal, focal),
        center=(SIZE[0] / 2 + rng.normal(0, 8), SIZE[1] / 2 + rng.normal(0, 8)),
        distortion=(k1, -0.3 * k1 + rng.normal(0, 0.02), 0, 0, 0),
    )
    side = rng.choice([-1, 1])
    position = (float(rng.uniform(-10, 0)), float(side * rng.uniform(4, 15)), -float(rng.uniform(4, 15)))
    yaw, pitch = -side * rng.uniform(10, 60), rng.uniform(12, 35)
    return Camera(position, float(yaw), float(pitch), float(focal), SIZE, roll=float(rng.normal(0, 2))), lens


def see(camera: Camera, lens: Lens, ground: np.ndarray) -> np.ndarray:
    """Pixels [n, 2] of the ground [n, 2]; NaN outside the picture."""
    seen = camera.in_camera(np.column_stack([ground, np.zeros(len(ground))]))
    ideal = seen[:, :2] / np.where(seen[:, 2:] > 1, seen[:, 2:], np.nan) * lens.focal + lens.center
    pixels = lens.distort(ideal)
    inside = ((pixels > 0) & (pixels < SIZE)).all(axis=1)
    return np.where(inside[:, None], pixels, np.nan)


def survey(
    rng: np.random.Generator, counts: tuple[int, int] = (8, 20), click: float = CLICK
) -> tuple[Camera, Lens, ControlPoints, np.ndarray]:
    """A camera, some marks on its road, read to `click` px and said to be read to `CLICK`, and `PLACES` between them.

    Few marks are as they come, at random; the places are in the rectangle around them.
    """
    while True:
        camera, lens = random_camera(rng)
        ground = rng.uniform([-5, -10], [70, 10], (400, 2))
        ground = ground[np.isfinite(see(camera, lens, ground)).all(axis=1)]
        count = int(rng.integers(counts[0], counts[1] + 1))
        spread = ground[: max(count, 30) if count >= 8 else count]
        if len(ground) < 60 or np.ptp(spread[:, 0]) < 15 or np.ptp(spread[:, 1]) < 6:
            continue
        low, high = (ground[:count].min(axis=0), ground[:count].max(axis=0)) if count < 8 else (-np.inf, np.inf)
        between = ground[count:][((ground[count:] >= low) & (ground[count:] <= high)).all(axis=1)]
        pixels = see(camera, lens, ground[:count]) + click * rng.normal(size=(count, 2))
        if len(between) >= PLACES and ((pixels > 0) & (pixels < SIZE)).all():
            marks = control_points(tuple(f"p{k}" for k in range(count)), pixels, ground[:count], CLICK)
            return camera, lens, marks, between[-PLACES:]


def judge(rates: Rates, camera: Camera, lens: Lens, fit: GroundFit, ground: np.ndarray) -> None:
    """Count how far positions and parameters are from the truth, in their own sigmas."""
    pixels = see(camera, lens, ground)
    off = fit.calibration.to_ground(pixels) - ground
    covariance = fit.calibration.position_covariance(pixels)
    rates.by_coordinate += (np.abs(off) / np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))).ravel().tolist()
    rates.left_out += [
        error / sigma
        for error, sigma in zip(
            fit.calibration.leave_one_out_m or (), fit.calibration.leave_one_out_sigma_m or (), strict=True
        )
        if error is not None and sigma is not None
    ]
    rates.distances += np.einsum("ni,nij,nj->n", off, np.linalg.inv(covariance), off).tolist()
    x, y, z = camera.position
    truth = {"focal": lens.focal[0], "k1": lens.distortion[0], "x": x, "y": y, "height": -z, "tilt": camera.pitch}
    for name, value in truth.items():
        found = fit.calibration.parameters.get(name)
        if found is not None:
            rates.deviations.setdefault(name, []).append((found.value - value) / found.sigma)


def trial_rates(
    cameras: int,
    seed: int = 0,
    counts: tuple[int, int] = (8, 20),
    click: float = CLICK,
    off: float = 0.0,
    sigma_xy: float = 0.0,
) -> Rates:
    """Calibrate random cameras from marks read to `click` px and said to be read to 1 px.

    And measured to `off` m, said to be measured to `sigma_xy` m.
    """
    rng, rates = np.random.default_rng(seed), Rates()
    with progress("calibrating random cameras", cameras) as advance:
        for _ in range(cameras):
            camera, lens, marks, ground = survey(rng, counts, click)
            if off or sigma_xy:
                places = marks.ground + off * rng.normal(size=marks.ground.shape)
                marks = replace(marks, ground=places, sigma_xy=np.full(len(marks), sigma_xy))
            rates.cameras += 1
            advance(1)
            try:
                fit = fit_ground(marks, SIZE)
            except InputError:
                rates.refused += 1
                continue
            rates.chosen += fit.calibration.model == "camera"
            judge(rates, camera, lens, fit, ground)
    return rates


def few() -> None:
    """Print the rates of 4 to 8 points, read as well as stated and half as well."""
    for click in (CLICK, 2 * CLICK):
        for count in range(4, 9):
            rates = trial_rates(int(sys.argv[2]) if len(sys.argv) > 2 else 100, count, (count, count), click)
            print(
                f"{count} points read to {click:g} px: {rates.two_sigma:.1%} of coordinates within two sigma, "
                f"{rates.ninety_five:.1%} ± {rates.chance:.1%} inside the 95 % ellipse, "
                f"{rates.left_out_two_sigma:.1%} of leave-one-out errors within two of their sigmas; "
                f"{rates.chosen} cameras, {rates.refused} refused",
                flush=True,
            )


def places() -> None:
    """Print the rates of places in error, said to be exact and with what is assumed where a file does not say."""
    for off in (0.0, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 1.0):
        for sigma_xy in (0.0, PLACE_SIGMA, MAP_SIGMA):
            rates = trial_rates(int(sys.argv[2]) if len(sys.argv) > 2 else 100, off=off, sigma_xy=sigma_xy)
            print(
                f"places off by {off:g} m, said to be by {sigma_xy:g}: {rates.ninety_five:.1%} ± {rates.chance:.1%} "
                f"inside the 95 % ellipse, {rates.left_out_two_sigma:.1%} of leave-one-out errors within two of their "
                f"sigmas; {rates.refused} of {rates.cameras} refused",
                flush=True,
            )


def main() -> None:
    if sys.argv[1:2] == ["places"]:
        places()
        return
    if sys.argv[1:2] == ["few"]:
        few()
        return
    rates = trial_rates(int(sys.argv[1]) if len(sys.argv) > 1 else 200)
    print(f"{rates.cameras} cameras: {rates.chosen} fitted as camera, {rates.refused} refused, the rest as homography")
    print(f"positions: {rates.one_sigma:.1%} inside one sigma's ellipse (Gaussian 39.3 %)")
    print(f"           {rates.ninety_five:.1%} ± {rates.chance:.1%} inside the 95 % ellipse")
    for name, deviations in rates.deviations.items():
        within = np.abs(deviations)
        print(f"{name:8} {np.mean(within < 1):.1%} within one sigma (68.3 %), {np.mean(within < 1.96):.1%} (95 %)")


if __name__ == "__main__":
    main()
