"""Ground stage: soil that is not a homogeneous elastic half-space at rest."""

from collections.abc import Mapping

import numpy as np
import torch
from torch import Tensor

from solver.effect import Fitted, Parameter, Plain, Setting, Start, Surroundings, effect, grown, percent
from solver.ground.correction import Corrected
from solver.ground.gibson import stiffening
from solver.ground.ground import Ground
from solver.ground.layered import layered, paved
from solver.ground.moving import Moving
from solver.ground.radiated import Radiated
from solver.ground.waves import loudest_waves

Values = Mapping[str, Tensor]


def shear_speed(slowness_squared: float, setting: Setting) -> float:
    """Speed of shear waves, m/s."""
    return float("inf") if slowness_squared <= 0 else float(slowness_squared**-0.5)


@effect(
    "poisson_ratio",
    "ground",
    [Parameter("change", "1", 0.1, lower=-0.35, upper=0.24)],
    physics="Poisson's ratio is not what the survey assumed.",
    plain=Plain(
        "Poisson's ratio",
        "Poisson's ratio of the ground is {size} higher than assumed.",
        "Poisson's ratio of the ground is {size} lower than assumed.",
    ),
    source="Boussinesq 1885; Johnson 1985, eq. 3.18.",
    confounders="depth, camber and anisotropy; a depth known from an anchor helps",
    families=("depth",),
)
def poisson_ratio(ground: Ground, p: Values, survey: Surroundings) -> Ground:
    """Another Poisson's ratio everywhere."""
    return ground.with_ratio_changed(lambda point: p["change"] + 0 * point[..., 0])


@effect(
    "poisson_gradient",
    "ground",
    [
        Parameter("change", "1", 0.1, lower=-0.35, upper=0.35),
        Parameter("place", "m", 3.0, grid=(-20.0, -10.0, 0.0, 10.0, 20.0)),
        Parameter("width", "m", 3.0, lower=2, upper=25, grid=(10.0,)),
    ],
    physics="Poisson's ratio changes along the road, as from dry to wet ground.",
    plain=Plain(
        "Changing Poisson's ratio",
        "Poisson's ratio of the ground changes by {size} about x = {x}.",
        size=lambda v, s: 2 * abs(v),
    ),
    source="Das 2010, Principles of Geotechnical Engineering, table 11.",
    confounders="a change of stiffness along the road",
    families=("gain",),
)
def poisson_gradient(ground: Ground, p: Values, survey: Surroundings) -> Ground:
    """Falls by the change before a place and rises by it beyond, as a tanh of some width."""
    middle = survey.middle[0] + p["place"]
    return ground.with_ratio_changed(lambda point: p["change"] * torch.tanh((point[..., 0] - middle) / p["width"]))


@effect(
    "stiffness_contrast",
    "ground",
    [
        Parameter("log_ratio", "1", 0.5, lower=-3, upper=3),
        Parameter("place", "m", 1.0, grid=tuple(np.arange(-45.0, 45.1, 5.0).tolist())),
    ],
    physics="The ground is stiffer on one side of a place: strain is inverse to the shear modulus.",
    plain=Plain(
        "Change of stiffness",
        "Beyond x = {x} the ground is {size} stiffer.",
        "Beyond x = {x} the ground is {size} softer.",
        grown,
        "%",
    ),
    source="Boussinesq 1885: displacement is F / (4 pi G) times geometry.",
    confounders="coupling of the cable that changes along it, and the route",
    families=("gain",),
)
def stiffness_contrast(ground: Ground, p: Values, survey: Surroundings) -> Ground:
    """The shear modulus grows by exp(log_ratio) over a few meters, its geometric mean unchanged."""
    place = survey.middle[0] + p["place"]

    def compliance(point: Tensor) -> Tensor:
        return torch.exp(-0.5 * p["log_ratio"] * torch.tanh((point[..., 0] - place) / 2.0))

    return ground.softened(compliance)


