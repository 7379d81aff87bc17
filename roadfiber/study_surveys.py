"""The paper's study, survey by survey: its points, the survey of each, and what locating it gives.

Every survey comes from the simulator, which shares no code with the signal path. Results are kept by their settings, so
that a study that was stopped goes on where it was, and more surveys or methods add to it. Expected error: of draws from
the covariance of the fit at the truth (Cramer-Rao, with the priors).
"""

import json
import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from solver.cable.curves import hausdorff
from solver.catalogue.catalogue import built_in
from solver.fit.chain import Chain
from solver.fit.map_fit import MapFit
from solver.fit.pose import pose
from solver.fit.prior import Prior
from solver.fit.problem import Problem
from solver.published.geometric_route import geometric_route
from solver.run.locate import locate
from solver.run.run import Run
from solver.simulator import Scenario, Survey, simulate, write_survey
from solver.start.initialization import initialize
from solver.survey.anchors import Anchor
from solver.survey.survey import Survey as Read
from vision.contract import InputError, progress, writing

if TYPE_CHECKING:
    import pandas as pd

METHODS = ("spline", "network", "network-whitened", "geometric")
DRAWS = 200
ASSUMED_RATIO = 0.25  # what every simulated site.toml says


@dataclass(frozen=True)
class Setting:
    """One located survey.

    Parameters
    ----------
    method : of `METHODS`; "geometric" is the paper's first route alone
    seed : of the simulated survey
    snr_db : over the maps of all passes, dB
    track_noise : standard deviation of every fix, independent, known to the fit, m
    track_error : standard deviation of a constant error of each whole track, unknown to the fit, m
    anchors : how many, over the 100 m view, with 5 cm of error
    poisson_error : true minus assumed Poisson ratio
    passes : vehicles
    loads : "point", as in the paper, or "wheels"
    """

    method: str = "spline"
    seed: int = 0
    snr_db: float = 15.0
    track_noise: float = 0.06
    track_error: float = 0.0
    anchors: int = 2
    poisson_error: float = 0.0
    passes: int = 8
    loads: str = "point"

    @property
    def key(self) -> str:
        """What its result is kept under."""
        return json.dumps(asdict(self), sort_keys=True)


@dataclass(frozen=True)
class Axis:
    """What is varied, and what the paper says of it.

    Parameters
    ----------
    field : of `Setting`
    label : of the figure
    values : to try
    limit : value beyond which the paper fails, or that it needs; None where it names none
    said : about it
    rises : whether the paper locates above the limit rather than below it
    """

    field: str
    label: str
    values: tuple[float, ...]
    limit: float | None
    said: str
    rises: bool = False


FAILS = "the paper fails beyond 0.35 m"
QUIET = "the paper fails below 7 dB"
AXES = {
    "snr": Axis("snr_db", "SNR, dB", (-3.0, 0.0, 3.0, 7.0, 10.0, 15.0, 20.0, 30.0), 7.0, QUIET, True),
    "noise": Axis("track_noise", "noise of the fixes, m", (0.0, 0.1, 0.2, 0.35, 0.5, 0.7, 1.0), 0.35, FAILS),
    "offset": Axis("track_error", "error of a whole track, m", (0.0, 0.1, 0.2, 0.35, 0.5, 0.7, 1.0), 0.35, FAILS),
    "anchors": Axis("anchors", "anchors per 100 m", (0, 1, 2, 3, 4, 5), 2.0, "the paper needs 2 per 100 m", True),
    "poisson": Axis(
        "poisson_error",
        "error of the Poisson ratio",
        (-0.05, -0.02, 0.0, 0.02, 0.05),
        None,
        "the paper loses 5 cm per 0.01",
    ),
}
FIELD = (0.35, 0.5)  # m; largest error that the paper reached in the field
PER_RATIO = 5.0  # m per unit of Poisson ratio that the paper loses


def survey_of(setting: Setting) -> Survey:
    """Simulate the survey of a setting."""
    effects = {"point_load": 1.0} if setting.loads == "point" else {}
    survey = simulate(
        Scenario(
            seed=setting.seed,
            passes=setting.passes,
            snr_db=setting.snr_db,
            fix_sigma=setting.track_noise,
            poisson_ratio=ASSUMED_RATIO + setting.poisson_error,
            effects=effects,
        )
    )
    rng = np.random.default_rng([setting.seed, 1])
    return replace(
        survey,
        anchors=anchors_of(survey, setting.anchors, rng),
        trajectories=shifted(survey.trajectories, setting.track_error, rng),
    )


def anchors_of(survey: Survey, count: int, rng: np.random.Generator) -> "pd.DataFrame":
    """Anchors evenly over the view, an eighth of it from either end, with the scenario's errors."""
    first, last = survey.active
    share = np.linspace(1 / 8, 7 / 8, count) if count > 1 else np.array([0.5])[:count]
    channel = np.rint(first + share * (last - first)).astype(int)
    sigma = survey.scenario.anchor_sigma
    place = survey.route[channel] + sigma * rng.normal(size=(len(channel), 3))
    import pandas as pd

    columns = {"name": [f"anchor_{number}" for number in channel], "channel": channel}
    columns |= dict(zip("xyz", place.T, strict=True)) | {"sigma_xy": sigma, "sigma_z": sigma}
    return pd.DataFrame(columns)


def shifted(table: "pd.DataFrame", sd: float, rng: np.random.Generator) -> "pd.DataFrame":
    """Trajectories with a constant error of each track, of standard deviation `sd` along x and along y, m."""
    tracks = table["track_id"].unique()
    shift = dict(zip(tracks, sd * rng.normal(size=(len(tracks), 2)), strict=True))
    moved = np.array([shift[track] for track in table["track_id"]])
    return table.assign(x=table["x"] + moved[:, 0], y=table["y"] + moved[:, 1])


