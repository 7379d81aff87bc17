"""A small survey with a fit made by hand, for the run folder and its report."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
import torch
from simulated import Case, case_of

from solver import simulator
from solver.fit.prior import Prior
from solver.fit.problem import Problem
from solver.fit.result import FitResult, Parameter
from solver.noise.law import NoiseLaw
from solver.signal_path.traffic import Traffic
from solver.survey.anchors import Anchor
from solver.survey.das import DASRecord
from solver.survey.site import Site, read_site
from solver.survey.survey import Survey as Read
from solver.survey.survey import das_sources, file_sources
from solver.trajectory.vehicle_pass import Pass

SITE = """
name = "Elm <Street> & 2nd"
[frame]
origin = [32.113, 34.804]
x_azimuth = 78.0
[das]
files = ["das.h5"]
[trajectories]
files = ["tracks.csv"]
"""


@dataclass(frozen=True)
class Survey:
    """What `run_of` takes."""

    site: Site
    record: DASRecord
    passes: list[Pass]
    anchors: list[Anchor]
    problem: Problem
    result: FitResult

    def changed(self, **changes: Any) -> "Survey":
        """The same survey with another result."""
        return replace(self, result=replace(self.result, **changes))

    @property
    def arguments(self) -> dict[str, Any]:
        """Keyword arguments of `run_of`."""
        whole = Read.of(
            name=self.site.name,
            frame=self.site.frame,
            record=self.record,
            tracks=None,
            anchors=self.anchors,
            ground=self.site.ground,
            camera=None,
            sources=(*das_sources(self.record), *file_sources(self.site)),
            seconds=0.5,
            cautions=(),
        )
        passes = {"passes": self.passes, "anchors": self.anchors, "problem": self.problem}
        return {"survey": whole, "timings": {"fit": 1.5}} | passes


def made_route(channel: np.ndarray) -> np.ndarray:
    """A route [channel, 3] that bends gently."""
    x = (channel - channel[0]) * 1.0
    return np.stack([x, 4.0 + 0.5 * np.sin(x / 15), 1.0 + 0.1 * np.cos(x / 20)], 1)


def made_pass(track_id: str, vehicle_class: str, first: int, count: int, speed: float, y: float) -> Pass:
    """A straight drive over 60 m of road."""
    t = np.arange(count) / 5.0
    x = speed * t - 5.0 if speed > 0 else 65.0 + speed * t
    return Pass(
        track_id,
        vehicle_class,
        np.arange(first, first + count),
        np.stack([x, np.full(count, y)], 1),
        np.tile([speed, 0.0], (count, 1)),
        np.full((count, 2), 0.05),
        (x > 0) & (x < 60),
        None if vehicle_class == "car" else 9.5,
    )


def made_wave(one: Pass, route: np.ndarray) -> np.ndarray:
    """Something like the strain rate of a pass: [row, channel]."""
    ahead = route[None, :, 0] - one.position[:, :1]
    return -2e-7 * np.sign(one.speed) * ahead * np.exp(-((ahead / 8) ** 2))


@pytest.fixture(scope="session")
def survey(tmp_path_factory: pytest.TempPathFactory) -> Survey:
    """Two passes over 55 channels, in noise the model explains; channel 70 is dead. Not to be changed in place."""
    folder = tmp_path_factory.mktemp("survey")
    (folder / "site.toml").write_text(SITE)
    (folder / "das.h5").write_bytes(b"das")
    (folder / "tracks.csv").write_bytes(b"tracks")
    site = read_site(folder / "site.toml")
    rng = np.random.default_rng(3)
    channel = np.arange(50, 111)
    fitted = np.setdiff1d(np.arange(53, 108), [70])
    route, noise = made_route(channel), np.full(len(fitted), 2e-8)
    at = np.searchsorted(channel, fitted)
    passes = [
        made_pass("1", "car", 100, 60, 6.0, 0.0),
        made_pass("b/2", "bus", 220, 40, -9.0, -3.5),
    ]
    model = np.zeros((400, len(fitted)))
    for one in passes:
        model[one.rows] += made_wave(one, route[at])
    strain_rate = np.full((400, 150), 1e-8)
    strain_rate[:, fitted] = model + rng.normal(0, 2e-8, model.shape)
    samples = np.concatenate([one.rows for one in passes])
    record = DASRecord(
        strain_rate=strain_rate,
        time=np.arange(400) / 5.0,
        start=np.datetime64("2025-08-11T06:00:00", "ns"),
        distance=np.arange(150) * 1.0,
        channel=np.arange(150),
        gauge_length=10.0,
        channel_spacing=1.0,
        sampling_rate=5.0,
        gaps=(),
        provenance={"files": [str(folder / "das.h5")], "sha256": ["ab" * 32], "format": "PRODML", "notes": []},
    )
    result = FitResult(
        method="spline",
        channel=channel,
        distance=channel * 1.0,
        route=route,
        covariance=np.tile(np.diag([0.01, 0.0025, 0.0016]), (len(channel), 1, 1)),
        tails=np.zeros((len(channel), 3, 3)),
        constrained=(channel >= 52) & (channel <= 108),
        data_share=np.full((len(channel), 3), 0.9),
        parameters={
            "poisson_ratio": Parameter(0.251, 0.012, "1", True),
            "amplitude[1]": Parameter(1.2e-5, 2e-7, "m^2", True),
            "amplitude[b/2]": Parameter(8e-5, 3e-7, "m^2", True),
            "wheelbase[1]": Parameter(2.65, 0.0, "m", False),
            "wheelbase[b/2]": Parameter(5.9, float("nan"), "m", True),
        },
        vector=np.zeros(3),
        samples=samples,
        fitted_channel=fitted,
        measured=strain_rate[samples][:, fitted],
        model=model[samples],
        noise=noise,
        weight=np.ones((len(samples), len(fitted))),
        law=NoiseLaw.white(),
        chi2=1234.5,
        chi2_per_dof=1.01,
        cost=1234.5,
        ambiguous_side=False,
        iterations=7,
        seconds=1.2,
        converged=True,
    )
    anchors = [Anchor("pit <1> $^$", 60.0, *route[10], 0.05, 0.05)]
    problem = Problem(
        record=strain_rate[:, fitted],
        noise=torch.from_numpy(noise),
        channel=fitted,
        recorded=(0, strain_rate.shape[1] - 1),
        zero_distance=0.0,
        channel_spacing=1.0,
        gauge_length=10.0,
        passes=passes,
        traffic=Traffic.of(passes),
        anchors=anchors,
        start=route[at],
        prior=Prior(),
        sampling_rate=5.0,
    )
    return Survey(site, record, passes, anchors, problem, result)


@pytest.fixture(scope="session")
def street() -> simulator.Survey:
    """Four passes at 20 dB on a street of the independent simulator."""
    return simulator.simulate(simulator.Scenario(seed=5, passes=4, snr_db=20.0))


@pytest.fixture(scope="session")
def case(street: simulator.Survey) -> Case:
    """The fitting problem of `street`, with its two anchors."""
    return case_of(street)