def of_law(ground: Ground, law: Corrected) -> Ground:
    """The ground as a law changes it, under loads that move and under loads that change."""
    return ground.responding(law, law.displacement)


def soft_on_stiff(fitted: Fitted) -> list[Start]:
    """Two meters three times softer than what is below, as ground is that stiffens with depth.

    Once the route has followed such a layer, a stiff one may seem to explain the rest: no step leads back from there.
    """
    return [Start((np.array([-np.log(3.0)]),), {"thickness": 2.0})]


@effect(
    "layered_ground",
    "ground",
    [
        Parameter("log_ratio", "1", 1.0, lower=-2.5, upper=3.0),
        Parameter("thickness", "m", 0.5, lower=0.4, upper=8.0, grid=(1.0, 2.0, 4.0)),
    ],
    physics="A layer of another stiffness lies on the half-space.",
    plain=Plain(
        "Layered ground",
        "The upper {thickness} of the ground are {size} stiffer.",
        "The upper {thickness} of the ground are {size} softer.",
        grown,
        "%",
    ),
    source="Burmister 1945, J. Appl. Phys. 16, 89; Kausel and Roesset 1981, BSSA 71, 1743.",
    confounders="whatever blurs; several speeds, lanes and distances separate them",
    families=("blur",),
    starts=soft_on_stiff,
    order=-1,
)
def layered_ground(ground: Ground, p: Values, survey: Surroundings) -> Ground:
    """Shear modulus of the layer over that below is exp(log_ratio)."""
    return of_law(ground, layered(p["log_ratio"], p["thickness"]))


@effect(
    "pavement",
    "ground",
    [Parameter("stiffness", "m", 3.0, lower=0, upper=12)],
    physics="A thin stiff pavement spreads the load.",
    plain=Plain("Stiff pavement", "A stiff pavement spreads the load over {size}."),
    source="Burmister 1945; Huang 2004, Pavement Analysis and Design, section 2.2.",
    confounders="depth and Poisson's ratio together",
    families=("blur",),
    order=-1,
)
def pavement(ground: Ground, p: Values, survey: Surroundings) -> Ground:
    """Stiffness is (G_pavement / G_ground - 1) times thickness, of 0.2 m."""
    return of_law(ground, paved(p["stiffness"]))


@effect(
    "gibson_soil",
    "ground",
    [Parameter("gradient", "1/m", 1.0, lower=0, upper=3)],
    physics="The soil stiffens with depth: G = G0 (1 + gradient z).",
    plain=Plain(
        "Soil that stiffens with depth", "The soil is {size} stiffer with every meter of depth.", size=percent, unit="%"
    ),
    source="Gibson 1967, Geotechnique 17, 58.",
    confounders="a layered ground",
    families=("blur",),
    order=-1,
)
def gibson_soil(ground: Ground, p: Values, survey: Surroundings) -> Ground:
    """Shear modulus that grows linearly with depth."""
    return of_law(ground, stiffening(p["gradient"]))


@effect(
    "moving_load",
    "ground",
    [Parameter("shear_slowness_squared", "s^2/m^2", 1e-4, lower=0, upper=4e-4)],
    physics="The ground has inertia: a load that moves fast against shear waves makes a narrower trough.",
    plain=Plain(
        "Soft ground under fast wheels",
        "The ground is so soft that shear waves run at only {size}.",
        size=shear_speed,
        unit="m/s",
    ),
    source="Eason 1965, Int. J. Eng. Sci. 2, 581: gamma_i = sqrt(1 - v^2 cos^2 / c_i^2).",
    confounders="other blurs, unless speeds are mixed",
    families=("blur",),
    order=-1,
)
def moving_load(ground: Ground, p: Values, survey: Surroundings) -> Ground:
    """Steady subsonic motion to second order in v / c_s; 1e-4 s^2/m^2 is a shear speed of 100 m/s."""
    return ground.responding(Moving(p["shear_slowness_squared"]))