def located(setting: Setting, survey: Survey) -> tuple[Read, Run]:
    """Locate the fiber as a user would, from the survey's files; also what was read."""
    with tempfile.TemporaryDirectory() as folder:
        whole = Read.read(write_survey(survey, Path(folder) / "survey"))
        method, _, likelihood = ("spline" if setting.method == "geometric" else setting.method).partition("-")
        wheels = [name for name, one in built_in().items() if one.base_part == "wheels"]
        effects = [] if setting.loads == "point" else wheels
        return whole, locate(whole, method=method, likelihood=likelihood or None, effects=effects)


def problem_at(survey: Read, found: Run, true: np.ndarray) -> Problem:
    """The problem that was fitted, beginning at the true route of all channels [channel, 3], m."""
    channel = found.result.fitted_channel
    ground = survey.ground
    prior = Prior(depth=ground.depth, poisson_ratio=(ground.poisson_ratio, Prior.poisson_ratio[1]))
    anchors: Sequence[Anchor] = found.anchors
    return pose(survey.record, found.passes, anchors, true[channel], channel, prior)


def expected_errors(problem: Problem, true: np.ndarray, channel: np.ndarray) -> tuple[float, float]:
    """Mean and largest error, m, to expect over `channel`: of draws from the covariance of the fit at the truth."""
    fit = MapFit(problem)
    reach = problem.route_channel[(problem.route_channel >= 0) & (problem.route_channel < len(true))]
    route = fit.basis.interpolate(problem.distance_of(reach), true[reach])
    state = fit.start_at(torch.from_numpy(route), torch.tensor(problem.prior.poisson_ratio[0]))
    matrix, _ = Chain.single(fit).dense(state, [fit.linearized(state)])
    size = fit.layout["route"].stop
    covariance = torch.linalg.inv(matrix)[:size, :size].numpy()
    drawn = np.random.default_rng(0).multivariate_normal(np.zeros(size), covariance, DRAWS, method="eigh")
    error = fit.basis.at(problem.distance_of(channel)) @ drawn.reshape(DRAWS, -1, 3)
    distance = np.linalg.norm(error, axis=-1)
    return float(distance.mean()), float(distance.max(1).mean())


def run(setting: Setting) -> dict[str, float | str]:
    """Locate one survey and compare with the truth; a survey that cannot be located gives what was said."""
    survey = survey_of(setting)
    begun = time.perf_counter()
    try:
        read, found = located(setting, survey)
    except InputError as error:
        return {"failed": str(error)}
    seconds = time.perf_counter() - begun
    result, true = found.result, survey.route
    view = np.arange(survey.active[0], survey.active[1] + 1)
    here = np.isin(result.channel, view)
    channel, route = result.channel[here], result.route[here]
    if setting.method == "geometric":
        rough = initialize(read.record, found.passes)
        here = np.isin(rough.channel, view)
        channel, route = (
            rough.channel[here],
            geometric_route(read.record, found.passes, rough, anchors=found.anchors)[here],
        )
    off = np.linalg.norm(route - true[channel], axis=1)
    mean, largest = expected_errors(problem_at(read, found, true), true, channel)
    row: dict[str, float | str] = {
        "mean": float(off.mean()),
        "largest": float(off.max()),
        "hausdorff": hausdorff(route, true[channel]),
        "located_share": len(channel) / len(view),
        "expected_mean": mean,
        "expected_largest": largest,
        "ambiguous": float(result.ambiguous_side),
        "seconds": seconds,
    }
    if setting.method != "geometric":
        apart = np.abs(result.route - true[result.channel])[np.isin(result.channel, channel)]
        row["covered"] = float((apart < 1.96 * result.sigma[np.isin(result.channel, channel)]).mean())
    return row


def settings_of(axes: Iterable[Axis], methods: Sequence[str], surveys: int, base: Setting) -> list[Setting]:
    """Every point of the study once, survey by survey, so that a part of a run is a smaller study."""
    points = [
        replace(base, method=method, seed=seed, **varied(axis, value))
        for seed in range(surveys)
        for axis in axes
        for value in axis.values
        for method in methods
    ]
    return list(dict.fromkeys(points))


def varied(axis: Axis, value: float) -> dict[str, Any]:
    """The field that an axis varies, by name."""
    return {axis.field: value}


def studied(settings: Sequence[Setting], kept: Path, jobs: int = 1) -> dict[str, dict[str, float | str]]:
    """Results by key of all settings; those in the file `kept` are taken from there, and new ones added to it."""
    results = kept_results(kept)
    left = [setting for setting in settings if setting.key not in results]
    with progress("locating surveys", len(left)) as advance:
        for setting, row in finished(left, jobs):
            results[setting.key] = row
            with writing(kept) as temporary:
                temporary.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
            advance(1)
    return results


def kept_results(path: Path) -> dict[str, dict[str, float | str]]:
    """Results of an earlier study; none where there is no file.

    Raises
    ------
    InputError
        If the file holds something else.
    """
    if not path.is_file():
        return {}
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        if not all(isinstance(Setting(**json.loads(key)), Setting) and isinstance(found[key], dict) for key in found):
            raise ValueError("not by settings")
    except (ValueError, TypeError) as error:
        raise InputError(f"{path}: holds no results of a study; give another folder for --out") from error
    return dict(found)


def finished(settings: Sequence[Setting], jobs: int) -> Iterator[tuple[Setting, dict[str, float | str]]]:
    """Settings and their results, as they come."""
    if jobs == 1:
        yield from ((setting, run(setting)) for setting in settings)
        return
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        futures = {pool.submit(run, setting): setting for setting in settings}
        yield from ((futures[future], future.result()) for future in as_completed(futures))
