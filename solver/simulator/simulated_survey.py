"""Simulate a survey: vehicles drive by, the ground deforms, a fiber is stretched, an interrogator records."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from solver.simulator.buried_route import Route
from solver.simulator.fiber_motion import arc_of
from solver.simulator.observe import active_channels, dig, in_view, sample_times, watch
from solver.simulator.postprocessing import processed
from solver.simulator.recorded_noise import color, damage, noise, unsteady
from solver.simulator.scenario import Scenario
from solver.simulator.side_street import side_signal
from solver.simulator.strain import listen
from solver.simulator.street import drive, lay, unseen
from solver.simulator.vehicle import Vehicle

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Survey:
    """A simulated survey and the truth about it.

    Attributes
    ----------
    scenario : as asked for, with the values drawn from its ranges
    start : UTC, of the first sample
    time : [time] s since `start`
    strain_rate : [time, channel] 1/s, as recorded; NaN in a gap
    signal : [time, channel] 1/s, before noise and processing
    distance : [channel] m along the fiber, as the file has it
    route : [channel, 3] m; the middle of each channel's gauge
    fiber : the curve on which these lie
    vehicles : all that drove by; the last one is unseen if the scenario says so
    trajectories : table as in the contract (GPS: latitude, longitude, sigma)
    anchors : table as in the anchors file
    active : first and last channel in view
    noise_sd : 1/s, rms over channels
    """

    scenario: Scenario
    start: np.datetime64
    time: Array
    strain_rate: Array
    signal: Array
    distance: Array
    route: Array
    fiber: Route
    vehicles: tuple[Vehicle, ...]
    trajectories: "pd.DataFrame"
    anchors: "pd.DataFrame"
    active: tuple[int, int]
    noise_sd: float


def simulate(scenario: Scenario) -> Survey:
    """Simulate a survey; the same scenario gives the same survey.

    Every wheel is a point load on a homogeneous elastic half-space. The strain of a channel is the mean over
    its gauge of the extension t . (grad u) . t along the curved fiber, by Gauss-Legendre quadrature;
    the strain rate is its central difference in time. Hidden effects change this chain, see `EFFECTS`; those that act
    in time are stepped at 100 Hz.

    Raises
    ------
    InputError
        If no vehicle in view comes near the route, or it is too short.

    >>> survey = simulate(Scenario(seed=1, passes=1))
    >>> survey.strain_rate.shape[1], survey.route.shape
    (241, (241, 3))
    """
    # One random stream per purpose: more passes or another SNR leave the route unchanged.
    streams = np.random.SeedSequence(scenario.seed).spawn(5)
    scenario = scenario.drawn()
    ways, traffic, fixes, dust, extra = (np.random.default_rng(stream) for stream in streams)
    route, distance = lay(scenario, ways)
    points = route.position(arc_of(scenario, distance, distance))
    active = active_channels(points, scenario.view, scenario.lanes)
    vehicles = drive(scenario, traffic)
    time = sample_times(scenario, vehicles)
    seen = len(vehicles)
    if scenario.effect("unseen_vehicle"):
        vehicles = (*vehicles, unseen(scenario, vehicles, extra))
    signal = listen(scenario, route, distance, vehicles, time, distance[active[0] : active[1] + 1])
    power = np.mean(signal[in_view(scenario, vehicles[:seen], time), active[0] : active[1] + 1] ** 2)
    noise_sd = float(np.sqrt(power / 10 ** (np.asarray(scenario.snr_db) / 10)))
    recorded = signal + noise_sd * unsteady(scenario, noise(dust, signal.shape, color(scenario)))
    if scenario.side_street:
        recorded += side_signal(scenario, route, distance, time)
    recorded += scenario.signal_noise * signal * dust.normal(size=signal.shape)
    recorded = damage(scenario, processed(scenario, recorded, noise_sd), noise_sd)
    return Survey(
        scenario,
        np.datetime64(scenario.start, "ns"),
        time,
        recorded,
        signal,
        distance,
        points,
        route,
        vehicles,
        watch(scenario, vehicles[:seen], fixes),
        dig(scenario, points, active, fixes),
        active,
        noise_sd,
    )