@effect(
    "viscoelastic_lag",
    "ground",
    [
        Parameter("creep", "1", 0.2, lower=0, upper=3),
        Parameter("time", "s", 0.3, lower=0.01, upper=60, grid=(0.05, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 6.4, 12.8)),
    ],
    physics="Part of the strain is delayed: the ground creeps as a standard linear solid.",
    plain=Plain(
        "Creeping ground", "A part of the strain, {size} of the rest, comes late, over {time}.", size=percent, unit="%"
    ),
    source="Findley, Lai and Onaran 1976, Creep and Relaxation, section 5.",
    confounders="grade and drag for long times, a clock offset for short ones",
    families=("even",),
)
def viscoelastic_lag(ground: Ground, p: Values, survey: Surroundings) -> Ground:
    """Compliance 1 + creep / (1 + s time) relative to the immediate one."""
    return ground.filtered(lambda s: 1 + p["creep"] / (1 + s * p["time"]))


@effect(
    "kelvin_voigt_lag",
    "ground",
    [Parameter("time", "s", 0.1, lower=0, upper=5)],
    physics="The ground follows its load with a lag: a Kelvin-Voigt solid.",
    plain=Plain("Lagging ground", "The ground follows its load {size} late."),
    source="Findley, Lai and Onaran 1976, section 3.",
    confounders="other lags: clock offset, the vehicle's reference point",
    families=("lag",),
)
def kelvin_voigt_lag(ground: Ground, p: Values, survey: Surroundings) -> Ground:
    """Compliance 1 / (1 + s time)."""
    return ground.filtered(lambda s: 1 / (1 + s * p["time"]))


@effect(
    "maxwell_flow",
    "ground",
    [Parameter("rate", "1/s", 0.05, lower=0, upper=5)],
    physics="The ground yields as long as it is loaded: a Maxwell solid.",
    plain=Plain("Yielding ground", "Under load the ground yields by {size} a second.", size=percent, unit="%"),
    source="Findley, Lai and Onaran 1976, section 3.",
    confounders="grade and drag, an AC-coupled interrogator",
    families=("even",),
)
def maxwell_flow(ground: Ground, p: Values, survey: Surroundings) -> Ground:
    """Compliance 1 + rate / s."""
    return ground.filtered(lambda s: 1 + p["rate"] / s)


@effect(
    "rayleigh_wave",
    "ground",
    [
        Parameter("sine", "1", 0.01, lower=-0.5, upper=0.5, scope="pass"),
        Parameter("cosine", "1", 0.01, lower=-0.5, upper=0.5, scope="pass"),
        Parameter("frequency", "Hz", 0.2, lower=1.5, upper=20, grid=(3.0, 6.0, 10.0)),
        Parameter("speed", "m/s", 30.0, lower=60, upper=400, grid=(160.0,)),
    ],
    physics="Vehicles radiate surface waves, far, weak and fast: r^-1/2 cos(w (t - r / c)).",
    plain=Plain("Surface waves", "Vehicles send out surface waves of {frequency}."),
    source="Lamb 1904, Phil. Trans. A 203, 1; Richart, Hall and Woods 1970, Vibrations of Soils, section 3.",
    seek=loudest_waves,
)
def rayleigh_wave(ground: Ground, p: Values, survey: Surroundings) -> Ground:
    """Radial motion of a phase of each vehicle's own; 1 strains the ground 10 m away as its trough does nearby."""
    return ground.radiating(Radiated(p["sine"], p["cosine"], p["frequency"], p["speed"]))


EFFECTS = (
    poisson_ratio,
    poisson_gradient,
    stiffness_contrast,
    layered_ground,
    pavement,
    gibson_soil,
    moving_load,
    viscoelastic_lag,
    kelvin_voigt_lag,
    maxwell_flow,
    rayleigh_wave,
)
