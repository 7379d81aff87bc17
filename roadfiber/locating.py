"""A survey to a run: read, locate, open."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

from roadfiber.widening import FULL, check_corridor, with_corridor
from solver.effect import Effect
from solver.run.folder import read_run
from solver.run.locate import EFFECTS
from solver.run.locate import locate as locate_fiber
from solver.run.run import Run
from solver.run.scene import CALIBRATION, PICTURE
from solver.survey.survey import Survey
from vision.contract.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

    from solver.drive.drive import Drive
    from solver.drive.drive_run import DriveRun
    from solver.run.combined import Combined
    from solver.run.scene import Scene
    from solver.survey.site import Site
    from vision.tracked import Tracked


def read(path: Path | str) -> "Survey | Drive":
    """Read a survey.

    Parameters
    ----------
    path : of its site.toml, or of the folder that holds one

    Returns
    -------
    survey : its record, tracks (None where there is a video to be tracked), anchors and ground; a `Drive` where
        site.toml has `[route]`, the operator's map of a fiber that one car with GPS drove along

    Raises
    ------
    InputError
        If a file is missing, or cannot be used: what, where, and how to mend it.

    Examples
    --------
    >>> survey = rf.read(folder / "survey" / "site.toml")
    >>> survey.tracks["track_id"].nunique(), len(survey.anchors)
    (4, 2)
    """
    from solver.drive.drive import Drive
    from solver.survey.site import read_site

    path = Path(path)
    site = read_site(path / "site.toml" if path.is_dir() else path)
    return Survey.of_site(site) if site.route is None else Drive.of_site(site)


@overload
def locate(survey: "Drive", *, effects: Sequence[str | Effect] = EFFECTS) -> "DriveRun": ...


@overload
def locate(
    survey: Survey,
    *,
    method: str = "spline",
    likelihood: str | None = None,
    effects: Sequence[str | Effect] = EFFECTS,
    filters: Sequence[str] = (),
    all_passes: bool = False,
    unlisted: bool = False,
    corridor: str = FULL,
) -> Run: ...


@overload
def locate(
    survey: Path | str,
    *,
    method: str = "spline",
    likelihood: str | None = None,
    effects: Sequence[str | Effect] = EFFECTS,
    filters: Sequence[str] = (),
    all_passes: bool = False,
    unlisted: bool = False,
    corridor: str = FULL,
) -> "Run | DriveRun": ...


def locate(
    survey: "Survey | Drive | Path | str",
    *,
    method: str = "spline",
    likelihood: str | None = None,
    effects: Sequence[str | Effect] = EFFECTS,
    filters: Sequence[str] = (),
    all_passes: bool = False,
    unlisted: bool = False,
    corridor: str = FULL,
) -> "Run | DriveRun":
    """Locate the fiber of a survey.

    A video is tracked first where the survey has no trajectories. Ctrl-C ends it with KeyboardInterrupt and leaves
    nothing behind.

    Of a drive (site.toml has `[route]`) the clock, the polarity, loops of slack and the place of every channel along
    the map are found. A drive has no methods to choose, and three effects: `gauge_length`, `channel_stretch` and
    `clock_drift`.

    Parameters
    ----------
    survey : as `read` returns it or built in memory; or the path of a site.toml
    method : "spline", or "network" (the paper's)
    likelihood : of the network: "published" (default), or "whitened": noise, priors and anchors as the spline has them
    effects : names out of the catalogue (`roadfiber effects`), or effects of your own; `[]` is the paper's model, point
        loads and straight gauges
    filters : "fk" or "median", for the matched filter in much noise
    all_passes : fit all vehicles; else of more than 30 those ten to twenty that tell most of route, depth and ground,
        and the rest test the route
    unlisted : fit vehicles, too, that the fiber hears while it records one of the trajectories, and that these lack;
        their tracks are free; it listens to what fits leave, too, until nothing more is heard
    corridor : "full" holds what the model may lack, too: every effect of the catalogue is tested on what the fit
        leaves; "fit" takes the model for granted, which is faster, and too narrow wherever something is missing

    Returns
    -------
    run : the route with its uncertainty, and whether it may be relied on (`run.trust`); of a drive a `DriveRun`, with
        its `loops` too

    Raises
    ------
    InputError
        If the survey cannot be used, clocks do not overlap, or no vehicle is seen in the DAS.

    Examples
    --------
    >>> run = rf.locate(survey, effects=[], corridor="fit")
    >>> bool(run.route["constrained"].sum() > 30), run.trust[:15]
    (True, 'No check failed')
    """
    check_corridor(corridor)
    whole = read(survey) if isinstance(survey, Path | str) else survey
    if not isinstance(whole, Survey):
        from solver.drive.locate_drive import locate_drive
        from solver.drive.misstated import TOLD

        if method != "spline" or likelihood or filters or all_passes or unlisted:
            raise InputError(f"{whole.name}: a drive; it takes no method, filters or choice of passes")
        names = [] if list(effects) == list(EFFECTS) else [one if isinstance(one, str) else one.name for one in effects]
        if not set(names) <= set(TOLD):
            raise InputError(f"{whole.name}: a drive; it takes the effects {', '.join(TOLD)}, not {', '.join(names)}")
        return locate_drive(replace(whole, effects=tuple(names)))
    asked: dict[str, Any] = {"method": method, "likelihood": likelihood, "effects": effects, "filters": filters}
    asked |= {"all_passes": all_passes, "unlisted": unlisted}
    if whole.tracks is not None:
        run = with_corridor(locate_fiber(whole, **asked), corridor)
        return replace(run, scene=scene_of(whole))
    tracked = followed(whole)
    return located(whole, tracked.table, tracked.dropped, tracked.placed, corridor=corridor, **asked)


def located(
    survey: Survey,
    table: "pd.DataFrame",
    dropped: "pd.DataFrame | None",
    placed: str,
    *,
    corridor: str = FULL,
    **settings: Any,
) -> Run:
    """Locate the fiber of a survey whose video was tracked: fixes on the road, those dropped, a line on both."""
    ready = survey.with_tracks(table, cautions=[placed])
    run = with_corridor(locate_fiber(ready, **settings), corridor)
    return replace(run, tracked=table, dropped=dropped, scene=scene_of(survey))


def scene_of(survey: Survey) -> "Scene | None":
    """What the survey's camera saw of the street; None where it has none, or its video gives no picture."""
    from vision.street_picture import StreetPicture

    if survey.camera is None:
        return None
    try:
        return StreetPicture.of_video(survey.camera.video, survey.camera.calibration)
    except InputError:
        return None  # The route does not need it.


def followed(whole: "Survey | Site") -> "Tracked":
    """Track the video of a survey that has no trajectories; InputError where its calibration is for another frame."""
    from vision.cache import cache_folder
    from vision.camera import Calibration
    from vision.pipeline import track

    camera = whole.camera
    assert camera is not None, "a survey without trajectories has a camera"
    view = Calibration.read(camera.calibration)
    view.require_frame(whole.frame, camera.calibration)
    return track(
        camera.video,
        detector=camera.detector,
        calibration=view,
        start=camera.start,
        clock_offset=camera.clock_offset,
        cache=cache_folder(),
    )


def open(
    folder: Path | str, *, plugins: Sequence[Path | str] = (), effects: Iterable[Effect] = (), changed: bool = False
) -> "Run | DriveRun | Combined":
    """Open a run folder, or one that `Combined.save` wrote. It is data: nothing in it is executed.

    Parameters
    ----------
    folder : that `Run.save` or a command wrote
    plugins : files with effects of your own that may be in its model, or put into it; their code is run
    effects : such effects as objects
    changed : whether a plugin may be another file than the run was made with

    Raises
    ------
    InputError
        If it is not a run folder, a part of it is missing or corrupt, or a plugin cannot be used.

    Examples
    --------
    >>> run.save(folder / "run")
    >>> rf.open(folder / "run").name
    'street-paper'
    """
    from solver.drive.drive_folder import read_drive_run
    from solver.drive.drive_format import is_drive

    folder = Path(folder)
    if is_drive(folder):
        return read_drive_run(folder)
    # Loads PyTorch, which a drive does without.
    from solver.run.combined import is_combined, read_combined

    if is_combined(folder):
        return read_combined(folder, plugins=[Path(path) for path in plugins], effects=effects, changed=changed)
    return open_street(folder, plugins=plugins, effects=effects, changed=changed)


def open_street(
    folder: Path | str, *, plugins: Sequence[Path | str] = (), effects: Iterable[Effect] = (), changed: bool = False
) -> Run:
    """Open a run folder whose run can be compared, diagnosed and given effects; arguments as of `open`.

    Raises
    ------
    InputError
        As of `open`, and where it is of a drive.
    """
    from vision.street_picture import StreetPicture

    require_street(Path(folder))
    run = read_run(Path(folder), plugins=[Path(path) for path in plugins], effects=effects, changed=changed)
    return replace(run, scene=StreetPicture.read(Path(folder) / PICTURE, Path(folder) / CALIBRATION))


def require_street(folder: Path) -> None:
    """Refuse the folder of a drive or of combined runs where the run of a street is needed; InputError says which."""
    from solver.drive.drive_format import is_drive

    if is_drive(folder):
        raise InputError(f"{folder}: the run of a drive, which has one car; give the run of a street")
    from solver.run.combined import RUNS, is_combined

    if is_combined(folder):
        runs = ", ".join(str(one) for one in sorted((folder / RUNS).glob("*")))
        raise InputError(f"{folder}: one route of several runs, each with a model of its own; give one of them: {runs}")
