"""Does a wheelbase that the camera measured beat the class's, on vehicles that the relation was not fitted to?

    python benchmarks/wheelbase.py --vehicles 24

Vehicles with the lengths of real ones drive through rendered scenes (`benchmarks/ground.py`: edges that jitter, and lie
off by the same few pixels for all of a vehicle). The length that is measured gives the wheelbase, by the straight line
through all other models of the makers' data sheets below. Prints, per view and class: error of the length and
error / sigma; error of the wheelbase by the length, its stated sigma, error / sigma; and the error of the class's
wheelbase, which the solver takes without a measured one.
"""

import argparse

import numpy as np
import pandas as pd
from ground import SIZE, VIEWS, drive

from vision.camera import Calibration
from vision.ground_track import ground_tracks
from vision.vehicles import SHAPES

# Length and wheelbase, mm, of what European roads are full of.
MODELS = {
    "car": """
        Golf 4284 2619, Polo 4074 2551, Tiguan 4509 2678, Passat 4873 2786, T-Roc 4234 2590, up! 3600 2420,
        Octavia 4689 2686, Fabia 4108 2552, Kodiaq 4697 2791, Superb 4869 2841, Corsa 4060 2538, Astra 4374 2675,
        Mokka 4151 2557, Fiesta 4068 2493, Focus 4382 2700, Kuga 4629 2710, Puma 4186 2588, Clio 4050 2583,
        Megane 4359 2669, Captur 4227 2639, 208 4055 2540, 308 4367 2675, 2008 4300 2605, 3008 4447 2675,
        5008 4641 2840, C3 3996 2540, Yaris 3940 2560, Corolla 4370 2640, RAV4 4600 2690, Aygo 3700 2430,
        500 3571 2300, Panda 3653 2300, 3-series 4709 2851, 1-series 4319 2670, X1 4500 2692, 5-series 4963 2975,
        A-class 4419 2729, C-class 4751 2865, E-class 4949 2961, GLC 4716 2888, A3 4343 2636, A4 4762 2820,
        A1 4029 2563, Q3 4484 2680, i20 4040 2580, i30 4340 2650, Tucson 4500 2680, Kona 4205 2600, Ceed 4310 2650,
        Sportage 4515 2680, Picanto 3595 2400, Sandero 4088 2604, Duster 4341 2657, XC40 4425 2702, XC60 4708 2865,
        Qashqai 4425 2665, Micra 3999 2525, Mazda3 4460 2725, CX-5 4575 2700, Swift 3840 2450, Model-3 4694 2875,
        Model-Y 4751 2890, Mini 3850 2495
    """,
    "van": """
        Sprinter-L1 5267 3250, Sprinter-L2 5932 3665, Sprinter-L3 6967 4325, Crafter-L3 5986 3640,
        Crafter-L4 6836 4490, Ducato-L1 4963 3000, Ducato-L2 5413 3450, Ducato-L3 5998 4035, Ducato-L4 6363 4035,
        Transit-L2 5531 3300, Transit-L3 5981 3750, Transit-L4 6704 3750, Transporter-L1 4904 3000,
        Transporter-L2 5304 3400, Vito-L1 4895 3200, Vito-L2 5140 3200, Vito-L3 5370 3430, Trafic-L1 5080 3098,
        Trafic-L2 5480 3498, Master-L1 5075 3182, Master-L2 5575 3682, Master-L3 6225 4332, Jumpy-M 4959 3275,
        Jumpy-XL 5309 3275
    """,
}
CLASS = {"car": 2.65, "van": 3.40}  # m, what the solver takes


def models(kind: str) -> np.ndarray:
    """Length and wheelbase of every model [model, 2], m."""
    return np.array([entry.split()[-2:] for entry in MODELS[kind].split(",")], float) / 1e3


def line(known: np.ndarray) -> tuple[float, float, float]:
    """Wheelbase at length 0, its slope, and the sd about the line, m, of models [model, 2]."""
    slope, start = np.polyfit(known[:, 0], known[:, 1], 1)
    return start, slope, float((known[:, 1] - start - slope * known[:, 0]).std(ddof=2))


def trial(view: str, kind: str, seed: int) -> dict[str, object] | None:
    """Measure one vehicle; None where it was not followed."""
    known, rng = models(kind), np.random.default_rng([seed, 29])
    which = int(rng.integers(len(known)))
    length, wheelbase = known[which]
    shape, camera = SHAPES[kind], VIEWS[view]
    size = [length, *rng.normal(shape.size[1:], shape.deviation[1:])]
    calibration = Calibration(image_size=SIZE, homography=camera.ground_homography())
    found, _ = ground_tracks(drive(camera, kind, rng, size), calibration)
    if found.empty:
        return None
    start, slope, spread = line(np.delete(known, which, axis=0))
    measured, sigma = found[["length", "sigma_length"]].iloc[0]
    error, stated = start + slope * measured - wheelbase, np.hypot(spread, slope * sigma)
    return {
        "view": view,
        "class": kind,
        "length": measured - length,
        "length / sigma": (measured - length) / sigma,
        "wheelbase": error,
        "sigma": stated,
        "wheelbase / sigma": error / stated,
        "by class": CLASS[kind] - wheelbase,
    }


def main() -> None:
    """Print the lines, and root mean squares over all vehicles of each view and class."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vehicles", type=int, default=24, help="of each class in each view")
    options = parser.parse_args()
    for kind in MODELS:
        start, slope, spread = line(models(kind))
        usual = start + slope * SHAPES[kind].size[0]
        print(f"{kind}: {usual:.3f} m at {SHAPES[kind].size[0]} m, {slope:.2f} m/m, sd {spread:.3f} m")
    trials = (trial(view, kind, seed) for view in VIEWS for kind in MODELS for seed in range(options.vehicles))
    table = pd.DataFrame([found for found in trials if found]).set_index(["view", "class"])
    print((table**2).groupby(level=[0, 1]).mean().pow(0.5).round(3).to_string())


if __name__ == "__main__":
    main()
